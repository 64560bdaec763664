//! Material arrangements of the data set: patterns of mixtures, halftoned to one material a voxel
//! (paper, section 4.1 and Figure 2).

use rand_core::Rng;
use serde::{Deserialize, Serialize};

use pellucid_halftone::{BlueNoiseMask, RankedNoise};
use pellucid_voxel::{Control, Frame, Pitch};

use crate::Halftone;

use crate::volume::noise::{FractalNoise, GradientNoise, Lattice, VoronoiCells, hash, unit};

/// Thresholds of blue noise; the same for every recipe of a pitch.
#[derive(Clone, Debug)]
pub enum BlueNoise {
    /// [`Halftone::Ranked`].
    Ranked(RankedNoise),
    /// [`Halftone::Mask`].
    Mask(BlueNoiseMask),
}

impl BlueNoise {
    /// Makes the thresholds.
    pub fn new(halftone: Halftone, pitch: Pitch) -> Self {
        match halftone {
            Halftone::Ranked => Self::Ranked(RankedNoise::new(pitch, |i| unit(hash(0xb1e, i as i64, 0, 0)))),
            // Nothing cancels it.
            Halftone::Mask => BlueNoiseMask::new(pitch, MASK_SEED, &Control::none())
                .map_or_else(|_| Self::new(Halftone::Ranked, pitch), Self::Mask),
        }
    }

    /// The threshold of a voxel anywhere, within 0..1.
    pub fn at(&self, voxel: [i64; 3]) -> f64 {
        match self {
            Self::Ranked(noise) => noise.at(voxel),
            Self::Mask(mask) => {
                let size = mask.size();
                let within: [u32; 3] =
                    std::array::from_fn(|a| voxel[a].rem_euclid(i64::from(size[a])) as u32);
                f64::from(mask.threshold(within))
            }
        }
    }
}

/// Seed of the mask: another than a print's by default.
const MASK_SEED: u64 = 20_211;

/// Volume fractions of the materials, in label order; sum 1.
pub type Mixture = Vec<f64>;

/// How mixtures vary over space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// One mixture everywhere.
    Constant,
    /// Noise thresholded into bands, each with a mixture: sharp edges.
    Bands,
    /// Noise that blends between mixtures.
    Blend,
    /// Voronoi cells, each with a mixture.
    Cells,
    /// Single voxels drawn without regard to their neighbours' mixtures.
    Speckle,
}

/// How a mixture becomes one material a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dither {
    /// Independent random thresholds.
    White,
    /// A three-dimensional additive recurrence: neighbouring thresholds differ.
    Recurrence,
    /// Blue noise, as refined prints have.
    Blue,
}

/// The arrangement of one volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    /// Seed of noise and thresholds.
    pub seed: u64,
    /// How mixtures vary.
    pub pattern: Pattern,
    /// Feature size in mm.
    pub scale_mm: f64,
    /// Octaves of noise.
    pub octaves: u32,
    /// Mixtures of the pattern.
    pub palette: Vec<Mixture>,
    /// Depth in mm to which the pattern reaches; infinite fills the volume.
    pub depth_mm: f64,
    /// How much that depth varies over the surface: by a factor of 2 to the power of `relief` times noise.
    pub relief: f64,
    /// Whether the pattern passes into the core gradually, in proportion to the depth.
    pub fade: bool,
    /// Mixture below that depth.
    pub core: Mixture,
    /// How mixtures become labels.
    pub dither: Dither,
}

/// Octaves of smaller features than this are left out but for the first: a voxel's edge is 0.08 mm.
const FINEST_MM: f64 = 0.1;
/// Bound of what noise reaches.
const NOISE_BOUND: f64 = 2.0;

impl Texture {
    /// The label below a depth in mm (the second value), where the whole volume has one there.
    pub fn constant_core(&self) -> Option<(u8, f64)> {
        let pure = self.core.iter().position(|&f| f >= 1.0)?;
        Some((pure as u8 + 1, self.depth_mm * 2f64.powf(NOISE_BOUND * self.relief)))
    }

