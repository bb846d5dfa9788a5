//! Which bricks are seen in which part of a picture.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::camera::Camera;
use super::grid::{Bricks, EDGE, Grid};

/// Pixels along an edge of a tile.
pub(super) const TILE: usize = 32;

/// A brick as a tile sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Its number among the medium's bricks.
    pub(super) brick: u32,
    /// Of its pixels, counted from the tile's own: first and last column, first and last row.
    pub(super) columns: [u8; 2],
    pub(super) rows: [u8; 2],
}

/// A picture's tiles, each with the bricks that its rays may meet, in an order in which every ray meets them.
///
/// Along a ray every coordinate of the brick that it is in changes to one side only. So from an eye, the number of steps
/// from brick to brick, by faces, that a brick is away grows along every ray: bricks are in the order of that number. Of
/// parallel rays it is counted from afar.
pub(super) struct Tiles {
    /// Pixels.
    pub(super) size: [usize; 2],
    /// Tiles in a row.
    pub(super) columns: usize,
    /// Where each tile's bricks begin in `seen`; one more for the end.
    starts: Vec<usize>,
    seen: Vec<Seen>,
}

impl Tiles {
    pub(super) fn new(camera: &Camera, size: [usize; 2], grid: &Grid, bricks: &Bricks) -> Tiles {
        let [columns, rows] = size.map(|pixels| pixels.div_ceil(TILE));
        let view = View::new(camera, size, grid);
        let found: Vec<(u32, u64, [[usize; 2]; 2])> = bricks
            .blocks
            .par_iter()
            .enumerate()
            .filter_map(|(number, block)| {
                Some((u32::try_from(number).ok()?, view.steps(*block), view.pixels(*block)?))
            })
            .collect();
        let mut order: Vec<u32> = (0..).take(found.len()).collect();
        order.par_sort_by_key(|at| found[*at as usize].1);
        let mut counts = vec![0; columns * rows + 1];
        let tiles = |[first, last]: [usize; 2]| first / TILE..=last / TILE;
        for (_, _, pixels) in &found {
            for row in tiles(pixels[1]) {
                for column in tiles(pixels[0]) {
                    counts[row * columns + column + 1] += 1;
                }
            }
        }
        for tile in 1..counts.len() {
            counts[tile] += counts[tile - 1];
        }
        let starts = counts;
        let mut next = starts.clone();
        let nothing = Seen { brick: 0, columns: [0; 2], rows: [0; 2] };
        let mut seen = vec![nothing; starts.last().copied().unwrap_or(0)];
        for at in order {
            let (brick, _, pixels) = found[at as usize];
            let within = |[first, last]: [usize; 2], tile: usize| {
                [first.saturating_sub(tile * TILE), last - tile * TILE].map(|pixel| byte(pixel.min(TILE - 1)))
            };
            for row in tiles(pixels[1]) {
                for column in tiles(pixels[0]) {
                    let place = &mut next[row * columns + column];
                    seen[*place] =
                        Seen { brick, columns: within(pixels[0], column), rows: within(pixels[1], row) };
                    *place += 1;
                }
            }
        }
        Tiles { size, columns, starts, seen }
    }

    /// Bytes that they take while they are found, of so many bricks, and then.
    pub(super) fn bytes(&self, bricks: usize) -> [u64; 2] {
        /// What is known of a brick: in a list of each thread, and of all.
        const FOUND: usize = 2 * size_of::<(u32, u64, [[usize; 2]; 2])>() + 2 * size_of::<u32>();
        let kept = size_of_val(self.seen.as_slice()) + 2 * size_of_val(self.starts.as_slice());
        [kept + FOUND * bricks, kept].map(|bytes| bytes as u64)
    }

    pub(super) fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// The bricks that a tile sees, in order.
    pub(super) fn seen(&self, tile: usize) -> &[Seen] {
        &self.seen[self.starts[tile]..self.starts[tile + 1]]
    }

    /// The first pixel of a tile.
    pub(super) fn corner(&self, tile: usize) -> [usize; 2] {
        [tile % self.columns * TILE, tile / self.columns * TILE]
    }
}

#[allow(clippy::cast_possible_truncation, reason = "below the edge of a tile")]
fn byte(pixel: usize) -> u8 {
    pixel as u8
}

