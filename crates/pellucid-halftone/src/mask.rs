//! A periodic three-dimensional blue-noise threshold mask that knows the pitch.

use pellucid_core::{Cancelled, Control};
use pellucid_voxel::Pitch;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Number of thresholds a mask aims at: about 1.3 mm along each edge at 600 x 300 x 940 DPI.
const TARGET_CELLS: f64 = 24_576.0;
/// Standard deviation of the Gaussian that measures crowding, in cube roots of a voxel's volume
/// (Ulichney 1993 uses 1.5 pixels).
const SIGMA_CELLS: f64 = 1.5;
/// The Gaussian is cut off at this many standard deviations.
const CUT_OFF: f64 = 3.5;

/// Thresholds, a permutation of `(rank + 0.5) / cells`, such that the voxels below any level are
/// spread evenly in millimetres: their spectrum has little energy at low frequencies.
///
/// Made by void-and-cluster (Ulichney 1993) in three dimensions, with distances measured in
/// millimetres so that an anisotropic pitch gives an isotropic pattern. Tiles space periodically.
///
/// ```
/// use pellucid_halftone::BlueNoiseMask;
/// use pellucid_voxel::{Control, Pitch};
/// let mask = BlueNoiseMask::with_size([8, 4, 12], Pitch::j750(), 1, &Control::none())?;
/// let below = (0..384).filter(|i| mask.threshold([i % 8, i / 8 % 4, i / 32]) < 0.25).count();
/// assert_eq!(below, 96);
/// assert_eq!(mask.threshold([3, 1, 2]), mask.threshold([3 + 8, 1 + 4, 2 + 24]));
/// # Ok::<(), pellucid_core::Cancelled>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BlueNoiseMask {
    size: [u32; 3],
    thresholds: Vec<f32>,
}

impl BlueNoiseMask {
    /// Longest edge of a mask in voxels.
    pub const MAX_EDGE: u32 = 256;

    /// A mask about as long in millimetres along each axis as the pitch allows, of about 25,000
    /// thresholds. The same pitch and seed give the same mask.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(pitch: Pitch, seed: u64, control: &Control<'_>) -> Result<Self, Cancelled> {
        let edge_mm = (TARGET_CELLS * pitch.volume_mm3()).cbrt();
        let size = pitch.mm().map(|p| ((edge_mm / p).round() as u32).clamp(2, 64));
        Self::with_size(size, pitch, seed, control)
    }

    /// A mask of `size` voxels along `[x, y, z]`, each edge clamped to 1..=[`Self::MAX_EDGE`]. Time grows with the
    /// square of the number of voxels. Progress counts thresholds.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn with_size(
        size: [u32; 3],
        pitch: Pitch,
        seed: u64,
        control: &Control<'_>,
    ) -> Result<Self, Cancelled> {
        let size = size.map(|s| s.clamp(1, Self::MAX_EDGE));
        let mut field = Crowding::new(size, pitch);
        let cells = field.energy.len();
        let initial = (cells / 10).max(1);
        scatter(&mut field, initial, seed, control)?;
        let prototype = field.clone();

        let mut ranks = vec![0u32; cells];
        for rank in (0..initial).rev() {
            control.check()?;
            let cluster = field.tightest_cluster();
            field.toggle(cluster);
            ranks[cluster] = rank as u32;
        }
        field = prototype;
        for rank in initial..cells {
            control.check()?;
            let void = field.largest_void();
            field.toggle(void);
            ranks[void] = rank as u32;
            control.report(rank as u64 + 1, cells as u64);
        }
        let thresholds = ranks.iter().map(|&r| ((f64::from(r) + 0.5) / cells as f64) as f32).collect();
        Ok(Self { size, thresholds })
    }

    /// The same mask whose layer 0 is its layer `first`.
    ///
    /// ```
    /// # use pellucid_halftone::BlueNoiseMask;
    /// # use pellucid_voxel::{Control, Pitch};
    /// let mask = BlueNoiseMask::with_size([8, 4, 12], Pitch::j750(), 1, &Control::none())?;
    /// assert_eq!(mask.clone().from_layer(31).threshold([3, 1, 2]), mask.threshold([3, 1, 33]));
    /// # Ok::<(), pellucid_core::Cancelled>(())
    /// ```
    pub fn from_layer(mut self, first: u32) -> Self {
        let [sx, sy, sz] = self.size.map(|s| s as usize);
        self.thresholds.rotate_left(first as usize % sz * sx * sy);
        self
    }

    /// Voxels of one period along `[x, y, z]`.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// The threshold of a voxel, above 0 and below 1; periodic.
    #[inline]
    pub fn threshold(&self, voxel: [u32; 3]) -> f32 {
        let [x, y, z] = std::array::from_fn(|a| (voxel[a] % self.size[a]) as usize);
        self.row(y as u32, z as u32)[x]
    }

    /// The thresholds of one period along x at row `y` of layer `z`; periodic in both.
    #[inline]
    pub fn row(&self, y: u32, z: u32) -> &[f32] {
        let [sx, sy, sz] = self.size.map(|s| s as usize);
        let start = ((z as usize % sz) * sy + y as usize % sy) * sx;
        &self.thresholds[start..start + sx]
    }
}