    /// Something that labels the voxels of a tile whose first voxel is `base`.
    pub fn painter<'a>(&'a self, blue: &'a BlueNoise, frame: &'a Frame, base: [i64; 3]) -> Painter<'a> {
        let offset = hash(self.seed ^ 0x5eed, 0, 0, 0);
        let place = move |local: [usize; 3]| {
            frame.centre_mm(std::array::from_fn(|a| base[a] + local[a] as i64)).map(|v| v / self.scale_mm)
        };
        let step = (0..3).map(|a| Lattice::STEP[a] as f64 * frame.pitch().mm()[a]).fold(0.0, f64::max);
        // Finer octaves than this are taken at every voxel.
        let smooth = |scale: f64| scale >= 3.0 * step;
        let octave = |o: u32| self.scale_mm * 0.5f64.powi(o as i32);
        let kept = (0..self.octaves).filter(|&o| o == 0 || octave(o) >= FINEST_MM).count() as u32;
        let coarse = (0..kept).filter(|&o| smooth(octave(o))).count();
        let (mut coarse, fine) = FractalNoise::new(self.seed, kept).split(coarse);
        let mut relief = GradientNoise::new(self.seed ^ 0xde_97);
        let wants_noise = matches!(self.pattern, Pattern::Bands | Pattern::Blend);
        let wants_relief = self.relief > 0.0 && self.depth_mm.is_finite();
        Painter {
            texture: self,
            blue,
            frame,
            base,
            coarse: (wants_noise && coarse.octaves() > 0).then(|| Lattice::new(|v| coarse.at(place(v)))),
            relief_lattice: (wants_relief && smooth(2.0 * self.scale_mm))
                .then(|| Lattice::new(|v| relief.at(place(v).map(|q| 0.5 * q)))),
            fine,
            relief,
            cells: VoronoiCells::new(self.seed),
            shift: unit(offset),
            offset: std::array::from_fn(|a| (offset >> (16 * a) & 0xff) as i64),
            mixture: self.core.clone(),
        }
    }
}

/// Labels the voxels of a tile; cheaper for neighbours in turn. Results do not depend on the order.
#[derive(Clone, Debug)]
pub struct Painter<'a> {
    texture: &'a Texture,
    blue: &'a BlueNoise,
    frame: &'a Frame,
    base: [i64; 3],
    coarse: Option<Lattice>,
    relief_lattice: Option<Lattice>,
    fine: FractalNoise,
    relief: GradientNoise,
    cells: VoronoiCells,
    shift: f64,
    offset: [i64; 3],
    mixture: Mixture,
}

impl Painter<'_> {
    /// The label of the voxel at an offset within the tile, `depth` mm below the surface.
    pub fn label(&mut self, local: [usize; 3], depth: f64) -> u8 {
        let t = self.texture;
        let voxel: [i64; 3] = std::array::from_fn(|a| self.base[a] + local[a] as i64);
        let [x, y, z] = voxel;
        let threshold = match t.dither {
            Dither::White => unit(hash(t.seed ^ 0x5eed, x, y, z)),
            // Inverse powers of the root of t^4 = t + 1: the three-dimensional golden ratio.
            Dither::Recurrence => {
                let sum = x as f64 * 0.819_172_513_396_164_4
                    + y as f64 * 0.671_043_606_703_789_2
                    + z as f64 * 0.549_700_477_901_970_2;
                (sum + self.shift).rem_euclid(1.0)
            }
            Dither::Blue => self.blue.at(std::array::from_fn(|a| voxel[a] + self.offset[a])),
        };
        let q = self.frame.centre_mm(voxel).map(|v| v / t.scale_mm);
        let mut reach = t.depth_mm;
        if t.relief > 0.0 && reach.is_finite() {
            let noise = match &self.relief_lattice {
                Some(lattice) => lattice.at(local),
                None => self.relief.at(q.map(|v| 0.5 * v)),
            };
            reach *= 2f64.powf(t.relief * noise);
        }
        if depth > reach {
            return pick(&t.core, threshold);
        }
        let n = t.palette.len();
        let (mixture, next, share) = match t.pattern {
            Pattern::Constant => (0, 0, 0.0),
            Pattern::Cells => ((self.cells.at(q) % n as u64) as usize, 0, 0.0),
            Pattern::Speckle => ((hash(t.seed, x, y, z) % n as u64) as usize, 0, 0.0),
            Pattern::Bands => ((self.level(local, q) * (2 * n) as f64) as usize % n, 0, 0.0),
            Pattern::Blend => {
                let at = self.level(local, q) * (n - 1) as f64;
                let low = (at as usize).min(n - 1);
                (low, (low + 1).min(n - 1), at - low as f64)
            }
        };
        let fade = if t.fade && reach.is_finite() { (depth / reach).clamp(0.0, 1.0) } else { 0.0 };
        if share == 0.0 && fade == 0.0 {
            return pick(&t.palette[mixture], threshold);
        }
        let ends = t.palette[mixture].iter().zip(&t.palette[next]);
        for ((out, (a, b)), core) in self.mixture.iter_mut().zip(ends).zip(&t.core) {
            let blend = a + share * (b - a);
            *out = blend + fade * (core - blend);
        }
        pick(&self.mixture, threshold)
    }

    /// Noise within 0..=1: it lies within about ±0.9, and its middle half holds most of its values.
    fn level(&mut self, local: [usize; 3], q: [f64; 3]) -> f64 {
        let noise = self.coarse.as_ref().map_or(0.0, |lattice| lattice.at(local)) + self.fine.at(q);
        (0.5 + 0.9 * noise).clamp(0.0, 1.0)
    }
}

