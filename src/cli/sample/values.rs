//! Sampled values.

use std::fmt::{self, Debug};
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
pub(super) struct Samples {
    array: Array,
    /// Integers that are stored where points are, which double precision may not hold; empty for other types.
    stored: Vec<Option<i64>>,
}

impl Samples {
    /// One number for each point.
    pub(super) fn numbers(values: Values) -> Samples {
        let count = match &values {
            Values::F32(values) => values.len(),
            Values::F64(values) => values.len(),
        };
        Samples { array: Array { shape: vec![count], values }, stored: vec![] }
    }

    fn vectors(count: usize, values: Values) -> Samples {
        Samples { array: Array { shape: vec![count, 3], values }, stored: vec![] }
    }

    /// Density by the reference; 0 at points that are not finite.
    pub(super) fn by_reference(reference: &Reference, points: &[DVec3]) -> Samples {
        let density =
            |point: &DVec3| if point.is_finite() { reference.density(point.to_array()) } else { 0.0 };
        Samples::numbers(Values::F64(points.par_iter().map(density).collect()))
    }

    /// Values of a tree: in single precision where the tree has it, else in double. Stored 64-bit integers are kept
    /// besides.
    pub(super) fn of_tree(
        tree: &AnyPartialTree,
        filter: Filter,
        points: &[DVec3],
    ) -> Result<Samples, NotRead> {
        match tree {
            AnyPartialTree::Bool(tree) => doubles(tree, filter, points),
            AnyPartialTree::Int32(tree) => doubles(tree, filter, points),
            AnyPartialTree::Int64(tree) => {
                let stored = points.par_iter().map(|point| tree.stored_at(filter, *point)).collect();
                Ok(Samples { stored, ..doubles(tree, filter, points)? })
            }
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
        &self.array
    }

    fn is_vector(&self) -> bool {
        self.array.shape.len() == 2
    }

    /// Numbers, each a stored integer where there is one.
    fn integers<'a>(&'a self, values: &'a [f64]) -> impl Iterator<Item = Number> + 'a {
        values.iter().zip(&self.stored).map(|(value, stored)| match stored {
            Some(stored) => Number::Integer(*stored),
            None => Number::Real(*value),
        })
    }

    /// Lines of x, y, z and the value, in the shortest digits that give the same numbers back.
    pub(super) fn write_csv(&self, points: &[DVec3], out: &mut (impl Write + ?Sized)) -> io::Result<()> {
        let names = if self.is_vector() { "value_x,value_y,value_z" } else { "value" };
        writeln!(out, "x,y,z,{names}")?;
        match &self.array.values {
            Values::F64(values) if !self.stored.is_empty() => {
                lines(points, &self.integers(values).collect::<Vec<_>>(), false, out)
            }
            Values::F32(values) => lines(points, values, self.is_vector(), out),
            Values::F64(values) => lines(points, values, self.is_vector(), out),
        }
    }
}

/// A value of a grid of integers.
#[derive(Clone, Copy, serde::Serialize)]
#[serde(untagged)]
enum Number {
    Integer(i64),
    Real(f64),
}

impl Debug for Number {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Number::Integer(value) => value.fmt(out),
            Number::Real(value) => value.fmt(out),
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
        match &self.array.values {
            Values::F64(values) if !self.stored.is_empty() => {
                list(&self.integers(values).collect::<Vec<_>>(), false, serializer)
            }
            Values::F32(values) => list(values, self.is_vector(), serializer),
            Values::F64(values) => list(values, self.is_vector(), serializer),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Tree;
    use crate::volume::tree::RootTile;

    /// A cube of 4096^3 voxels of a value that double precision does not hold, in a background that is none either.
    fn tree(value: i64) -> AnyPartialTree {
        let tree = Tree {
            background: i64::MIN + 1,
            root_tiles: vec![RootTile { origin: [0; 3], value, active: true }],
            uppers: vec![],
            lowers: vec![],
            leaves: vec![],
            pages: vec![],
            slots: None,
        };
        AnyPartialTree::Int64(tree.into())
    }

    #[test]
    fn stored_integers_are_kept() {
        const LARGE: i64 = (1 << 53) + 1;
        let points = [[1.0, 2.0, 3.0], [-1.0, 0.0, 0.0], [4095.5, 0.0, 0.0], [f64::NAN, 0.0, 0.0]];
        let points = points.map(DVec3::from);
        let told = |filter| {
            let samples = Samples::of_tree(&tree(LARGE), filter, &points).expect("all was read");
            let mut csv = vec![];
            samples.write_csv(&points, &mut csv).expect("memory");
            let csv = String::from_utf8(csv).expect("ASCII");
            let csv: Vec<&str> = csv.lines().skip(1).filter_map(|line| line.rsplit(',').next()).collect();
            let json = serde_json::to_string(&samples).expect("numbers");
            assert_eq!(samples.array().shape, [4]);
            (csv.join(" "), json)
        };
        let [large, rest] = [LARGE, i64::MIN + 1].map(|value| value.to_string());
        // Halfway the nearest voxel is the next; the mean is that of doubles, and the last digits are its shortest.
        assert_eq!(told(Filter::Nearest).0, [&*large, &rest, &rest, &rest].join(" "));
        assert_eq!(told(Filter::Nearest).1, format!("[{large},{rest},{rest},{rest}]"));
        for filter in [Filter::Trilinear, Filter::Cubic] {
            let (csv, json) = told(filter);
            let mixed = csv.split(' ').nth(2).expect("a value");
            assert_eq!(csv, [&*large, &rest, mixed, &rest].join(" "));
            // -2^62 + 2^52, but for what double precision does not hold.
            let mixed: f64 = mixed.parse().expect("a number");
            assert!((mixed / -4_607_182_418_800_017_408.0 - 1.0).abs() < 1e-15, "{mixed}");
            assert!(json.starts_with(&format!("[{large},{rest},-")) && json.ends_with(&format!(",{rest}]")));
        }
    }
}