/// Places `count` points at random and spreads them until the tightest cluster is also the
/// largest void.
fn scatter(field: &mut Crowding, count: usize, seed: u64, control: &Control<'_>) -> Result<(), Cancelled> {
    let cells = field.energy.len();
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut placed = 0;
    while placed < count {
        let cell = (random.next_u64() % cells as u64) as usize;
        if !field.on[cell] {
            field.toggle(cell);
            placed += 1;
        }
    }
    // Each swap lowers the total crowding, so this ends; rounding could only make it cycle.
    for _ in 0..4 * cells {
        control.check()?;
        let cluster = field.tightest_cluster();
        field.toggle(cluster);
        let void = field.largest_void();
        field.toggle(void);
        if void == cluster {
            break;
        }
    }
    Ok(())
}

/// A binary pattern and, at each cell, the Gaussian-weighted number of points around it.
#[derive(Clone)]
struct Crowding {
    size: [usize; 3],
    on: Vec<bool>,
    energy: Vec<f32>,
    /// `energy` where a point is off, infinite where it is on.
    void: Vec<f32>,
    /// Offsets and weights: `(dy, dz, first dx, weights along x)`, all within half a period.
    rows: Vec<([usize; 3], Vec<f32>)>,
}

impl Crowding {
    fn new(size: [u32; 3], pitch: Pitch) -> Self {
        let size = size.map(|s| s as usize);
        let mm = pitch.mm();
        let sigma = SIGMA_CELLS * pitch.volume_mm3().cbrt();
        let reach = |a: usize| ((CUT_OFF * sigma / mm[a]).ceil() as i64).min((size[a] as i64 - 1) / 2);
        let square = |a: usize, d: i64| (d as f64 * mm[a] / sigma).powi(2);
        let wrap = |a: usize, d: i64| d.rem_euclid(size[a] as i64) as usize;
        let [rx, ry, rz] = [reach(0), reach(1), reach(2)];
        let rows = (-rz..=rz)
            .flat_map(|dz| (-ry..=ry).map(move |dy| (dy, dz)))
            .map(|(dy, dz)| {
                let weights = (-rx..=rx)
                    .map(|dx| (-0.5 * (square(0, dx) + square(1, dy) + square(2, dz))).exp() as f32)
                    .collect();
                ([wrap(0, -rx), wrap(1, dy), wrap(2, dz)], weights)
            })
            .collect();
        let cells = size.iter().product();
        Self { size, on: vec![false; cells], energy: vec![0.0; cells], void: vec![0.0; cells], rows }
    }

    /// Turns a cell on or off.
    fn toggle(&mut self, cell: usize) {
        let [sx, sy, sz] = self.size;
        let [x, y, z] = [cell % sx, cell / sx % sy, cell / sx / sy];
        let sign = if self.on[cell] { -1.0 } else { 1.0 };
        self.on[cell] = !self.on[cell];
        for (start, weights) in &self.rows {
            let base = ((z + start[2]) % sz * sy + (y + start[1]) % sy) * sx;
            let first = (x + start[0]) % sx;
            let split = weights.len().min(sx - first);
            for (range, part) in [
                (base + first..base + first + split, &weights[..split]),
                (base..base + weights.len() - split, &weights[split..]),
            ] {
                for ((energy, void), weight) in
                    self.energy[range.clone()].iter_mut().zip(&mut self.void[range]).zip(part)
                {
                    *energy += sign * weight;
                    *void += sign * weight;
                }
            }
        }
        self.void[cell] = if self.on[cell] { f32::INFINITY } else { self.energy[cell] };
    }

    /// The off cell with the least crowding, the first of equals.
    fn largest_void(&self) -> usize {
        const LANES: usize = 16;
        let mut least = [f32::INFINITY; LANES];
        for chunk in self.void.chunks_exact(LANES) {
            for (l, &v) in least.iter_mut().zip(chunk) {
                *l = if v < *l { v } else { *l };
            }
        }
        let tail = self.void.chunks_exact(LANES).remainder();
        let least = least.iter().chain(tail).copied().fold(f32::INFINITY, f32::min);
        self.void.iter().position(|&v| v == least).unwrap_or(0)
    }

    /// The on cell with the most crowding, the first of equals.
    fn tightest_cluster(&self) -> usize {
        let mut best = (f32::NEG_INFINITY, 0);
        for (cell, (&energy, &on)) in self.energy.iter().zip(&self.on).enumerate() {
            if on && energy > best.0 {
                best = (energy, cell);
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    fn made(size: [u32; 3], pitch: Pitch, seed: u64) -> BlueNoiseMask {
        BlueNoiseMask::with_size(size, pitch, seed, &Control::none()).unwrap()
    }

    #[test]
    fn thresholds_are_pinned() {
        let mask = BlueNoiseMask::new(Pitch::j750(), 5, &Control::none()).unwrap();
        let bits = mask.thresholds.iter().map(|t| u64::from(t.to_bits()));
        let digest = bits.fold(0u64, |d, b| pellucid_core::random::mix(d ^ b));
        assert_eq!((mask.size, digest), ([32, 16, 49], 11_450_771_844_689_090_789));
    }

    #[test]
    fn cancelling_stops_half_way() {
        let stop = AtomicBool::new(false);
        let progress = |done: u64, total: u64| stop.store(2 * done > total, Ordering::Relaxed);
        let control = Control::none().with_cancel(&stop).with_progress(&progress);
        assert_eq!(BlueNoiseMask::with_size([8; 3], Pitch::j750(), 0, &control), Err(Cancelled));
    }

    fn voxels(size: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
        let [sx, sy, sz] = size;
        (0..sz).flat_map(move |z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])))
    }

