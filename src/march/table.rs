//! Values at the corners of a cube's cells, and between them.

use super::rays::LANES;
use crate::num::Real;

/// N^3 values, z fastest.
pub(super) struct Table<'a, const N: usize>(pub(super) &'a [f32]);

/// The eight values around each lane's place: bit 2 of the number is along x, bit 1 along y, bit 0 along z.
pub(super) struct Corners<R>(pub(super) [R; 8]);

impl<const N: usize> Table<'_, N> {
    /// The values around cells, whose coordinates are whole and from 0 to N - 2.
    #[inline(always)]
    pub(super) fn corners<R: Real<Scalar = f32>>(&self, token: R::Token, cell: [R; 3]) -> Corners<R> {
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let edge = R::splat(token, N as f32);
        let mut places = [0.0_f32; LANES];
        ((cell[0] * edge + cell[1]) * edge + cell[2]).store(&mut places);
        let mut lanes = [[0.0_f32; LANES]; 8];
        for lane in 0..LANES {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, at least 0")]
            let place = places[lane] as usize;
            let values = &self.0[place..place + N * N + N + 2];
            lanes[0][lane] = values[0];
            lanes[1][lane] = values[1];
            lanes[2][lane] = values[N];
            lanes[3][lane] = values[N + 1];
            lanes[4][lane] = values[N * N];
            lanes[5][lane] = values[N * N + 1];
            lanes[6][lane] = values[N * N + N];
            lanes[7][lane] = values[N * N + N + 1];
        }
        Corners([
            R::load(token, &lanes[0]),
            R::load(token, &lanes[1]),
            R::load(token, &lanes[2]),
            R::load(token, &lanes[3]),
            R::load(token, &lanes[4]),
            R::load(token, &lanes[5]),
            R::load(token, &lanes[6]),
            R::load(token, &lanes[7]),
        ])
    }

    /// The cells that hold places, in the units of cells; places beyond the cube are taken to its edge cells.
    #[inline(always)]
    pub(super) fn cell<R: Real<Scalar = f32>>(token: R::Token, place: [R; 3]) -> [R; 3] {
        let zero = R::constant(token, 0.0);
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let last = R::splat(token, (N - 2) as f32);
        [
            place[0].floor().within(zero, last),
            place[1].floor().within(zero, last),
            place[2].floor().within(zero, last),
        ]
    }
}

impl<R: Real<Scalar = f32>> Corners<R> {
    /// The value at a place within the cell, each coordinate from 0 to 1.
    #[inline(always)]
    pub(super) fn at(&self, [x, y, z]: [R; 3]) -> R {
        let c = &self.0;
        let a = c[0] + (c[1] - c[0]) * z;
        let b = c[2] + (c[3] - c[2]) * z;
        let d = c[4] + (c[5] - c[4]) * z;
        let e = c[6] + (c[7] - c[6]) * z;
        let near = a + (b - a) * y;
        let far = d + (e - d) * y;
        near + (far - near) * x
    }
}

/// The value at a place of a table, linear along each axis.
#[inline(always)]
pub(super) fn trilinear<R: Real<Scalar = f32>, const N: usize>(
    token: R::Token,
    table: &Table<'_, N>,
    place: [R; 3],
) -> R {
    let cell = Table::<N>::cell(token, place);
    let corners = table.corners(token, cell);
    corners.at([place[0] - cell[0], place[1] - cell[1], place[2] - cell[2]])
}
