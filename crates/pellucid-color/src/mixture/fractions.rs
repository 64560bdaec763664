//! Volume fractions of a mixture.

use super::MAX_MATERIALS;

/// Volume fractions of a mixture, by material in label order (label 1 first), summing to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fractions {
    pub(super) values: [f32; MAX_MATERIALS],
    pub(super) count: usize,
}

impl Fractions {
    /// All of one material. Positions past the last material give the last.
    pub fn pure(material: usize, count: usize) -> Self {
        let mut values = [0.0; MAX_MATERIALS];
        let count = count.clamp(1, MAX_MATERIALS);
        values[material.min(count - 1)] = 1.0;
        Self { values, count }
    }

    pub(crate) fn from_f64(values: &[f64; MAX_MATERIALS], count: usize) -> Self {
        let sum: f64 = values[..count].iter().sum();
        Self {
            values: std::array::from_fn(|i| if i < count { (values[i] / sum) as f32 } else { 0.0 }),
            count,
        }
    }
}

impl std::ops::Deref for Fractions {
    type Target = [f32];
    fn deref(&self) -> &[f32] {
        &self.values[..self.count]
    }
}