/// The label whose share of 0..1 holds `threshold`.
fn pick(mixture: &[f64], threshold: f64) -> u8 {
    let mut sum = 0.0;
    for (i, fraction) in mixture.iter().enumerate() {
        sum += fraction;
        if threshold < sum {
            return i as u8 + 1;
        }
    }
    mixture.iter().rposition(|&f| f > 0.0).unwrap_or(0) as u8 + 1
}

/// The last material (white) with a little of another.
pub(crate) fn tint(rng: &mut impl Rng, materials: usize) -> Mixture {
    let mut uniform = || unit(rng.next_u64());
    let mut mixture = vec![0.0; materials];
    let amount = 0.3 * uniform().powi(2);
    mixture[((uniform() * materials as f64) as usize).min(materials - 1)] += amount;
    mixture[materials - 1] += 1.0 - amount;
    mixture
}

/// A random mixture: a pure material, two materials, a tint of the last (white), or anything.
pub(crate) fn random_mixture(rng: &mut impl Rng, materials: usize) -> Mixture {
    let mut uniform = || unit(rng.next_u64());
    let mut mixture = vec![0.0; materials];
    let any = |u: f64, n: usize| ((u * n as f64) as usize).min(n - 1);
    let white = materials - 1;
    match any(uniform(), 4) {
        0 => mixture[any(uniform(), materials)] = 1.0,
        1 => {
            let share = uniform();
            mixture[any(uniform(), materials)] += share;
            mixture[any(uniform(), materials)] += 1.0 - share;
        }
        2 => {
            // Quadratic towards white: pale tints are common in textures.
            let tint = uniform().powi(2);
            mixture[any(uniform(), materials)] += tint;
            mixture[white] += 1.0 - tint;
        }
        _ => {
            let weights: Vec<f64> = (0..materials).map(|_| -(1.0 - uniform()).ln()).collect();
            let sum: f64 = weights.iter().sum();
            mixture.iter_mut().zip(weights).for_each(|(m, w)| *m = w / sum.max(1e-300));
        }
    }
    mixture
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Pitch, TILE};
    use rand_pcg::Pcg64;

    /// The labels of a box of voxels, all at one depth.
    fn labels(texture: &Texture, size: [usize; 3], depth: f64) -> Vec<u8> {
        let blue = BlueNoise::new(Halftone::Ranked, Pitch::j750());
        let frame = Frame::new([0.0; 3], Pitch::j750(), size.map(|s| s as u32)).unwrap();
        let mut painters = std::collections::HashMap::new();
        (0..size.iter().product())
            .map(|i| {
                let voxel = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
                let base = voxel.map(|v| (v / TILE * TILE) as i64);
                let painter = painters.entry(base).or_insert_with(|| texture.painter(&blue, &frame, base));
                painter.label(voxel.map(|v| v % TILE), depth)
            })
            .collect()
    }

    #[test]
    fn smooth_fields_are_close_to_the_exact_ones() {
        let texture = Texture {
            seed: 3,
            pattern: Pattern::Blend,
            scale_mm: 1.5,
            octaves: 1,
            palette: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
            depth_mm: 1.0,
            relief: 1.0,
            fade: false,
            core: vec![0.5, 0.5],
            dither: Dither::White,
        };
        let blue = BlueNoise::new(Halftone::Ranked, Pitch::j750());
        let frame = Frame::new([0.0; 3], Pitch::j750(), [256; 3]).unwrap();
        let mut worst = 0.0f64;
        for tile in 0..100i64 {
            let base = [tile % 10, tile / 10, tile % 7].map(|t| t * TILE as i64);
            let mut painter = texture.painter(&blue, &frame, base);
            assert!(painter.coarse.is_some() && painter.relief_lattice.is_some());
            for i in 0..100 {
                let local = [i % 16, i * 3 % 16, i / 7];
                let voxel = std::array::from_fn(|a| base[a] + local[a] as i64);
                let q = frame.centre_mm(voxel).map(|v| v / texture.scale_mm);
                let smooth = painter.level(local, q);
                let exact = (0.5 + 0.9 * FractalNoise::new(3, 1).at(q)).clamp(0.0, 1.0);
                worst = worst.max((smooth - exact).abs());
            }
        }
        assert!(worst > 0.0 && worst < 0.03, "{worst}");
    }

    #[test]
    fn dithers_reproduce_the_mixture() {
        let mixture = vec![0.1, 0.0, 0.25, 0.05, 0.6];
        for dither in [Dither::White, Dither::Recurrence, Dither::Blue] {
            let texture = Texture {
                seed: 4,
                pattern: Pattern::Constant,
                scale_mm: 1.0,
                octaves: 1,
                palette: vec![mixture.clone()],
                depth_mm: f64::INFINITY,
                relief: 0.0,
                fade: false,
                core: vec![0.0, 0.0, 0.0, 0.0, 1.0],
                dither,
            };
            let mut counts = [0.0; 6];
            let n = 32;
            for label in labels(&texture, [n; 3], 0.1) {
                counts[usize::from(label)] += 1.0;
            }
            let total = (n * n * n) as f64;
            for (label, &fraction) in mixture.iter().enumerate() {
                // Five standard errors of independent draws; the recurrence does better.
                let error = (fraction * (1.0 - fraction) / total).sqrt();
                assert!((counts[label + 1] / total - fraction).abs() <= 5.0 * error, "{dither:?} {label}");
            }
        }
    }

    #[test]
    fn below_the_depth_is_the_core() {
        let texture = Texture {
            seed: 4,
            pattern: Pattern::Cells,
            scale_mm: 0.5,
            octaves: 1,
            palette: vec![vec![1.0, 0.0], vec![0.5, 0.5]],
            depth_mm: 0.3,
            relief: 0.0,
            fade: false,
            core: vec![0.0, 1.0],
            dither: Dither::White,
        };
        assert_eq!(texture.constant_core(), Some((2, 0.3)));
        assert!(labels(&texture, [200, 1, 1], 0.31).iter().all(|&l| l == 2));
        let above = labels(&texture, [200, 1, 1], 0.29);
        assert!(above.contains(&1) && above.contains(&2));
    }

    #[test]
    fn a_fade_passes_from_the_pattern_to_the_core_and_relief_moves_its_end() {
        let mut texture = Texture {
            seed: 8,
            pattern: Pattern::Constant,
            scale_mm: 0.5,
            octaves: 1,
            palette: vec![vec![1.0, 0.0]],
            depth_mm: 0.4,
            relief: 0.0,
            fade: true,
            core: vec![0.0, 1.0],
            dither: Dither::White,
        };
        let share = |texture: &Texture, depth: f64| {
            let labels = labels(texture, [1000, 2, 2], depth);
            labels.iter().filter(|&&l| l == 1).count() as f64 / 4000.0
        };
        // Four standard errors.
        let error = 4.0 * (0.25f64 / 4000.0).sqrt();
        for depth in [0.0, 0.1, 0.2, 0.3] {
            assert!((share(&texture, depth) - (1.0 - depth / 0.4)).abs() <= error, "{depth}");
        }
        assert_eq!(share(&texture, 0.41), 0.0);
        (texture.fade, texture.relief) = (false, 1.0);
        let part = share(&texture, 0.41);
        assert!(part > 0.1 && part < 0.9, "{part}");
        let (label, deepest) = texture.constant_core().unwrap();
        assert!(label == 2 && share(&texture, deepest) == 0.0);
    }

    #[test]
    fn random_mixtures_sum_to_one() {
        let mut rng = Pcg64::new(1, 2);
        for _ in 0..1000 {
            let m = random_mixture(&mut rng, 5);
            assert!((m.iter().sum::<f64>() - 1.0).abs() < 1e-12 && m.iter().all(|&f| f >= 0.0), "{m:?}");
        }
    }
}
