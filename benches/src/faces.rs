//! What is wrong on a box's faces: along their edges, and by the period of a pattern.

use std::f64::consts::TAU;

use pellucid::color::space::lab_of_linear_rgb;
use pellucid::voxel::Surface;
use serde::{Deserialize, Serialize};

/// How far from a face's edges its rim reaches, in mm.
pub const RIM_MM: f64 = 0.3;
/// Periods in mm between the bands that patterns are sorted into.
pub const PERIODS_MM: [f64; 5] = [0.1, 0.2, 0.4, 0.8, 1.6];
/// Bands of periods.
pub const BANDS: usize = PERIODS_MM.len() + 1;

/// What is shown on a box's faces less what should be, in L*, a*, b*.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Faces {
    /// The mean within [`RIM_MM`] of an edge.
    pub rim: [f64; 3],
    /// The mean elsewhere.
    pub inner: [f64; 3],
    /// Root mean square of the patterns elsewhere, by their periods, the shortest first; each face's mean left out.
    pub bands: [f64; BANDS],
}

impl Faces {
    /// Of the colours shown by the surface voxels of an upright box, in linear RGB relative to the print's white.
    pub fn of(surface: &Surface, shown: &[[f32; 3]], wanted: &[[f32; 3]]) -> Self {
        let off = differences(shown, wanted);
        let pitch = surface.frame().pitch().mm();
        let (low, high) = bounds(surface.voxels());
        let mut sums = [[0.0; 4]; 2];
        let (mut power, mut inside) = ([0.0; BANDS], 0.0);
        for axis in 0..3 {
            let across = [(axis + 1) % 3, (axis + 2) % 3];
            let margin = across.map(|a| (RIM_MM / pitch[a]).ceil() as u32);
            let size =
                [0, 1].map(|i| (high[across[i]] + 1 - low[across[i]]).saturating_sub(2 * margin[i]) as usize);
            for end in [low[axis], high[axis]] {
                let mut face = vec![[0.0; 3]; size[0] * size[1]];
                for (voxel, off) in surface.voxels().iter().zip(&off).filter(|(v, _)| v[axis] == end) {
                    let at =
                        [0, 1].map(|i| (voxel[across[i]] - low[across[i]]).wrapping_sub(margin[i]) as usize);
                    let within = at[0] < size[0] && at[1] < size[1];
                    let sum = &mut sums[usize::from(within)];
                    (0..3).for_each(|c| sum[c] += off[c]);
                    sum[3] += 1.0;
                    if within {
                        face[at[0] * size[1] + at[1]] = *off;
                    }
                }
                let points = face.len() as f64;
                let found = spectrum(&face, size, across.map(|a| pitch[a]));
                power.iter_mut().zip(found).for_each(|(sum, p)| *sum += points * p);
                inside += points;
            }
        }
        let [rim, inner] = sums.map(|s| [0, 1, 2].map(|c| s[c] / s[3].max(1.0)));
        Self { rim, inner, bands: power.map(|p| (p / inside.max(1.0)).sqrt()) }
    }
}

fn bounds(voxels: &[[u32; 3]]) -> ([u32; 3], [u32; 3]) {
    let mut bounds = ([u32::MAX; 3], [0; 3]);
    for voxel in voxels {
        for axis in 0..3 {
            bounds.0[axis] = bounds.0[axis].min(voxel[axis]);
            bounds.1[axis] = bounds.1[axis].max(voxel[axis]);
        }
    }
    bounds
}

fn differences(shown: &[[f32; 3]], wanted: &[[f32; 3]]) -> Vec<[f64; 3]> {
    let lab = |colors: &[[f32; 3]]| {
        let mut lab = vec![[0.0; 3]; colors.len()];
        lab_of_linear_rgb(colors, &mut lab);
        lab
    };
    let each = lab(shown).into_iter().zip(lab(wanted));
    each.map(|(a, b)| [0, 1, 2].map(|c| f64::from(a[c] - b[c]))).collect()
}

