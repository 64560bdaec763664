//! Matrices as the kernel reads them. Written so that it vectorises in whichever form it is inlined into.

use super::{Left, PANEL, Packed, Words};
use crate::Precision;

/// A read-only matrix, row-major or transposed.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    data: &'a [f32],
    /// Extents and stride of the matrix as it lies in memory.
    rows: usize,
    cols: usize,
    transposed: bool,
}

impl<'a> Matrix<'a> {
    /// Dense rows of `cols` values.
    pub(crate) fn rows(data: &'a [f32], rows: usize, cols: usize) -> Self {
        assert_eq!(data.len(), rows * cols, "a matrix of another extent");
        Self { data, rows, cols, transposed: false }
    }

    /// The transposed view.
    pub(crate) fn t(self) -> Self {
        Self { transposed: !self.transposed, ..self }
    }

    /// Rows and columns.
    pub(super) fn shape(&self) -> (usize, usize) {
        if self.transposed { (self.cols, self.rows) } else { (self.rows, self.cols) }
    }

    pub(super) fn is_transposed(&self) -> bool {
        self.transposed
    }

    /// The values themselves as a left factor.
    pub(super) fn as_left(self) -> Left<'a> {
        let (row_stride, step_stride) = if self.transposed { (1, self.cols) } else { (self.cols, 1) };
        Left { words: Words::Single(self.data), rows: self.shape().0, row_stride, step_stride }
    }
}

/// The bf16 nearest to a value, ties to even, in the low half.
#[inline(always)]
fn bf16(v: f32) -> u32 {
    let bits = v.to_bits();
    (bits + 0x7fff + (bits >> 16 & 1)) >> 16
}

/// Two bf16 of successive steps, the first in the low half.
#[inline(always)]
fn pair(first: f32, second: f32) -> u32 {
    bf16(first) | bf16(second) << 16
}

/// Fills a packed right factor whose extents are set.
#[inline(always)]
pub(super) fn pack_right(right: Matrix<'_>, packed: &mut Packed) {
    let (steps, cols, inner) = (packed.steps, packed.cols, packed.rows);
    if steps == 0 {
        return;
    }
    let half = packed.precision == Precision::Bf16;
    for (p, panel) in packed.words.chunks_exact_mut(steps * PANEL).enumerate() {
        let first = p * PANEL;
        let used = PANEL.min(cols - first);
        if used < PANEL {
            panel.fill(0);
        }
        if right.transposed {
            // Column j of the factor is a dense row in memory.
            for j in 0..used {
                let row = &right.data[(first + j) * inner..(first + j + 1) * inner];
                if half {
                    let (pairs, rest) = row.as_chunks::<2>();
                    for (step, v) in pairs.iter().enumerate() {
                        panel[step * PANEL + j] = pair(v[0], v[1]);
                    }
                    if let [last] = rest {
                        panel[(steps - 1) * PANEL + j] = bf16(*last);
                    }
                } else {
                    for (step, v) in row.iter().enumerate() {
                        panel[step * PANEL + j] = v.to_bits();
                    }
                }
            }
        } else {
            for (step, words) in panel.chunks_exact_mut(PANEL).enumerate() {
                let row = |k: usize| &right.data[k * cols + first..k * cols + first + used];
                if !half {
                    words.iter_mut().zip(row(step)).for_each(|(w, v)| *w = v.to_bits());
                } else if 2 * step + 1 < inner {
                    for ((w, a), b) in words.iter_mut().zip(row(2 * step)).zip(row(2 * step + 1)) {
                        *w = pair(*a, *b);
                    }
                } else {
                    words.iter_mut().zip(row(2 * step)).for_each(|(w, v)| *w = bf16(*v));
                }
            }
        }
    }
}

/// Rounds a left factor to pairs of bf16: rows of steps, or steps of rows when it is transposed.
#[inline(always)]
pub(super) fn pack_left(left: Matrix<'_>, words: &mut [u32]) {
    let width = left.cols;
    if width == 0 {
        return;
    }
    if left.transposed {
        for (words, rows) in words.chunks_exact_mut(width).zip(left.data.chunks(2 * width)) {
            let (a, b) = rows.split_at(width);
            if b.is_empty() {
                words.iter_mut().zip(a).for_each(|(w, a)| *w = bf16(*a));
            } else {
                words.iter_mut().zip(a).zip(b).for_each(|((w, a), b)| *w = pair(*a, *b));
            }
        }
    } else if width.is_multiple_of(2) {
        let pairs = left.data.as_chunks::<2>().0;
        words.iter_mut().zip(pairs).for_each(|(w, v)| *w = pair(v[0], v[1]));
    } else {
        for (words, row) in words.chunks_exact_mut(width.div_ceil(2)).zip(left.data.chunks_exact(width)) {
            let (pairs, rest) = row.as_chunks::<2>();
            words.iter_mut().zip(pairs).for_each(|(w, v)| *w = pair(v[0], v[1]));
            if let ([last], Some(w)) = (rest, words.last_mut()) {
                *w = bf16(*last);
            }
        }
    }
}

/// Adds the sum of the rows of `values` to `sums`.
#[inline(always)]
pub(super) fn add_rows(values: &[f32], sums: &mut [f32]) {
    for row in values.chunks_exact(sums.len()) {
        sums.iter_mut().zip(row).for_each(|(s, v)| *s += v);
    }
}
