//! What is known of an error, and how it is written down.

use super::field::Field;
use super::quadratic::{Quadratic, SUMS};
use crate::pair::{check_learned, halves, not_learned};
use crate::{Learned, ObjectId, PredictError};

/// Sums over the points at which an error was measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Moments {
    /// One a channel.
    pub(super) quadratics: Vec<Quadratic>,
    /// What the quadratics leave.
    pub(super) field: Field,
}

/// Whose moments they are: those of another predictor or object mean nothing here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Owner {
    pub(super) predictor: String,
    pub(super) object: ObjectId,
    pub(super) channels: usize,
    pub(super) radius_mm: f64,
}

/// Largest coordinate of a cell: far past any grid, and sums of a few never overflow.
const MAX_CELL: f64 = (1 << 30) as f64;

impl Moments {
    pub(super) fn new(channels: usize) -> Self {
        Self { quadratics: vec![Quadratic::default(); channels], field: Field::default() }
    }

    /// `self * memory + new`.
    pub(super) fn absorb(&mut self, memory: f64, new: &Self) {
        self.quadratics.iter_mut().zip(&new.quadratics).for_each(|(own, new)| own.absorb(memory, new));
        self.field.absorb(memory, &new.field);
    }
}

impl Owner {
    /// Values: the object's identity in two halves, channels, radius; the sums of each channel; for each cell its three
    /// coordinates, weight and a sum a channel.
    pub(super) fn write(&self, passes: Vec<u32>, moments: &Moments) -> Learned {
        let mut values = self.header().to_vec();
        moments.quadratics.iter().for_each(|q| values.extend(q.sums()));
        for (cell, (weight, sums)) in &moments.field.cells {
            values.extend(cell.map(f64::from));
            values.push(*weight);
            values.extend(sums);
        }
        Learned { predictor: self.predictor.clone(), passes, values, singles: Vec::new() }
    }

    /// Moments from what [`Owner::write`] made.
    pub(super) fn read(&self, learned: &Learned) -> Result<Moments, PredictError> {
        check_learned(learned, &self.predictor)?;
        let header = self.header();
        if learned.values.get(..header.len()) != Some(&header[..]) {
            return Err(not_learned("of another object, or of other channels or another radius"));
        }
        if learned.values.iter().any(|v| !v.is_finite()) {
            return Err(not_learned("that are not finite"));
        }
        let rest = &learned.values[header.len()..];
        let (sums, cells) = rest
            .split_at_checked(self.channels * SUMS)
            .filter(|(_, cells)| cells.len().is_multiple_of(4 + self.channels))
            .ok_or_else(|| {
                not_learned(format!("{} in number; the file is cut short", learned.values.len()))
            })?;
        let mut moments = Moments::new(0);
        moments.quadratics = sums.as_chunks::<SUMS>().0.iter().map(Quadratic::from_sums).collect();
        for cell in cells.chunks_exact(4 + self.channels) {
            let (at, rest) = (&cell[..3], &cell[3..]);
            if at.iter().any(|v| v.fract() != 0.0 || v.abs() > MAX_CELL) || rest[0] < 0.0 {
                return Err(not_learned(format!("with a cell {at:?} of weight {}", rest[0])));
            }
            let at = std::array::from_fn(|a| at[a] as i32);
            moments.field.cells.insert(at, (rest[0], rest[1..].to_vec()));
        }
        Ok(moments)
    }

    fn header(&self) -> [f64; 4] {
        let [high, low] = halves(self.object);
        [high, low, self.channels as f64, self.radius_mm]
    }
}
