//! Derivatives of radiance by the materials that a first flight passes.
//!
//! On a flight with transmittance T, the segment of length l in a mixture of extinction t and scattering s adds
//! T A s to the mass of its bin, A = (1 - exp(-t l)) / t, and takes the factor exp(-t l) off all that comes after it.
//! With S the radiance that is collected behind it, the derivative by the amount of a material in its voxel is
//!
//! ```text
//! J T (A s_m + s A' t_m)  -  l S t_m,        A' = dA/dt
//! ```

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control};
use rayon::prelude::*;

use super::FLIGHT_BINS;
use super::extract::{CHUNK, FirstFlights};
use super::optics::{LANES, Optics, exp_of_minus};
use super::passage::{Depth, Passage};
use crate::StencilError;

/// Chunks of points whose derivatives are in memory at a time: some 20 MB.
const ROUND: usize = 16;
/// Below this optical depth series are more accurate than quotients.
const THIN: f64 = 0.25;

/// A value for each of some channels.
type Wide = [f64; LANES];
/// J of each bin and after a reflection at the far side.
type After = [f32; FLIGHT_BINS + 1];

impl FirstFlights<'_> {
    /// The exact derivative of `sum(d_radiance * radiance)` by the amount of each material in each voxel that the
    /// first flights of `points` pass, where [`FirstFlight::radiance`](super::FirstFlight::radiance) is given `j`, which is held fixed. `j` and
    /// `d_radiance` are ordered `[point][channel]`. The amount is a volume fraction, and a mixture has the sums of its
    /// parts' coefficients.
    ///
    /// `sink` is given the voxel, the label of the material and what is to be added, for every material and every
    /// solid voxel on the way: in the order of `points`, the same for any number of threads. A voxel comes once for
    /// each flight and each part of a flight. Air that flights skip gets nothing. Progress counts points.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a point lies past the surface or the lengths do not agree;
    /// [`StencilError::Cancelled`].
    pub fn pullback(
        &self,
        points: &[u32],
        j: &[[f32; FLIGHT_BINS + 1]],
        d_radiance: &[f32],
        sink: &mut dyn FnMut([u32; 3], u8, f32),
        control: &Control<'_>,
    ) -> Result<(), StencilError> {
        self.check_points(points)?;
        self.check_values("values of J", j.len(), points)?;
        self.check_values("derivatives by radiance", d_radiance.len(), points)?;
        let channels = self.channels();
        let done = AtomicU64::new(0);
        let round = ROUND * CHUNK;
        let values = j.chunks(round * channels).zip(d_radiance.chunks(round * channels));
        for (points, (j, d_radiance)) in points.chunks(round).zip(values) {
            let values = j.par_chunks(CHUNK * channels).zip(d_radiance.par_chunks(CHUNK * channels));
            let found = points
                .par_chunks(CHUNK)
                .zip(values)
                .map(|(points, (j, d_radiance))| {
                    control.check()?;
                    Ok(self.derivatives(points, j, d_radiance))
                })
                .collect::<Result<Vec<_>, StencilError>>()?;
            for derivatives in found {
                control.check()?;
                derivatives.hand_to(sink);
            }
            control.advance(&done, points.len() as u64, (j.len() / channels) as u64);
        }
        Ok(())
    }

    fn derivatives(&self, points: &[u32], j: &[After], d_radiance: &[f32]) -> Derivatives {
        let optics = self.optics();
        let channels = self.channels();
        let mut found = Derivatives { materials: optics.materials(), voxels: Vec::new(), values: Vec::new() };
        let mut pieces = Vec::new();
        let values = j.chunks_exact(channels).zip(d_radiance.chunks_exact(channels));
        for (&point, (j, d_radiance)) in points.iter().zip(values) {
            let groups = j.chunks(LANES).zip(d_radiance.chunks(LANES));
            for (group, (j, d_radiance)) in groups.enumerate() {
                if d_radiance.iter().any(|&d| d != 0.0) {
                    let end = self.pieces(point, group, &mut pieces);
                    let after = Afterwards::new(j, d_radiance);
                    found.of_flight(optics, group, &mut pieces, end, &after);
                }
            }
        }
        found
    }

    /// The pieces of a flight through solid voxels, and how it ends.
    fn pieces(&self, point: u32, group: usize, pieces: &mut Vec<Piece>) -> End {
        pieces.clear();
        let mut passage = Passage::new(self.optics(), group);
        let mut depth = Depth::default();
        let mut last = None;
        let reflectance = self.follow(point, |segment| {
            last = Some((segment.voxel, segment.label));
            if !passage.enter(segment.label) {
                return false;
            }
            let mut left = segment.length;
            loop {
                let part = depth.advance(&mut left);
                if segment.label != AIR && part.length > 0.0 {
                    let length = f64::from(part.length);
                    let (voxel, label) = (segment.voxel, segment.label);
                    pieces.push(Piece {
                        voxel,
                        label,
                        bin: part.bin,
                        length,
                        before: [1.0; LANES],
                        decay: [Decay::default(); LANES],
                    });
                }
                if !part.ends {
                    break;
                }
            }
            passage.go(segment.length)
        });
        match (reflectance, last) {
            (Some(reflectance), _) => End::FarSide(f64::from(reflectance)),
            (None, Some((voxel, label))) => End::Opaque { voxel, label, bin: depth.bin },
            // A flight has a segment at least.
            (None, None) => End::FarSide(0.0),
        }
    }
}