/// A camera as the grid's space sees it.
struct View {
    size: [usize; 2],
    is_orthographic: bool,
    /// In units of bricks; of an orthographic camera the direction in which it looks.
    eye: DVec3,
    /// Right, up and forward in pictures' halves, for a point in cells: dot product, and what is added.
    rows: [(DVec3, f64); 3],
    /// Points nearer than this to the eye's plane are not projected.
    near: f64,
}

impl View {
    fn new(camera: &Camera, size: [usize; 2], grid: &Grid) -> View {
        let row = |axis: DVec3, half: f64| {
            let axis = axis / half;
            // Steps on their own: far from the grid's origin their differences would be those of rounding.
            let step = |cell: DVec3| axis.dot(grid.step_to_world(cell));
            let zero = axis.dot(grid.to_world(DVec3::ZERO) - camera.eye);
            (DVec3::new(step(DVec3::X), step(DVec3::Y), step(DVec3::Z)), zero)
        };
        let eye = if camera.is_orthographic {
            grid.to_grid(camera.eye + camera.forward) - grid.to_grid(camera.eye)
        } else {
            grid.to_grid(camera.eye) / f64::from(EDGE)
        };
        View {
            size,
            is_orthographic: camera.is_orthographic,
            eye,
            rows: [row(camera.right, camera.half.x), row(camera.up, camera.half.y), row(camera.forward, 1.0)],
            near: 1e-6 * grid.cell(),
        }
    }

    /// See [`Tiles`].
    fn steps(&self, block: [i32; 3]) -> u64 {
        let mut steps = 0;
        for axis in 0..3 {
            let at = i64::from(block[axis]);
            steps += if self.is_orthographic {
                let far = if self.eye[axis] >= 0.0 { at } else { -at };
                (far + (1 << 32)).unsigned_abs()
            } else {
                #[allow(clippy::cast_possible_truncation, reason = "saturates, far beyond all bricks")]
                let eye = self.eye[axis].floor().clamp(-1e12, 1e12) as i64;
                (at - eye).unsigned_abs()
            };
        }
        steps
    }

    /// First and last column, first and last row of the pixels that may see a brick.
    fn pixels(&self, block: [i32; 3]) -> Option<[[usize; 2]; 2]> {
        let edge = f64::from(EDGE);
        let corner = DVec3::from(block.map(|c| f64::from(c) * edge));
        let [x, y, z] = self.rows.map(|(axis, zero)| {
            let first = axis.dot(corner) + zero;
            let steps = axis * edge;
            std::array::from_fn::<f64, 8, _>(|n| {
                let step = |bit: usize, by: f64| if n >> bit & 1 == 1 { by } else { 0.0 };
                first + step(2, steps.x) + step(1, steps.y) + step(0, steps.z)
            })
        });
        let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        let mut grow = |x: f64, y: f64, z: f64| {
            let place = if self.is_orthographic { DVec2::new(x, y) } else { DVec2::new(x, y) / z };
            bounds = [bounds[0].min(place), bounds[1].max(place)];
        };
        for n in 0..8 {
            if self.is_orthographic || z[n] >= self.near {
                grow(x[n], y[n], z[n]);
                continue;
            }
            // The edges that leave the corner behind the eye.
            for bit in 0..3 {
                let other = n ^ (1 << bit);
                if z[other] > self.near {
                    let t = (self.near - z[n]) / (z[other] - z[n]);
                    grow(x[n] + t * (x[other] - x[n]), y[n] + t * (y[other] - y[n]), self.near);
                }
            }
        }
        let [width, height] = self.size;
        let columns = range(bounds[0].x, bounds[1].x, width)?;
        // Rows are counted from the top.
        let rows = range(-bounds[1].y, -bounds[0].y, height)?;
        Some([columns, rows])
    }
}

/// The pixels, first and last, of what is seen from `low` to `high`, where the picture is from -1 to 1.
fn range(low: f64, high: f64, pixels: usize) -> Option<[usize; 2]> {
    #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
    let place = |x: f64| 0.5 * (x + 1.0) * pixels as f64;
    // Where rounding could tell a ray beside the brick from one that just meets it, it counts.
    let (low, high) = (place(low) - 1e-3, place(high) + 1e-3);
    #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
    if !(high >= 0.0 && low < pixels as f64) {
        return None;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
    let [first, last] = [low.max(0.0) as usize, high as usize];
    Some([first, last.min(pixels - 1)])
}
