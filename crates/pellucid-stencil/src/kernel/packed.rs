//! Counts of five materials packed in one word, and sums of such words: the plain form.
//!
//! A cell of at most 4096 eighths fits one word, although five counts up to 4096 take 65 bits:
//! materials 1 to 4 have 13 bits each, the fifth the top 12, and is added to the fields of the
//! first two as well. Only a cell full of the fifth overflows its own field, and only that cell
//! shows 4096 in both of the others.

use pellucid_voxel::sat::tables::LANES;

use super::Sums;
use crate::StencilSpec;

/// Bits of each of the first four materials.
pub(crate) const FIELD: u32 = 13;
/// Largest count of a cell that the packing holds.
pub(crate) const MAX_COUNT: u32 = 4096;

/// One eighth of a voxel of each material.
pub(crate) const UNITS: [u64; LANES] =
    [1, 1 << FIELD, 1 << (2 * FIELD), 1 << (3 * FIELD), 1 << (4 * FIELD) | 1 << FIELD | 1];

/// The counts of a packed cell.
#[inline(always)]
pub(crate) fn unpack(word: u64) -> Sums {
    const MASK: u64 = (1 << FIELD) - 1;
    let (a, b) = (word & MASK, word >> FIELD & MASK);
    let last = word >> (4 * FIELD) | (a & b & u64::from(MAX_COUNT));
    let (c, d) = (word >> (2 * FIELD) & MASK, word >> (3 * FIELD) & MASK);
    [(a - last) as u32, (b - last) as u32, c as u32, d as u32, last as u32, 0, 0, 0]
}

/// Sums of `units` of the labels over 2 x 2 x 2 voxels, then over all entries up to each one along
/// every axis. `pair` is scratch.
#[inline(always)]
pub(crate) fn sum_labels(
    size: [usize; 3],
    labels: &[u8],
    units: &[u64; 256],
    pair: &mut Vec<u64>,
    sums: &mut [u64],
) {
    let [wx, wy, _] = size;
    let layer = wx * wy;
    // Sums over pairs along y of the layer before, and along x of the row in hand.
    pair.clear();
    pair.resize(layer + 3 * wx, 0);
    let (before, rows) = pair.split_at_mut(layer);
    let (last, rest) = rows.split_at_mut(wx);
    let (row, total) = rest.split_at_mut(wx);
    for (z, labels) in labels.chunks_exact(layer).enumerate() {
        last.fill(0);
        total.fill(0);
        let (done, open) = sums.split_at_mut(z * layer);
        let prior = if z > 0 { &done[(z - 1) * layer..] } else { &[] };
        for y in 0..wy {
            let labels = &labels[y * wx..(y + 1) * wx];
            let before = &mut before[y * wx..(y + 1) * wx];
            let out = &mut open[y * wx..(y + 1) * wx];
            for x in 0..wx {
                row[x] = units[usize::from(labels[x])];
            }
            // Over four rows of voxels.
            for x in 0..wx {
                let here = last[x].wrapping_add(row[x]);
                last[x] = row[x];
                row[x] = here.wrapping_add(before[x]);
                before[x] = here;
            }
            let (mut run, mut left) = (0u64, 0u64);
            for x in 0..wx {
                run = run.wrapping_add(left).wrapping_add(row[x]);
                left = row[x];
                total[x] = total[x].wrapping_add(run);
            }
            match prior.get(y * wx..(y + 1) * wx) {
                Some(prior) => {
                    for x in 0..wx {
                        out[x] = total[x].wrapping_add(prior[x]);
                    }
                }
                None => out.copy_from_slice(total),
            }
        }
    }
}

/// Packed cell counts from packed corner sums, the first corner at `sums[0]`.
#[inline(always)]
pub(crate) fn cells_between(n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [u64]) {
    const MOST: usize = StencilSpec::MAX_CELLS;
    let [nx, ny, nz] = n;
    let mut columns = [0u64; MOST * MOST];
    let (mut near, mut far) = ([0u64; MOST], [0u64; MOST]);
    for k in 0..=nz {
        for j in 0..=ny {
            let row = &sums[k * strides[2] + j * strides[1]..][..nx * strides[0] + 1];
            let mut last = row[0];
            for (far, corner) in far[..nx].iter_mut().zip(row[strides[0]..].iter().step_by(strides[0])) {
                *far = corner.wrapping_sub(last);
                last = *corner;
            }
            if j > 0 {
                let at = (j - 1) * nx;
                for (i, column) in columns[at..at + nx].iter_mut().enumerate() {
                    let new = far[i].wrapping_sub(near[i]);
                    if k > 0 {
                        cells[(k - 1) * nx * ny + at + i] = new.wrapping_sub(*column);
                    }
                    *column = new;
                }
            }
            near = far;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn packing_holds_every_cell(counts in prop::array::uniform5(0u32..=MAX_COUNT), full in 0usize..6) {
            let mut counts = counts;
            // Cut down to what fits one cell, or one material alone.
            let mut left = MAX_COUNT;
            for (m, n) in counts.iter_mut().enumerate() {
                *n = if full == m { left } else if full < 5 { 0 } else { (*n).min(left) };
                left -= *n;
            }
            let word = counts.iter().zip(UNITS).fold(0u64, |w, (&n, u)| w.wrapping_add(u.wrapping_mul(n.into())));
            prop_assert_eq!(&unpack(word)[..LANES], &counts[..]);
        }
    }
}
