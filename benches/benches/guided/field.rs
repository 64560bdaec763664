//! The exit field: what is left of a path's light on average when it flies off at a depth along a direction.

use super::scene::Scene;

/// The largest share that the direction has in the field, so that it stays positive.
const MOST: f64 = 0.9;
/// Visits of a bin below which it is left unguided.
const FEW: f64 = 200.0;

/// By depth bin, `mean (1 + slope μ)`, with μ the cosine of the direction to the outward normal.
pub struct ExitField {
    slopes: Vec<f64>,
}

/// A path that flew off from a scattering: bin, cosine to the outward normal, throughput there.
pub struct Visit {
    pub bin: usize,
    pub cosine: f64,
    pub weight: f64,
}

/// Sums for the least squares of each bin.
pub struct Fit {
    sums: Vec<[f64; 5]>,
}

impl Fit {
    pub fn new() -> Self {
        Self { sums: vec![[0.0; 5]; Scene::bins()] }
    }

    /// Takes in a path that ended with a throughput.
    pub fn add(&mut self, visits: &[Visit], throughput: f64) {
        for visit in visits {
            let left = throughput / visit.weight;
            let row = [1.0, visit.cosine, visit.cosine * visit.cosine, left, left * visit.cosine];
            self.sums[visit.bin].iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
        }
    }

    /// The field of least squares.
    pub fn field(&self) -> ExitField {
        let slope = |&[n, x, xx, y, xy]: &[f64; 5]| {
            let determinant = n * xx - x * x;
            if n < FEW || determinant <= 0.0 {
                return 0.0;
            }
            let (mean, slope) = ((y * xx - x * xy) / determinant, (n * xy - x * y) / determinant);
            if mean > 0.0 { (slope / mean).clamp(-MOST, MOST) } else { 0.0 }
        };
        ExitField { slopes: self.sums.iter().map(slope).collect() }
    }
}

impl ExitField {
    /// With slopes times `factor`, 0 to 1.
    pub fn times(&self, factor: f64) -> Self {
        Self { slopes: self.slopes.iter().map(|slope| slope * factor).collect() }
    }

    /// Slope of a bin.
    pub fn slope(&self, bin: usize) -> f64 {
        self.slopes[bin]
    }
}
