//! What the volume looks like below a surface point, as a few numbers a channel.

use crate::bricks::{Bricks, MARGIN};
use crate::coefficients::Optics16;
use crate::volume::Volume;

/// Edges of the depth bins below the surface, mm.
const DEPTHS: [f64; 6] = [0.0, 0.05, 0.12, 0.25, 0.5, 1.0];
const BINS: usize = DEPTHS.len() - 1;
/// Radius of each ring about the point's normal, mm, and its number of columns.
const RINGS: [(f64, usize); 4] = [(0.0, 1), (0.07, 6), (0.17, 8), (0.4, 10)];
/// Samples along a column in each bin.
const STEPS: [usize; 4] = [3, 2, 2, 2];
/// Cells: a depth bin of a ring.
pub(crate) const CELLS: usize = BINS * RINGS.len();
/// Numbers a channel: mean scattering and absorption of every cell, a reflectance a ring, and 1.
pub(crate) const FEATURES: usize = 2 * CELLS + RINGS.len() + 1;

/// Share of each palette position in each cell.
pub(crate) struct Composition([[f32; 16]; CELLS]);

impl Composition {
    /// Looks around below a surface point.
    pub(crate) fn of(volume: &Volume, point: u32) -> Self {
        let mut counts = [[0u16; 16]; CELLS];
        let start = volume.start(point);
        let mm = volume.frame().pitch().mm().map(|m| m as f32);
        let inward = start.direction;
        let (u, v) = frame(inward);
        for (ring, &(radius, columns)) in RINGS.iter().enumerate() {
            for column in 0..columns {
                let angle = std::f64::consts::TAU * (column as f64 + 0.5 * ring as f64) / columns as f64;
                let (s, c) = ((radius * angle.sin()) as f32, (radius * angle.cos()) as f32);
                for bin in 0..BINS {
                    for step in 0..STEPS[ring] {
                        let t = (step as f64 + 0.5) / STEPS[ring] as f64;
                        let depth = (DEPTHS[bin] + t * (DEPTHS[bin + 1] - DEPTHS[bin])) as f32;
                        let at: [f32; 3] = std::array::from_fn(|a| {
                            start.position[a] + (inward[a] * depth + u[a] * c + v[a] * s) / mm[a]
                        });
                        counts[ring * BINS + bin][position(volume.bricks(), at)] += 1;
                    }
                }
            }
        }
        Self(counts.map(|cell| {
            let total = cell.iter().sum::<u16>();
            cell.map(|n| f32::from(n) / f32::from(total))
        }))
    }

    /// The features in one channel.
    pub(crate) fn features(&self, optics: &Optics16, out: &mut [f64; FEATURES]) {
        let mut cells = [[0.0f32; 2]; CELLS];
        for (cell, share) in cells.iter_mut().zip(&self.0) {
            for p in 1..16 {
                cell[0] += share[p] * optics.sigma_s[p];
                cell[1] += share[p] * optics.sigma_a[p];
            }
        }
        // Scales bring every feature to the order of 1, as the ridge penalty expects.
        for (i, cell) in cells.iter().enumerate() {
            out[2 * i] = f64::from(0.1 * cell[0]);
            out[2 * i + 1] = f64::from((1.0 + 3.0 * cell[1]).ln());
        }
        for ring in 0..RINGS.len() {
            out[2 * CELLS + ring] = reflectance(&cells[ring * BINS..(ring + 1) * BINS]);
        }
        out[FEATURES - 1] = 1.0;
    }
}

/// Two-flux (Kubelka-Munk) reflectance of a column of layers over a half-space of the last one.
fn reflectance(cells: &[[f32; 2]]) -> f64 {
    let layer = |cell: &[f32; 2]| (0.45 * f64::from(cell[0]) + 1e-6, 2.0 * f64::from(cell[1]));
    let (s, k) = layer(&cells[cells.len() - 1]);
    let a = 1.0 + k / s;
    let mut below = a - (a * a - 1.0).max(0.0).sqrt();
    for bin in (0..cells.len()).rev() {
        let (s, k) = layer(&cells[bin]);
        let thickness = DEPTHS[bin + 1] - DEPTHS[bin];
        let a = 1.0 + k / s;
        let b = (a * a - 1.0).max(1e-9).sqrt();
        let coth = 1.0 / (b * s * thickness).tanh();
        below = (1.0 - below * (a - b * coth)) / (a - below + b * coth);
    }
    below
}

fn position(bricks: &Bricks, at: [f32; 3]) -> usize {
    if at.iter().any(|&p| p < MARGIN as f32) {
        return 0;
    }
    usize::from(bricks.byte(at.map(|p| p as u32)) & 15)
}

/// Two unit vectors that are orthogonal to `d` and to each other.
fn frame(d: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let sign = if d[2] < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + d[2]);
    let b = d[0] * d[1] * a;
    ([1.0 + sign * d[0] * d[0] * a, sign * b, -sign * d[0]], [b, sign + d[1] * d[1] * a, -d[1]])
}
