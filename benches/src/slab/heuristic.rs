//! Surface-first corrections (Sumin et al. 2019) of continuous albedos.

use pellucid::color::{ColorError, ReflectanceCurve};

use super::field::Gaussian;
use super::{Albedo, LEAST, Slab};

/// Share of the shortfall that the first step adds; step i takes `GAIN / (1 + GAIN_DECAY i)`. As of
/// [`pellucid::refine::SurfaceFirst`].
const GAIN: f64 = 2.0;
const GAIN_DECAY: f64 = 0.1;
/// Depth in mm to which the target's own albedo reaches once refined; below is white.
const BASE_MM: f64 = 0.4;
/// Entries of the table of albedos.
const ENTRIES: usize = 2048;

/// What colour a thick block of one albedo has, and back. Colours are relative to white, as cube roots.
pub struct Ink {
    /// Least colour, by channel.
    least: [f64; 3],
    /// Albedos of evenly spaced colours from the least to white's, 1.
    albedos: [Vec<f64>; 3],
}

impl Ink {
    /// Of a slab's medium, as if it were infinitely thick.
    ///
    /// # Errors
    /// When the refractive index is out of range.
    pub fn new(slab: &Slab) -> Result<Self, ColorError> {
        let curve = ReflectanceCurve::half_space(slab.index, 0.0, 0.0)?;
        let white = slab.white.map(|a| curve.radiance(f64::from(a), 0.0));
        let least = white.map(|white| (curve.radiance(f64::from(LEAST), 0.0) / white).cbrt());
        let albedos = std::array::from_fn(|c| {
            let color = |i: usize| least[c] + (1.0 - least[c]) * i as f64 / (ENTRIES - 1) as f64;
            (0..ENTRIES).map(|i| curve.albedo_of(color(i).powi(3) * white[c], 0.0)).collect()
        });
        Ok(Self { least, albedos })
    }

    /// The albedo for a colour, and the colour that comes of it: the nearest in reach.
    pub fn albedo(&self, channel: usize, color: f64) -> (f64, f64) {
        let (least, table) = (self.least[channel], &self.albedos[channel]);
        let got = color.clamp(least, 1.0);
        let at = (got - least) / (1.0 - least) * (ENTRIES - 1) as f64;
        let i = (at as usize).min(ENTRIES - 2);
        (table[i] + (at - i as f64) * (table[i + 1] - table[i]), got)
    }

    /// The colour of an albedo, from the least in reach to 1.
    pub fn color(&self, channel: usize, albedo: f64) -> f64 {
        let (least, table) = (self.least[channel], &self.albedos[channel]);
        let above = table.partition_point(|a| *a < albedo).clamp(1, ENTRIES - 1);
        let width = (table[above] - table[above - 1]).max(f64::MIN_POSITIVE);
        let part = ((albedo - table[above - 1]) / width).clamp(0.0, 1.0);
        least + (1.0 - least) * ((above - 1) as f64 + part) / (ENTRIES - 1) as f64
    }
}

/// The heuristic on its way: one residual a surface voxel and channel, in cube roots of relative colours.
///
/// As [`pellucid::refine::SurfaceFirst`], without what halftones need: no gamut but each channel's own range, no layers
/// that keep sparse ink out. At first the target's albedo reaches down to the backing.
pub struct Heuristic<'a> {
    ink: &'a Ink,
    target: Vec<[f64; 3]>,
    gaussian: Gaussian,
    residual: Vec<[f64; 3]>,
    overflow: Vec<[f64; 3]>,
    steps: u32,
}

impl<'a> Heuristic<'a> {
    /// Begins, towards relative colours `[y][x]`. What the target lacks is smoothed by `smoothing_mm` before it is added;
    /// 0 takes each voxel's own.
    pub fn new(slab: &Slab, ink: &'a Ink, target: &[[f64; 3]], smoothing_mm: f64) -> Self {
        let none = vec![[0.0; 3]; target.len()];
        Self {
            ink,
            target: target.to_vec(),
            gaussian: Gaussian::new(slab, smoothing_mm),
            residual: none.clone(),
            overflow: none,
            steps: 0,
        }
    }

