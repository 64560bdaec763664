//! Products in tiles of rows and vectors. The forms supply the vectors' instructions.
#![allow(
    unsafe_code,
    reason = "raw reads and writes; `Work::each_tile` proves the extents that tiles rely on"
)]

use super::{Add, Finish, Left, PANEL, Packed, Target, Words};

/// Vectors side by side in a tile.
const VECTORS: usize = 2;

/// Vectors of one width. Every function needs the instructions of its form.
pub(super) trait Lanes {
    /// f32.
    type Sums: Copy;
    /// Words of 32 bits.
    type Words: Copy;
    /// Values of a vector.
    const LANES: usize;

    unsafe fn zero() -> Self::Sums;
    unsafe fn splat(word: u32) -> Self::Words;
    /// Reads a whole vector.
    unsafe fn words(at: *const u32) -> Self::Words;
    /// Reads the first `count` values, or as many as there are lanes; the others are zero.
    unsafe fn load(at: *const f32, count: usize) -> Self::Sums;
    /// Writes the first `count` values, or as many as there are lanes.
    unsafe fn store(at: *mut f32, count: usize, v: Self::Sums);
    unsafe fn add(a: Self::Sums, b: Self::Sums) -> Self::Sums;
    /// Zero where `v` is negative.
    unsafe fn relu(v: Self::Sums) -> Self::Sums;
    /// Zero where `mask` is not positive.
    unsafe fn keep(v: Self::Sums, mask: Self::Sums) -> Self::Sums;
}

/// How the words of a step are multiplied.
pub(super) trait Step<L: Lanes> {
    /// # Safety
    /// Needs the instructions of the form.
    unsafe fn accumulate(sum: L::Sums, a: L::Words, b: L::Words) -> L::Sums;
}

/// A product in raw form.
pub(super) struct Work<'a> {
    out: *mut f32,
    rows: usize,
    cols: usize,
    steps: usize,
    left: *const u32,
    row_stride: usize,
    step_stride: usize,
    right: &'a [u32],
    add: *const f32,
    finish: Finish<'a>,
}

/// Where a tile lies, within the memory of its product.
#[derive(Clone, Copy)]
pub(super) struct Tile {
    /// Rows of the tile.
    pub rows: usize,
    row: usize,
    col: usize,
    /// The first step's words.
    right: *const u32,
}

impl<'a> Work<'a> {
    /// `target = left right`, finished; its extents agree.
    pub(super) fn new(target: &'a mut Target<'_>, left: &'a Left<'_>, right: &'a Packed) -> Self {
        let (rows, cols, steps) = (left.rows, target.cols, right.steps);
        assert!(
            rows == 0
                || steps == 0
                || (rows - 1) * left.row_stride + (steps - 1) * left.step_stride < left.len(),
            "the left factor is too short"
        );
        assert!(cols.div_ceil(PANEL) * steps * PANEL <= right.words.len(), "the right factor is too short");
        assert!(target.out.len() == rows * cols, "the output has another extent");
        let dense = |m: Option<&[f32]>, len: usize| m.is_none_or(|m| m.len() == len);
        let finish = target.finish;
        let other = if let Add::Other(m) = finish.add { Some(m) } else { None };
        assert!(
            dense(other, rows * cols) && dense(finish.mask, rows * cols) && dense(finish.bias, cols),
            "a finish of another extent"
        );
        let out = target.out.as_mut_ptr();
        Self {
            out,
            rows,
            cols,
            steps,
            left: match left.words {
                Words::Single(values) => values.as_ptr().cast(),
                Words::Pairs(words) => words.as_ptr(),
            },
            row_stride: left.row_stride,
            step_stride: left.step_stride,
            right: &right.words,
            add: match finish.add {
                Add::Nothing => std::ptr::null(),
                Add::Output => out,
                Add::Other(other) => other.as_ptr(),
            },
            finish,
        }
    }