/// Mean squares of a face's patterns by band, `face` being `[first axis][second axis]` with so many voxels of so many mm.
fn spectrum(face: &[[f64; 3]], size: [usize; 2], pitch_mm: [f64; 2]) -> [f64; BANDS] {
    let mut bands = [0.0; BANDS];
    // A face without a middle has no patterns.
    if size.contains(&0) {
        return bands;
    }
    let points = face.len() as f64;
    let hann = |i: usize, n: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos();
    let window: Vec<f64> =
        (0..face.len()).map(|k| hann(k / size[1], size[0]) * hann(k % size[1], size[1])).collect();
    let weight: f64 = window.iter().map(|w| w * w).sum();
    for c in 0..3 {
        let mean = face.iter().map(|v| v[c]).sum::<f64>() / points;
        let values = face.iter().zip(&window).map(|(v, w)| [w * (v[c] - mean), 0.0]).collect();
        let waves = fourier(fourier(values, size), [size[1], size[0]]);
        for (k, [re, im]) in waves.into_iter().enumerate() {
            let waves_a_mm = |k: usize, n: usize, mm: f64| k.min(n - k) as f64 / (n as f64 * mm);
            let [a, b] =
                [(k / size[1], 0), (k % size[1], 1)].map(|(k, i)| waves_a_mm(k, size[i], pitch_mm[i]));
            let period = 1.0 / a.hypot(b);
            bands[PERIODS_MM.iter().filter(|&&mm| period >= mm).count()] +=
                (re * re + im * im) / (points * weight);
        }
    }
    bands
}

/// The discrete Fourier transform of every row, `[second axis][first axis]`.
fn fourier(values: Vec<[f64; 2]>, [rows, columns]: [usize; 2]) -> Vec<[f64; 2]> {
    let turns: Vec<[f64; 2]> =
        (0..columns).map(|k| TAU * k as f64 / columns as f64).map(|t| [t.cos(), -t.sin()]).collect();
    let mut out = vec![[0.0; 2]; values.len()];
    for (y, row) in values.chunks_exact(columns).enumerate() {
        for k in 0..columns {
            let mut sum = [0.0; 2];
            let mut turn = 0;
            for [re, im] in row {
                let [cos, sin] = turns[turn];
                sum[0] += re * cos - im * sin;
                sum[1] += re * sin + im * cos;
                turn = (turn + k) % columns;
            }
            out[k * rows + y] = sum;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use pellucid::voxel::{AIR, Control, Frame, LabelGrid, Pitch, SurfaceOptions};

    use super::*;

    #[test]
    fn a_pattern_lies_in_the_band_of_its_period() {
        let (size, pitch) = ([150, 90], [0.04, 0.08]);
        // Twelve waves a face.
        for (axis, period) in [(0, 0.5), (1, 0.6)] {
            let at = |k: usize| [(k / size[1]) as f64 * pitch[0], (k % size[1]) as f64 * pitch[1]];
            let wave = |k: usize| [5.0 + 2.0 * (TAU * at(k)[axis] / period).cos(), 0.0, 0.0];
            let face: Vec<_> = (0..size[0] * size[1]).map(wave).collect();
            let bands = spectrum(&face, size, pitch);
            let all: f64 = bands.iter().sum();
            assert!((all - 2.0).abs() < 0.02, "{all}");
            assert!(bands[3] > 0.99 * all, "{period}: {bands:?}");
        }
    }

    #[test]
    fn a_box_with_bright_edges_has_a_rim() {
        let pitch = Pitch::new([0.05, 0.08, 0.04]).unwrap();
        let frame = Frame::new([0.0; 3], pitch, [60, 40, 50]).unwrap();
        let solid = |v: [u32; 3]| (0..3).all(|a| (2..[58, 38, 48][a]).contains(&v[a]));
        let labels = LabelGrid::from_fn(frame, |v| if solid(v) { 1 } else { AIR });
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none()).unwrap();
        let wanted = vec![[0.5; 3]; surface.len()];
        let edges = |v: &[u32; 3]| (0..3).filter(|&a| [2, [57, 37, 47][a]].contains(&v[a])).count();
        let shown = |v: &[u32; 3]| if edges(v) > 1 { [0.6; 3] } else { [0.5; 3] };
        let shown: Vec<_> = surface.voxels().iter().map(shown).collect();
        let found = Faces::of(&surface, &shown, &wanted);
        assert!(found.rim[0] > 1.0 && found.rim[1].abs() < 0.1, "{found:?}");
        assert_eq!((found.inner, found.bands), ([0.0; 3], [0.0; BANDS]));
    }
}
