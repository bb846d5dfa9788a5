//! What a block of voxels needs of a field, re-centred on the block.

use super::narrow::Interval;
use super::near::Near;
use crate::noise;
use crate::num::Scalar;
use crate::num::poly::TERMS;
use crate::scene::{Op, Overlap, Radial};

/// Rows of a piece's table of coefficients that are affine in the position.
pub(crate) const ROWS: usize = 16;
/// Rows of u, of v, of the foot's equation, and of the second plane of a corner.
pub(crate) const U: usize = 0;
pub(crate) const V: usize = TERMS;
pub(crate) const FOOT: usize = 2 * TERMS;
pub(crate) const SECOND: usize = 15;

/// What a block of voxels needs of a field: the pieces of axes that hold feet of its voxels, and their layers.
///
/// Lengths are in voxels and positions from the block's centre; `T` is the kernel's number in memory.
#[derive(Debug, Clone, Default)]
pub struct Region<T> {
    /// The pieces of each tube, in the order of the tubes; of a tube in the order of their arc lengths.
    pub(crate) tubes: Vec<Tube<T>>,
    /// How the tubes join; `None` where no voxel can have two feet that join otherwise than by the larger density, so that
    /// feet need not be told apart.
    pub(crate) join: Option<Overlap>,
    pub(crate) pieces: Vec<Piece<T>>,
    pub(crate) layers: Vec<Layer<T>>,
    pub(crate) sums: Vec<Sum<T>>,
    pub(crate) octaves: Vec<Octave<T>>,
    /// Of the last tube's pieces, in the order in which they were found.
    pub(crate) parts: Vec<Part>,
    /// How many intervals have pieces that share their feet.
    pub(crate) shared: u32,
    /// Memory for the intervals that one part of an axis is divided into.
    pub(crate) intervals: Vec<Interval>,
}

impl<T> Piece<T> {
    /// Whether its feet are those of another.
    pub(crate) fn shares_with(&self, other: &Piece<T>) -> bool {
        match (&self.shared, &other.shared) {
            (Some(own), Some(others)) => own.number == others.number,
            _ => false,
        }
    }
}

impl<T> Region<T> {
    /// Nothing of the field reaches the block.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }
}

/// The pieces of one tube.
#[derive(Debug, Clone)]
pub(crate) struct Tube<T> {
    /// Pieces in `Region::pieces`.
    pub(crate) pieces: [usize; 2],
    pub(crate) overlap: Overlap,
    /// Length of a closed axis, in voxels.
    pub(crate) lap: Option<T>,
}

/// A piece as it lies along the axis: what narrowing knows of it, and the kernel does not read.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Arc length at its height's origin, metres.
    pub(crate) arc: f64,
    /// Segment and t of both ends; `None` for points.
    pub(crate) ends: Option<[(usize, f64); 2]>,
    /// Holds at most one foot of every voxel.
    pub(crate) certified: bool,
}

/// How a piece's feet are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Search {
    /// At most one foot for every voxel: Newton's method on a polynomial of degree 3 (quadratic segments) or 5.
    Newton { cubic: bool },
    /// Nothing is certified, but the piece is so short that one foot of a voxel stands for all: bisection.
    Bracket,
    /// The foot is one point: the end of a curve, for the half space `foot row > 0`, or a corner, for the wedge where
    /// also `second row < 0`.
    Point { is_corner: bool },
}

