//! Sampled values.

use std::fmt::Debug;
use std::io::{self, Write};

use glam::DVec3;
use rayon::prelude::*;
use serde::ser::{Serialize, SerializeSeq, Serializer};

use crate::formats::npy::{Array, Values};
use crate::formats::vdb::AnyPartialTree;
use crate::num::Scalar;
use crate::reference::Reference;
use crate::volume::{Filter, NotRead, PartialTree, Sampled};

/// A number or three for each point: of shape (N) or (N, 3).
#[derive(Debug)]
pub(super) struct Samples(Array);

impl Samples {
    /// One number for each point.
    pub(super) fn numbers(values: Values) -> Samples {
        let count = match &values {
            Values::F32(values) => values.len(),
            Values::F64(values) => values.len(),
        };
        Samples(Array { shape: vec![count], values })
    }

    fn vectors(count: usize, values: Values) -> Samples {
        Samples(Array { shape: vec![count, 3], values })
    }

    /// Density by the reference; 0 at points that are not finite.
    pub(super) fn by_reference(reference: &Reference, points: &[DVec3]) -> Samples {
        let density =
            |point: &DVec3| if point.is_finite() { reference.density(point.to_array()) } else { 0.0 };
        Samples::numbers(Values::F64(points.par_iter().map(density).collect()))
    }

    /// Values of a tree: in single precision where the tree has it, else in double.
    pub(super) fn of_tree(
        tree: &AnyPartialTree,
        filter: Filter,
        points: &[DVec3],
    ) -> Result<Samples, NotRead> {
        match tree {
            AnyPartialTree::Bool(tree) => doubles(tree, filter, points),
            AnyPartialTree::Int32(tree) => doubles(tree, filter, points),
            AnyPartialTree::Int64(tree) => doubles(tree, filter, points),
            AnyPartialTree::Double(tree) => doubles(tree, filter, points),
            AnyPartialTree::Float(tree) => {
                Ok(Samples::numbers(Values::F32(single(&tree.sample_at(filter, points)?))))
            }
            AnyPartialTree::Vec3s(tree) => {
                let values = single(tree.sample_at(filter, points)?.as_flattened());
                Ok(Samples::vectors(points.len(), Values::F32(values)))
            }
            AnyPartialTree::Vec3i(tree) => vectors(tree, filter, points),
            AnyPartialTree::Vec3d(tree) => vectors(tree, filter, points),
        }
    }

    pub(super) fn array(&self) -> &Array {
        &self.0
    }

    fn is_vector(&self) -> bool {
        self.0.shape.len() == 2
    }

    /// Lines of x, y, z and the value, in the shortest digits that give the same numbers back.
    pub(super) fn write_csv(&self, points: &[DVec3], out: &mut (impl Write + ?Sized)) -> io::Result<()> {
        let names = if self.is_vector() { "value_x,value_y,value_z" } else { "value" };
        writeln!(out, "x,y,z,{names}")?;
        match &self.0.values {
            Values::F32(values) => lines(points, values, self.is_vector(), out),
            Values::F64(values) => lines(points, values, self.is_vector(), out),
        }
    }
}

fn doubles<T: Sampled<Wide = f64>>(
    tree: &PartialTree<T>,
    filter: Filter,
    points: &[DVec3],
) -> Result<Samples, NotRead> {
    Ok(Samples::numbers(Values::F64(tree.sample_at(filter, points)?)))
}

fn vectors<T: Sampled<Wide = [f64; 3]>>(
    tree: &PartialTree<T>,
    filter: Filter,
    points: &[DVec3],
) -> Result<Samples, NotRead> {
    Ok(Samples::vectors(points.len(), Values::F64(tree.sample_at(filter, points)?.into_flattened())))
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|value| f32::from_f64(*value)).collect()
}

fn lines<T: Debug>(
    points: &[DVec3],
    values: &[T],
    vectors: bool,
    out: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    for (point, values) in points.iter().zip(values.chunks(if vectors { 3 } else { 1 })) {
        write!(out, "{:?},{:?},{:?}", point.x, point.y, point.z)?;
        values.iter().try_for_each(|value| write!(out, ",{value:?}"))?;
        writeln!(out)?;
    }
    Ok(())
}

/// A list of numbers, or of lists of three; null for what JSON has no number for.
impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        fn list<T: Serialize, S: Serializer>(
            values: &[T],
            vectors: bool,
            serializer: S,
        ) -> Result<S::Ok, S::Error> {
            let mut list = serializer.serialize_seq(None)?;
            for values in values.chunks(if vectors { 3 } else { 1 }) {
                match values {
                    [value] => list.serialize_element(value)?,
                    values => list.serialize_element(values)?,
                }
            }
            list.end()
        }
        match &self.0.values {
            Values::F32(values) => list(values, self.is_vector(), serializer),
            Values::F64(values) => list(values, self.is_vector(), serializer),
        }
    }
}
