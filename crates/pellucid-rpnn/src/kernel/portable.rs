//! The products in plain Rust, in tiles that compilers turn into vectors.

use super::{Add, Left, PANEL, Packed, Target, Words};

/// Rows and columns of a tile.
const ROWS: usize = 4;
const COLS: usize = 8;

/// The two values of a pair of bf16.
#[inline(always)]
fn halves(word: u32) -> [f32; 2] {
    [f32::from_bits(word << 16), f32::from_bits(word & 0xffff_0000)]
}

#[inline(always)]
pub(super) fn product(mut target: Target<'_>, left: Left<'_>, right: &Packed) {
    let steps = right.steps;
    for first in (0..target.cols).step_by(COLS) {
        let panel = &right.words[first / PANEL * steps * PANEL..][..steps * PANEL];
        let at = first % PANEL;
        for row in (0..left.rows).step_by(ROWS) {
            let rows = ROWS.min(left.rows - row);
            let mut sums = [[0.0f32; COLS]; ROWS];
            for (step, words) in panel.chunks_exact(PANEL).enumerate() {
                let words = &words[at..at + COLS];
                for (i, sums) in sums.iter_mut().enumerate().take(rows) {
                    let at = (row + i) * left.row_stride + step * left.step_stride;
                    match left.words {
                        Words::Single(values) => {
                            let a = values[at];
                            sums.iter_mut().zip(words).for_each(|(s, b)| *s += a * f32::from_bits(*b));
                        }
                        Words::Pairs(values) => {
                            let [a0, a1] = halves(values[at]);
                            for (s, b) in sums.iter_mut().zip(words) {
                                let [b0, b1] = halves(*b);
                                *s += a0 * b0 + a1 * b1;
                            }
                        }
                    }
                }
            }
            for (i, sums) in sums.iter().enumerate().take(rows) {
                finish(&mut target, row + i, first, sums);
            }
        }
    }
}

#[inline(always)]
fn finish(target: &mut Target<'_>, row: usize, first: usize, sums: &[f32; COLS]) {
    let f = target.finish;
    for (j, &sum) in sums.iter().enumerate().take(target.cols - first) {
        let at = row * target.cols + first + j;
        let mut v = sum
            + match f.add {
                Add::Nothing => 0.0,
                Add::Output => target.out[at],
                Add::Other(other) => other[at],
            };
        if let Some(bias) = f.bias {
            v += bias[first + j];
        }
        if f.relu {
            v = v.max(0.0);
        }
        if f.mask.is_some_and(|mask| mask[at] <= 0.0) {
            v = 0.0;
        }
        target.out[at] = v;
    }
}