    /// Hands over tiles of up to `rows` rows and two vectors of `lanes` values that cover the product.
    pub(super) fn each_tile(&self, rows: usize, lanes: usize, mut tile: impl FnMut(Tile)) {
        let width = VECTORS * lanes;
        assert!(PANEL.is_multiple_of(width), "tiles across panels");
        for col in (0..self.cols).step_by(width) {
            let panel = &self.right[col / PANEL * self.steps * PANEL..][..self.steps * PANEL];
            // Without a step there is nothing to read.
            let right = panel.get(col % PANEL..).unwrap_or_default().as_ptr();
            for row in (0..self.rows).step_by(rows) {
                tile(Tile { rows: rows.min(self.rows - row), row, col, right });
            }
        }
    }

    /// A tile of `M` rows.
    ///
    /// # Safety
    /// Needs the instructions of the form; the tile must be one of [`Work::each_tile`] for as many lanes, with `M`
    /// rows.
    #[inline(always)]
    pub(super) unsafe fn tile<L: Lanes, S: Step<L>, const M: usize>(&self, tile: Tile) {
        // SAFETY: `Work::new` compared the extents: every row and step of the tile lies within the left factor,
        // and every step has `PANEL` words within its panel, from the tile's column on two vectors.
        unsafe {
            let mut sums = [[L::zero(); VECTORS]; M];
            let mut left = self.left.wrapping_add(tile.row * self.row_stride);
            let mut right = tile.right;
            for _ in 0..self.steps {
                let b: [L::Words; VECTORS] = [L::words(right), L::words(right.add(L::LANES))];
                for i in 0..M {
                    let a = L::splat(*left.add(i * self.row_stride));
                    sums[i][0] = S::accumulate(sums[i][0], a, b[0]);
                    sums[i][1] = S::accumulate(sums[i][1], a, b[1]);
                }
                left = left.wrapping_add(self.step_stride);
                right = right.wrapping_add(PANEL);
            }
            self.finish::<L, M>(tile, sums);
        }
    }

    /// # Safety
    /// As [`Work::tile`].
    #[inline(always)]
    unsafe fn finish<L: Lanes, const M: usize>(&self, tile: Tile, mut sums: [[L::Sums; VECTORS]; M]) {
        let Tile { row, col, .. } = tile;
        // Values past the last column are neither read nor written.
        let counts: [usize; VECTORS] = std::array::from_fn(|v| self.cols.saturating_sub(col + v * L::LANES));
        let at = |i: usize, v: usize| (row + i) * self.cols + col + v * L::LANES;
        // SAFETY: the output and the finish have these rows, and as many columns as are counted.
        unsafe {
            if !self.add.is_null() {
                for i in 0..M {
                    for v in 0..VECTORS {
                        let summand = L::load(self.add.wrapping_add(at(i, v)), counts[v]);
                        sums[i][v] = L::add(sums[i][v], summand);
                    }
                }
            }
            if let Some(bias) = self.finish.bias {
                for v in 0..VECTORS {
                    let bias = L::load(bias.as_ptr().wrapping_add(col + v * L::LANES), counts[v]);
                    for i in 0..M {
                        sums[i][v] = L::add(sums[i][v], bias);
                    }
                }
            }
            if self.finish.relu {
                for i in 0..M {
                    for v in 0..VECTORS {
                        sums[i][v] = L::relu(sums[i][v]);
                    }
                }
            }
            if let Some(mask) = self.finish.mask {
                for i in 0..M {
                    for v in 0..VECTORS {
                        let mask = L::load(mask.as_ptr().wrapping_add(at(i, v)), counts[v]);
                        sums[i][v] = L::keep(sums[i][v], mask);
                    }
                }
            }
            for i in 0..M {
                for v in 0..VECTORS {
                    L::store(self.out.wrapping_add(at(i, v)), counts[v], sums[i][v]);
                }
            }
        }
    }
}