    /// Power of the pattern below `level` at each wave number along `axis`, the white-noise
    /// expectation of the same density being 1.
    fn power(mask: &BlueNoiseMask, level: f32, axis: usize) -> Vec<f64> {
        let size = mask.size();
        let cells: u32 = size.iter().product();
        let mut sums = vec![0.0; size[axis] as usize];
        voxels(size).filter(|&v| mask.threshold(v) < level).for_each(|v| sums[v[axis] as usize] += 1.0);
        let variance = f64::from(cells) * f64::from(level) * (1.0 - f64::from(level));
        (1..=size[axis] / 2)
            .map(|k| {
                let (mut re, mut im) = (0.0, 0.0);
                for (i, s) in sums.iter().enumerate() {
                    let phase = std::f64::consts::TAU * f64::from(k) * i as f64 / f64::from(size[axis]);
                    re += s * phase.cos();
                    im += s * phase.sin();
                }
                (re * re + im * im) / variance
            })
            .collect()
    }

    #[test]
    fn thresholds_are_a_permutation_and_reproducible() {
        let mask = made([16, 8, 25], Pitch::j750(), 3);
        let mut sorted: Vec<f32> = voxels(mask.size()).map(|v| mask.threshold(v)).collect();
        sorted.sort_by(f32::total_cmp);
        for (i, t) in sorted.iter().enumerate() {
            assert!((f64::from(*t) * 3200.0 - i as f64 - 0.5).abs() < 1e-3);
        }
        assert_eq!(mask, made([16, 8, 25], Pitch::j750(), 3));
        assert_ne!(mask, made([16, 8, 25], Pitch::j750(), 4));
    }

    #[test]
    fn low_frequencies_are_quiet_along_each_axis_in_millimetres() {
        let pitch = Pitch::j750();
        let mask = BlueNoiseMask::new(pitch, 0, &Control::none()).unwrap();
        for level in [0.05, 0.1, 0.3, 0.5, 0.8] {
            // Waves longer than three mean distances between the rarer kind of voxel.
            let rare = f64::from(level).min(1.0 - f64::from(level));
            let spacing = (pitch.volume_mm3() / rare).cbrt();
            for axis in 0..3 {
                let period = f64::from(mask.size()[axis]) * pitch.mm()[axis];
                let waves = ((period / (3.0 * spacing)) as usize).max(1);
                let power = power(&mask, level, axis);
                let mean = power[..waves.min(power.len())].iter().sum::<f64>() / waves as f64;
                assert!(mean < 0.15, "level {level}, axis {axis}: {mean}");
            }
        }
    }

    #[test]
    fn neighbours_keep_their_distance_in_millimetres() {
        // Of a sparse pattern, the nearest other point lies in no preferred direction: the mean
        // squared offsets in mm agree between the axes far better than those in voxels do.
        let pitch = Pitch::new([0.04, 0.08, 0.02]).unwrap();
        let mask = made([32, 16, 64], pitch, 5);
        let points: Vec<_> = voxels(mask.size()).filter(|&v| mask.threshold(v) < 0.02).collect();
        let mut squares = [0.0f64; 3];
        for p in &points {
            let offset = |q: &[u32; 3]| -> [f64; 3] {
                std::array::from_fn(|a| {
                    let size = i64::from(mask.size()[a]);
                    let d = (i64::from(p[a]) - i64::from(q[a])).rem_euclid(size);
                    d.min(size - d) as f64 * pitch.mm()[a]
                })
            };
            let norm = |d: [f64; 3]| d.iter().map(|d| d * d).sum::<f64>();
            let nearest = points
                .iter()
                .filter(|q| *q != p)
                .map(offset)
                .min_by(|a, b| norm(*a).total_cmp(&norm(*b)))
                .unwrap();
            (0..3).for_each(|a| squares[a] += nearest[a] * nearest[a]);
        }
        let mean = squares.iter().sum::<f64>() / 3.0;
        for (axis, s) in squares.iter().enumerate() {
            assert!((0.6..1.5).contains(&(s / mean)), "axis {axis}: {}", s / mean);
        }
    }

    #[test]
    fn tiny_and_flat_masks_are_complete() {
        for size in [[1, 1, 1], [2, 1, 3], [1, 9, 1]] {
            let mask = made(size, Pitch::j750(), 0);
            let sum: f64 = voxels(size).map(|v| f64::from(mask.threshold(v))).sum();
            assert!((sum - f64::from(size.iter().product::<u32>()) / 2.0).abs() < 1e-4);
        }
    }
}
