//! The part of an error that neighbours share.

use std::collections::BTreeMap;

use pellucid_core::Control;
use rayon::prelude::*;

use crate::PredictError;

/// Cells to either side that a cell's error is smoothed over: three standard deviations.
const REACH: i32 = 3;
/// Weight of a prior without error, in measurements: places with few of them are hardly corrected.
const PRIOR: f64 = 4.0;
/// Cells of less weight are forgotten.
const LEAST: f64 = 1e-3;

/// Errors summed in cubic cells whose edge is the radius of smoothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Field {
    /// Weight and sums by channel of each cell that has any.
    pub(super) cells: BTreeMap<[i32; 3], (f64, Vec<f64>)>,
}

impl Field {
    /// `self * memory + new`.
    pub(super) fn absorb(&mut self, memory: f64, new: &Self) {
        self.cells.retain(|_, (weight, sums)| {
            *weight *= memory;
            sums.iter_mut().for_each(|s| *s *= memory);
            *weight > LEAST
        });
        for (cell, (weight, sums)) in &new.cells {
            let (own, own_sums) = self.cells.entry(*cell).or_insert_with(|| (0.0, vec![0.0; sums.len()]));
            *own += weight;
            own_sums.iter_mut().zip(sums).for_each(|(s, n)| *s += n);
        }
    }

    pub(super) fn add(&mut self, at: [f64; 3], radius: f64, errors: impl ExactSizeIterator<Item = f64>) {
        let cell = at.map(|v| (v / radius).floor() as i32);
        let (weight, sums) = self.cells.entry(cell).or_insert_with(|| (0.0, vec![0.0; errors.len()]));
        *weight += 1.0;
        sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
    }

    /// The smoothed error at the centre of every cell that has one, or a neighbour that has.
    pub(super) fn smoothed(&self, channels: usize, control: &Control<'_>) -> Result<Smoothed, PredictError> {
        let mut wanted: Vec<[i32; 3]> = Vec::new();
        for cell in self.cells.keys() {
            for n in 0..27 {
                let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
                wanted.push(std::array::from_fn(|a| cell[a] + step[a]));
            }
        }
        wanted.sort_unstable();
        wanted.dedup();
        let values = wanted
            .par_iter()
            .map(|cell| {
                control.check()?;
                Ok((*cell, self.smoothed_at(*cell, channels)))
            })
            .collect::<Result<Vec<_>, PredictError>>()?;
        Ok(Smoothed(values.into_iter().collect()))
    }

    /// The mean over a cell's neighbourhood, Gaussian and with the prior.
    fn smoothed_at(&self, cell: [i32; 3], channels: usize) -> Vec<f64> {
        let spread = |d: i32| (-0.5 * f64::from(d).powi(2)).exp();
        let (mut total, mut sums) = (0.0, vec![0.0; channels]);
        for dx in -REACH..=REACH {
            for dy in -REACH..=REACH {
                let row = spread(dx) * spread(dy);
                let [x, y] = [cell[0] + dx, cell[1] + dy];
                let range = [x, y, cell[2] - REACH]..=[x, y, cell[2] + REACH];
                for (there, (weight, errors)) in self.cells.range(range) {
                    let share = row * spread(there[2] - cell[2]);
                    total += share * weight;
                    sums.iter_mut().zip(errors).for_each(|(s, e)| *s += share * e);
                }
            }
        }
        sums.iter_mut().for_each(|s| *s /= total + PRIOR);
        sums
    }
}

/// A smoothed error by cell.
pub(super) struct Smoothed(BTreeMap<[i32; 3], Vec<f64>>);

impl Smoothed {
    /// The error at a position, linear between the centres of cells; cells without one count as zero.
    pub(super) fn at(&self, at: [f64; 3], radius: f64, out: &mut [f64]) {
        out.fill(0.0);
        let place = at.map(|v| v / radius - 0.5);
        let base = place.map(f64::floor);
        for corner in 0..8 {
            let mut share = 1.0;
            let cell = std::array::from_fn(|a| {
                let fraction = place[a] - base[a];
                let up = corner >> a & 1;
                share *= if up == 1 { fraction } else { 1.0 - fraction };
                base[a] as i32 + up
            });
            if let Some(errors) = self.0.get(&cell) {
                out.iter_mut().zip(errors).for_each(|(o, e)| *o += share * e);
            }
        }
    }
}