/// An interval of an axis, or a point, that holds feet of the block's voxels.
///
/// With x a voxel's position, row k of the table is `base[k] + x . slope[k]`, and with eta the foot's parameter in the
/// piece: `u = sum_k row[U + k] eta^k`, v likewise, and the foot is where
/// `0 = row[FOOT] + row[FOOT + 1] eta + row[FOOT + 2] eta^2 + foot[0] eta^3 + ...`.
#[derive(Debug, Clone)]
pub(crate) struct Piece<T> {
    /// Where its feet's voxels are.
    pub(crate) near: Near<T>,
    pub(crate) search: Search,
    /// Where several pieces lie on an interval that has at most one foot of every voxel: they follow each other, and have one
    /// foot's equation.
    pub(crate) shared: Option<Shared<T>>,
    pub(crate) base: [T; ROWS],
    pub(crate) slope: [[T; ROWS]; 3],
    pub(crate) foot: [T; 3],
    /// The polynomials of u, v, height, radius and gain are of degree 3: what is above is too small to matter.
    pub(crate) is_cubic: bool,
    /// Interval of eta that counts.
    pub(crate) range: [T; 2],
    /// A Newton step below this, in eta, has converged.
    pub(crate) tolerance: T,
    /// Height l from the layers' origins.
    pub(crate) height: [T; TERMS],
    /// How the cross-section twists; what it has turned by the layers' origin is in the table.
    pub(crate) twist: Option<Twist<T>>,
    /// Radius in voxels: only read where octaves fade.
    pub(crate) radius: [T; TERMS],
    /// `|q'|^2` where `1 - kappa rho cos = g' / |q'|^2` is needed.
    pub(crate) speed: Option<[T; 5]>,
    /// Whether the focal fade is part of the density.
    pub(crate) is_faded: bool,
    /// Whether the density is divided by `1 - kappa rho cos`.
    pub(crate) is_full: bool,
    /// What the density gains by the deformation, bending apart.
    pub(crate) gain: Option<[T; TERMS]>,
    /// Arc length in voxels, from where the block's pieces of this tube begin: at the layers' origin, and per unit of height.
    pub(crate) arc: [T; 2],
    /// For each end that fades and is near, the distance from it over the length that fades: its value at the layers' origin, and
    /// its change per unit of height.
    pub(crate) axial: [Option<[T; 2]>; 2],
    pub(crate) radial: Radial,
    /// Layers in `Region::layers`.
    pub(crate) layers: [usize; 2],
    /// Some octave fades somewhere in the piece.
    pub(crate) fades: bool,
    /// Some layer is a pattern over the world's coordinates.
    pub(crate) in_world: bool,
}

/// An interval whose feet are sought for all its pieces at once.
#[derive(Debug, Clone)]
pub(crate) struct Shared<T> {
    /// Tells it from others.
    pub(crate) number: u32,
    /// From the interval's eta, which the foot's equation and [`Piece::speed`] are in, to the piece's: a constant and a factor.
    pub(crate) own: [T; 2],
    /// The interval's eta that counts.
    pub(crate) range: [T; 2],
}

#[derive(Debug, Clone)]
pub(crate) struct Twist<T> {
    /// Turns per unit of height.
    pub(crate) rate: T,
    pub(crate) most: Turn,
}

/// How far the cross-section turns either way in all of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turn {
    /// No more than [`SLIGHT`](crate::num::SLIGHT).
    Slight,
    /// No more than an eighth of a turn.
    Gentle,
    Any,
}

#[derive(Debug, Clone)]
pub(crate) struct Layer<T> {
    pub(crate) op: Op,
    pub(crate) kind: LayerKind<T>,
    pub(crate) threshold: Option<T>,
    pub(crate) multiplier: T,
}

#[derive(Debug, Clone)]
pub(crate) enum LayerKind<T> {
    Constant(T),
    Sectors,
    Perlin {
        /// Sums in `Region::sums`: the last is the pattern, those before it displace its coordinates.
        sums: [usize; 2],
        /// Over the world's coordinates, in voxels from the block's centre.
        in_world: bool,
    },
}

/// A fractal sum.
#[derive(Debug, Clone)]
pub(crate) struct Sum<T> {
    /// Octaves in `Region::octaves`.
    pub(crate) octaves: [usize; 2],
    /// Those of them, by their places among them, that fade within the piece: they follow each other, since frequencies rise or
    /// fall.
    pub(crate) fading: [usize; 2],
    /// So many octaves are summed at all voxels; those after them where the sum so far is at least `least`. Elsewhere it stays
    /// below the layer's threshold, whatever they add.
    pub(crate) first: usize,
    pub(crate) least: T,
    /// Squares of first-octave cells per voxel: across at radius 1 voxel; along; by twist at the surface.
    pub(crate) rates: [T; 3],
    /// What the octaves that are left out add.
    pub(crate) mean: T,
    /// All octaves are plain ([`noise::Octave::is_plain`]).
    pub(crate) is_plain: bool,
    /// The coordinate that it displaces for the last sum, and by how much where it is 1; `None` for that one.
    pub(crate) displaces: Option<(usize, T)>,
    /// Which of its own coordinates are displaced.
    pub(crate) displaced: [bool; 3],
}

#[derive(Debug, Clone)]
pub(crate) struct Octave<T> {
    pub(crate) octave: noise::Octave<T>,
    /// Whether its weight is not 1 all over the piece.
    pub(crate) fades: bool,
    /// Half of the square of its frequency over the first octave's.
    pub(crate) finer: T,
    /// How many of the sum's octaves fade before it.
    pub(crate) number: usize,
}

/// Rounds an array.
pub(crate) fn round<T: Scalar, const N: usize>(values: [f64; N]) -> [T; N] {
    values.map(T::from_f64)
}