    /// Spends the residuals from the surface down; remembers what no layer could take.
    pub fn albedo(&mut self, slab: &Slab) -> Albedo {
        let base_layers = if self.steps == 0 { slab.layers } else { slab.layers_above(BASE_MM) };
        let points = slab.points();
        let mut values: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; slab.voxels()]);
        for point in 0..points {
            for c in 0..3 {
                let mut overflow = self.residual[point][c];
                for layer in 0..slab.layers {
                    let base = if layer < base_layers { encode(self.target[point][c]) } else { 1.0 };
                    let wanted = base + overflow;
                    let (albedo, got) = self.ink.albedo(c, wanted);
                    overflow = wanted - got;
                    values[c][layer * points + point] = albedo;
                }
                self.overflow[point][c] = overflow;
            }
        }
        Albedo::of(slab, |c, voxel| values[c][voxel])
    }

    /// Takes what the last albedos showed.
    pub fn update(&mut self, shown: &[[f64; 3]]) {
        let gain = GAIN / (1.0 + GAIN_DECAY * f64::from(self.steps));
        // Smoothed as light adds up: the cube root of a few paths' mean is biased far down.
        let lacking: Vec<[f64; 3]> = shown
            .iter()
            .zip(&self.target)
            .map(|(shown, target)| std::array::from_fn(|c| target[c] - shown[c]))
            .collect();
        let lacking = self.gaussian.apply(&lacking);
        for (point, residual) in self.residual.iter_mut().enumerate() {
            for c in 0..3 {
                let target = self.target[point][c];
                let shortfall = encode(target) - encode(target - lacking[point][c]);
                residual[c] += gain * shortfall - self.overflow[point][c];
            }
        }
        self.steps += 1;
    }
}

fn encode(color: f64) -> f64 {
    color.max(0.0).cbrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;

    #[test]
    fn colours_and_albedos_are_each_others_inverse() {
        let slab = small_slab();
        let ink = Ink::new(&slab).unwrap();
        let curve = ReflectanceCurve::half_space(slab.index, 0.0, 0.0).unwrap();
        for c in 0..3 {
            let white = curve.radiance(f64::from(slab.white[c]), 0.0);
            for color in [0.5, 0.8, 0.99] {
                let (albedo, got) = ink.albedo(c, color);
                assert_eq!(got, color);
                assert!((ink.color(c, albedo) - color).abs() < 1e-9);
                assert!(((curve.radiance(albedo, 0.0) / white).cbrt() - color).abs() < 1e-4);
            }
            assert_eq!([ink.albedo(c, 1.7).1, ink.color(c, 1.0)], [1.0; 2]);
            assert!(ink.albedo(c, 0.0).1 > 0.0);
        }
    }

    #[test]
    fn demand_goes_down_from_the_surface() {
        let slab = Slab { layers: 12, ..small_slab() };
        let ink = Ink::new(&slab).unwrap();
        let target = vec![[0.3, 0.5, 0.7]; 16];
        let mut heuristic = Heuristic::new(&slab, &ink, &target, 0.0);
        let first = heuristic.albedo(&slab);
        let column =
            |albedo: &Albedo, c: usize| -> Vec<f32> { (0..12).map(|l| albedo.channel(c)[l * 16]).collect() };
        assert!((0..3).all(|c| column(&first, c).windows(2).all(|w| w[0] == w[1])));
        // Channel 0 shows too much, 1 what it should, 2 too little.
        let mut shown = target.clone();
        shown.iter_mut().for_each(|v| *v = [0.4, 0.5, 0.5]);
        heuristic.update(&shown);
        let second = heuristic.albedo(&slab);
        assert!(second.channel(0)[0] < first.channel(0)[0]);
        assert_eq!(second.channel(1)[0], first.channel(1)[0]);
        assert!(second.channel(2)[0] > first.channel(2)[0]);
        // Below 0.4 mm white, and less light never asks for it further down than more.
        assert!((0..3).all(|c| column(&second, c)[11] == slab.white[c]));
        assert!(column(&second, 0).windows(2).all(|w| w[0] <= w[1]));
    }

    /// A residual out of reach does not wind up: what no layer takes is forgotten.
    #[test]
    fn what_is_out_of_reach_is_forgotten() {
        let slab = small_slab();
        let ink = Ink::new(&slab).unwrap();
        let mut heuristic = Heuristic::new(&slab, &ink, &[[1.0; 3]; 16], 0.1);
        for _ in 0..50 {
            heuristic.albedo(&slab);
            heuristic.update(&[[0.5; 3]; 16]);
        }
        assert!(heuristic.residual.iter().flatten().all(|r| *r < 1.0), "{:?}", heuristic.residual[0]);
    }
}