/// Part of a flight within one voxel and bin.
struct Piece {
    voxel: [i32; 3],
    label: u8,
    bin: usize,
    /// mm
    length: f64,
    /// Transmittance up to it.
    before: Wide,
    decay: [Decay; LANES],
}

enum End {
    /// With the reflectance there.
    FarSide(f64),
    /// What is left collides in this voxel, in this bin.
    Opaque { voxel: [i32; 3], label: u8, bin: usize },
}

/// J and the derivative by radiance in the channels of a group, nothing past the last channel.
struct Afterwards {
    j: [Wide; FLIGHT_BINS + 1],
    d_radiance: Wide,
}

impl Afterwards {
    fn new(j: &[After], d_radiance: &[f32]) -> Self {
        let lane = |of: &dyn Fn(usize) -> f32| -> Wide {
            std::array::from_fn(|l| if l < j.len() { f64::from(of(l)) } else { 0.0 })
        };
        Self { j: std::array::from_fn(|bin| lane(&|l| j[l][bin])), d_radiance: lane(&|l| d_radiance[l]) }
    }
}

/// Derivatives by the materials of some voxels, which may repeat.
struct Derivatives {
    materials: usize,
    voxels: Vec<[u32; 3]>,
    /// `[voxel][material]`
    values: Vec<f32>,
}

impl Derivatives {
    fn hand_to(&self, sink: &mut dyn FnMut([u32; 3], u8, f32)) {
        for (&voxel, values) in self.voxels.iter().zip(self.values.chunks_exact(self.materials)) {
            (1..=u8::MAX).zip(values).for_each(|(label, &value)| sink(voxel, label, value));
        }
    }

    /// Adds those of a flight: its pieces from the last to the first, with what is collected behind each.
    fn of_flight(
        &mut self,
        optics: &Optics,
        group: usize,
        pieces: &mut [Piece],
        end: End,
        after: &Afterwards,
    ) {
        let mut left = [1.0; LANES];
        for piece in pieces.iter_mut() {
            piece.before = left;
            let (extinction, _) = optics.of(piece.label, group);
            for l in 0..LANES {
                piece.decay[l] = Decay::new(f64::from(extinction[l]) * piece.length);
                left[l] *= piece.decay[l].kept;
            }
        }
        let mut behind = self.of_end(optics, group, end, left, after);
        for piece in pieces.iter().rev() {
            let (extinction, albedo) = optics.of(piece.label, group);
            let (mut by_scattering, mut by_extinction) = ([0.0; LANES], [0.0; LANES]);
            let length = piece.length;
            for l in 0..LANES {
                let extinction = f64::from(extinction[l]);
                let scattering = extinction * f64::from(albedo[l]);
                let decay = piece.decay[l];
                let arriving = after.j[piece.bin][l] * piece.before[l];
                let (way, slope) = (length * decay.mean, length * length * decay.slope);
                by_scattering[l] = after.d_radiance[l] * arriving * way;
                by_extinction[l] = after.d_radiance[l] * (arriving * scattering * slope - length * behind[l]);
                behind[l] += arriving * way * scattering;
            }
            self.add(optics, group, piece.voxel, &by_scattering, &by_extinction);
        }
    }

