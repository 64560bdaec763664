//! The products in plain Rust, in tiles that compilers turn into vectors.

use super::{Add, Left, PANEL, Packed, Target, Words};

/// Rows and columns of a tile: their sums fit the sixteen vector registers that every x86-64 has.
const ROWS: usize = 4;
const COLS: usize = 8;

type Sums<const M: usize> = [[f32; COLS]; M];

pub(super) fn product(target: Target<'_>, left: Left<'_>, right: &Packed) {
    match left.words {
        Words::Single(values) => tiles::<Single>(target, left, values, right),
        Words::Pairs(words) => tiles::<Pairs>(target, left, words, right),
    }
}

/// How a step's words are multiplied.
trait Step {
    /// A word of the left factor.
    type Word: Copy;
    /// Adds the products of one word with a row of a tile.
    fn accumulate(sums: &mut [f32; COLS], a: Self::Word, row: &[u32; COLS]);
}

/// Words are f32.
struct Single;

impl Step for Single {
    type Word = f32;

    #[inline(always)]
    fn accumulate(sums: &mut [f32; COLS], a: f32, row: &[u32; COLS]) {
        for j in 0..COLS {
            sums[j] += a * f32::from_bits(row[j]);
        }
    }
}

/// Words are pairs of bf16.
struct Pairs;

impl Step for Pairs {
    type Word = u32;

    #[inline(always)]
    fn accumulate(sums: &mut [f32; COLS], a: u32, row: &[u32; COLS]) {
        let [a0, a1] = halves(a);
        for j in 0..COLS {
            let [b0, b1] = halves(row[j]);
            sums[j] += a0 * b0 + a1 * b1;
        }
    }
}

/// The two values of a pair of bf16.
#[inline(always)]
fn halves(word: u32) -> [f32; 2] {
    [f32::from_bits(word << 16), f32::from_bits(word & 0xffff_0000)]
}

fn tiles<S: Step>(mut target: Target<'_>, left: Left<'_>, values: &[S::Word], right: &Packed) {
    let steps = right.steps;
    for first in (0..target.cols).step_by(COLS) {
        let panel = &right.words[first / PANEL * steps * PANEL..][..steps * PANEL];
        let column = first % PANEL / COLS;
        for row in (0..left.rows).step_by(ROWS) {
            let target = &mut target;
            match left.rows - row {
                1 => tile::<S, 1>(target, &left, values, panel, [row, first, column]),
                2 => tile::<S, 2>(target, &left, values, panel, [row, first, column]),
                3 => tile::<S, 3>(target, &left, values, panel, [row, first, column]),
                _ => tile::<S, ROWS>(target, &left, values, panel, [row, first, column]),
            }
        }
    }
}

/// `M` rows from `row` on, of the columns from `first` on, which are block `column` of a panel's row.
#[inline(always)]
fn tile<S: Step, const M: usize>(
    target: &mut Target<'_>,
    left: &Left<'_>,
    values: &[S::Word],
    panel: &[u32],
    [row, first, column]: [usize; 3],
) {
    let mut sums: Sums<M> = [[0.0; COLS]; M];
    let blocks = panel.as_chunks::<COLS>().0;
    for (step, words) in blocks.iter().skip(column).step_by(PANEL / COLS).enumerate() {
        let at = row * left.row_stride + step * left.step_stride;
        for i in 0..M {
            S::accumulate(&mut sums[i], values[at + i * left.row_stride], words);
        }
    }
    for (i, sums) in sums.iter().enumerate() {
        finish(target, row + i, first, sums);
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