    /// What is collected at the end of a flight; where it ends as opaque, with the derivatives of the albedo there.
    fn of_end(&mut self, optics: &Optics, group: usize, end: End, left: Wide, after: &Afterwards) -> Wide {
        match end {
            End::FarSide(reflectance) => {
                std::array::from_fn(|l| left[l] * (1.0 - reflectance + reflectance * after.j[FLIGHT_BINS][l]))
            }
            End::Opaque { voxel, label, bin } => {
                let (extinction, albedo) = optics.of(label, group);
                let collected = |l: usize| left[l] * after.j[bin][l];
                if label != AIR {
                    let by_scattering: Wide = std::array::from_fn(|l| {
                        let sum = f64::from(extinction[l]);
                        if sum > 0.0 { after.d_radiance[l] * collected(l) / sum } else { 0.0 }
                    });
                    let by_extinction = std::array::from_fn(|l| -by_scattering[l] * f64::from(albedo[l]));
                    self.add(optics, group, voxel, &by_scattering, &by_extinction);
                }
                std::array::from_fn(|l| collected(l) * f64::from(albedo[l]))
            }
        }
    }

    /// Adds a voxel, given the derivatives by its scattering and extinction coefficients.
    fn add(
        &mut self,
        optics: &Optics,
        group: usize,
        voxel: [i32; 3],
        by_scattering: &Wide,
        by_extinction: &Wide,
    ) {
        self.voxels.push(voxel.map(|v| v as u32));
        self.values.extend((1..=u8::MAX).take(self.materials).map(|label| {
            let (extinction, albedo) = optics.of(label, group);
            let term = |l: usize| {
                f64::from(extinction[l]) * (by_scattering[l] * f64::from(albedo[l]) + by_extinction[l])
            };
            (0..LANES).map(term).sum::<f64>() as f32
        }));
    }
}

/// Functions of an optical depth x of 0 or more.
#[derive(Clone, Copy, Default)]
struct Decay {
    /// exp(-x)
    kept: f64,
    /// (1 - exp(-x)) / x: the mean of exp(-y) over 0 to x.
    mean: f64,
    /// Its derivative.
    slope: f64,
}

impl Decay {
    #[inline]
    fn new(x: f64) -> Self {
        if x < THIN {
            let mean = horner(&MEAN, x);
            return Self { kept: 1.0 - x * mean, mean, slope: horner(&SLOPE, x) };
        }
        let kept = f64::from(exp_of_minus(x as f32));
        let mean = (1.0 - kept) / x;
        Self { kept, mean, slope: (kept - mean) / x }
    }
}

/// Terms of the series below [`THIN`]: what is left out is less than 1e-10.
const TERMS: usize = 8;
/// (1 - exp(-x)) / x is the sum over n of (-x)^n / (n + 1)!.
const MEAN: [f64; TERMS] = series(false);
const SLOPE: [f64; TERMS] = series(true);

/// The coefficients of the series or of its derivative.
const fn series(derivative: bool) -> [f64; TERMS] {
    let mut out = [0.0; TERMS];
    let mut n = 0;
    let mut coefficient = 1.0;
    while n < TERMS {
        // Now -1 to the n over (n + 1)!.
        let next = -coefficient / (n + 2) as f64;
        out[n] = if derivative { (n + 1) as f64 * next } else { coefficient };
        coefficient = next;
        n += 1;
    }
    out
}

#[inline]
fn horner(coefficients: &[f64; TERMS], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decay_is_exact_where_it_is_thin_and_where_it_is_not() {
        for x in [0.0, 1e-12, 1e-5, 0.02, 0.3, 0.249_999, 0.250_001, 1.0, 5.0, 40.0, 1e6] {
            let Decay { kept, mean, slope } = Decay::new(x);
            let (exact_kept, exact_mean) = ((-x).exp(), if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 });
            // The quotient for the derivative loses digits below a hundredth.
            let exact_slope =
                if x < 1e-2 { -0.5 + x / 3.0 - x * x / 8.0 } else { (exact_kept - exact_mean) / x };
            assert!((kept - exact_kept).abs() <= 1e-6 * exact_kept + 1e-37, "{x}: {kept} {exact_kept}");
            assert!((mean - exact_mean).abs() <= 1e-6 * exact_mean, "{x}: {mean} {exact_mean}");
            assert!((slope - exact_slope).abs() <= 3e-6 * exact_slope.abs(), "{x}: {slope} {exact_slope}");
        }
    }
}
