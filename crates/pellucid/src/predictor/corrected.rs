//! A fast predictor whose error is measured by another one on the way, and taken out.

use std::collections::BTreeMap;

use pellucid_refine::{AppearancePredictor, PredictError, Scene};
use pellucid_voxel::Control;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Coefficients of the error as a quadratic in the predicted value.
const TERMS: usize = 3;
/// Points that one task corrects.
const CHUNK: usize = 4096;

/// How the error is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// One in so many points is predicted by both, drawn anew in each iteration; at least 1.
    pub one_in: u32,
    /// Standard deviation in mm of the Gaussian within which a point's neighbours tell its error.
    pub radius_mm: f64,
    /// Weight that measurements keep from one iteration to the next, 0 to below 1.
    pub memory: f64,
}

impl Default for Correction {
    /// One point in four, 0.2 mm, 0.7: some 200 measurements tell the error of a point in a print of 27 um layers.
    fn default() -> Self {
        Self { one_in: 4, radius_mm: 0.2, memory: 0.7 }
    }
}

/// Predicts by `fast` and takes out the error that `unbiased` finds at some of the points: what is common to
/// all points of a brightness in a channel, by a quadratic, and of the rest what is common to neighbours. Put the
/// other way round, `fast` is a control variate of few, smoothed paths.
///
/// The loop of a refinement goes where its predictor errs in its favour. A network's error on an object that is
/// unlike its training is smooth in space and brightness, so few paths find it; its details have no noise. The
/// corrected value is unbiased as far as those two smoothings reach. It depends on which points are asked for,
/// not on the number of threads.
pub struct Corrected<F, U> {
    fast: F,
    unbiased: U,
    settings: Correction,
    quadratic: Vec<Quadratic>,
    field: Field,
}

impl<F: AppearancePredictor, U: AppearancePredictor> Corrected<F, U> {
    /// A predictor of two.
    ///
    /// # Errors
    /// [`PredictError`] naming the setting that is out of range.
    pub fn new(fast: F, unbiased: U, settings: Correction) -> Result<Self, PredictError> {
        let fine = settings.one_in >= 1
            && (0.01..=100.0).contains(&settings.radius_mm)
            && (0.0..1.0).contains(&settings.memory);
        if !fine {
            return Err(PredictError::invalid(
                "correction",
                format!("{settings:?}; one in 1 or more, 0.01 to 100 mm, memory from 0 to below 1"),
            ));
        }
        Ok(Self { fast, unbiased, settings, quadratic: Vec::new(), field: Field::default() })
    }

    /// The predictor that is corrected.
    pub fn fast(&self) -> &F {
        &self.fast
    }

    /// The same without correction.
    pub fn fast_mut(&mut self) -> &mut F {
        &mut self.fast
    }

    fn is_anchor(rng: &mut Pcg64, one_in: u32) -> bool {
        (u64::from(rng.next_u32()) * u64::from(one_in)) >> 32 == 0
    }
}

impl<F: AppearancePredictor, U: AppearancePredictor> AppearancePredictor for Corrected<F, U> {
    fn name(&self) -> &str {
        self.fast.name()
    }

    fn predict(
        &mut self,
        scene: &Scene<'_>,
        points: &[u32],
        iteration: u32,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.fast.predict(scene, points, iteration, out, control)?;
        let channels = scene.materials.channels();
        let mut rng = Pcg64::new(u128::from(iteration) << 64, 0x616e_6368_6f72);
        let anchors: Vec<usize> =
            (0..points.len()).filter(|_| Self::is_anchor(&mut rng, self.settings.one_in)).collect();
        let chosen: Vec<u32> = anchors.iter().map(|&i| points[i]).collect();
        let mut measured = vec![0.0; chosen.len() * channels];
        self.unbiased.predict(scene, &chosen, iteration, &mut measured, &control.silent())?;

        self.quadratic.resize(channels, Quadratic::default());
        for (c, quadratic) in self.quadratic.iter_mut().enumerate() {
            quadratic.fade(self.settings.memory);
            for (&i, measured) in anchors.iter().zip(measured.chunks_exact(channels)) {
                let predicted = out[i * channels + c];
                quadratic.add(predicted, measured[c] - predicted);
            }
        }
        let quadratic: Vec<[f64; TERMS]> = self.quadratic.iter().map(Quadratic::solve).collect();
        let common = |c: usize, value: f32| evaluate(&quadratic[c], value);

        let pitch = scene.grid.frame().pitch().mm();
        let at = |p: u32| {
            let voxel = scene.surface.voxels()[p as usize];
            std::array::from_fn(|a| f64::from(voxel[a]) * pitch[a])
        };
        self.field.fade(self.settings.memory);
        for (&i, measured) in anchors.iter().zip(measured.chunks_exact(channels)) {
            let rest = (0..channels).map(|c| {
                let predicted = out[i * channels + c];
                f64::from(measured[c] - predicted) - common(c, predicted)
            });
            self.field.add(at(points[i]), self.settings.radius_mm, rest);
        }
        let smooth = self.field.smoothed(channels, control)?;
        let radius = self.settings.radius_mm;
        out.par_chunks_mut(CHUNK * channels).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            let mut local = vec![0.0; channels];
            for (values, &p) in out.chunks_exact_mut(channels).zip(points) {
                smooth.at(at(p), radius, &mut local);
                for (c, value) in values.iter_mut().enumerate() {
                    *value = (f64::from(*value) + common(c, *value) + local[c]).max(0.0) as f32;
                }
            }
        });
        Ok(())
    }

    fn tiles_changed(&mut self, tiles: &[u32]) {
        self.fast.tiles_changed(tiles);
        self.unbiased.tiles_changed(tiles);
    }
}

/// Sums for a least-squares quadratic.
#[derive(Clone, Debug, Default)]
struct Quadratic {
    /// Σ v^k, k = 0..=4.
    moments: [f64; 2 * TERMS - 1],
    /// Σ v^k e.
    products: [f64; TERMS],
}

impl Quadratic {
    fn fade(&mut self, memory: f64) {
        self.moments.iter_mut().chain(&mut self.products).for_each(|s| *s *= memory);
    }

    fn add(&mut self, value: f32, error: f32) {
        let (value, error) = (f64::from(value), f64::from(error));
        let mut power = 1.0;
        for (k, moment) in self.moments.iter_mut().enumerate() {
            *moment += power;
            if let Some(product) = self.products.get_mut(k) {
                *product += power * error;
            }
            power *= value;
        }
    }

    /// The coefficients. A thousandth of the weight pulls each towards zero, which decides where all values are
    /// alike.
    fn solve(&self) -> [f64; TERMS] {
        let mut rows: [[f64; TERMS + 1]; TERMS] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if j < TERMS { self.moments[i + j] } else { self.products[i] })
        });
        for (i, row) in rows.iter_mut().enumerate() {
            row[i] += 1e-3 * self.moments[0] + f64::MIN_POSITIVE;
        }
        // Positive definite: elimination needs no exchange of rows.
        for i in 0..TERMS {
            for j in i + 1..TERMS {
                let factor = rows[j][i] / rows[i][i];
                for k in i..=TERMS {
                    rows[j][k] -= factor * rows[i][k];
                }
            }
        }
        let mut solution = [0.0; TERMS];
        for i in (0..TERMS).rev() {
            let known: f64 = (i + 1..TERMS).map(|j| rows[i][j] * solution[j]).sum();
            solution[i] = (rows[i][TERMS] - known) / rows[i][i];
        }
        solution
    }
}

fn evaluate(coefficients: &[f64; TERMS], value: f32) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * f64::from(value) + c)
}

/// Errors summed in cubic cells whose edge is the radius.
#[derive(Clone, Debug, Default)]
struct Field {
    /// Weight and sums by channel of each cell that has any.
    cells: BTreeMap<[i32; 3], (f64, Vec<f64>)>,
}

/// Cells to either side that a cell's error is smoothed over: three standard deviations.
const REACH: i32 = 3;
/// Weight of a prior without error, in measurements: places with few of them are hardly corrected.
const PRIOR: f64 = 4.0;

impl Field {
    fn fade(&mut self, memory: f64) {
        self.cells.retain(|_, (weight, sums)| {
            *weight *= memory;
            sums.iter_mut().for_each(|s| *s *= memory);
            *weight > 1e-3
        });
    }

    fn add(&mut self, at: [f64; 3], radius: f64, errors: impl ExactSizeIterator<Item = f64>) {
        let cell = at.map(|v| (v / radius).floor() as i32);
        let (weight, sums) = self.cells.entry(cell).or_insert_with(|| (0.0, vec![0.0; errors.len()]));
        *weight += 1.0;
        sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
    }

    /// The smoothed error at the centre of every cell that has one, or a neighbour that has.
    fn smoothed(&self, channels: usize, control: &Control<'_>) -> Result<Smoothed, PredictError> {
        let mut wanted: Vec<[i32; 3]> = Vec::new();
        for cell in self.cells.keys() {
            for n in 0..27 {
                let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
                wanted.push(std::array::from_fn(|a| cell[a] + step[a]));
            }
        }
        wanted.sort_unstable();
        wanted.dedup();
        let spread = |d: i32| (-0.5 * f64::from(d).powi(2)).exp();
        let values = wanted
            .par_iter()
            .map(|cell| {
                control.check()?;
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
                Ok((*cell, sums))
            })
            .collect::<Result<Vec<_>, PredictError>>()?;
        Ok(Smoothed(values.into_iter().collect()))
    }
}

/// A smoothed error by cell.
struct Smoothed(BTreeMap<[i32; 3], Vec<f64>>);

impl Smoothed {
    /// The error at a position, linear between the centres of cells; cells without one count as zero.
    fn at(&self, at: [f64; 3], radius: f64, out: &mut [f64]) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

    /// Radiance that a formula gives: of the position in mm, the channel, and a random number of mean 0.
    struct Formula<G>(G);

    impl<G: Fn([f64; 3], usize, f64) -> f64> AppearancePredictor for Formula<G> {
        fn name(&self) -> &str {
            "formula"
        }

        fn predict(
            &mut self,
            scene: &Scene<'_>,
            points: &[u32],
            iteration: u32,
            out: &mut [f32],
            _: &Control<'_>,
        ) -> Result<(), PredictError> {
            let pitch = scene.grid.frame().pitch().mm();
            let mut rng = Pcg64::new(7, u128::from(iteration));
            for (values, &p) in out.chunks_exact_mut(3).zip(points) {
                let voxel = scene.surface.voxels()[p as usize];
                let at = std::array::from_fn(|a| f64::from(voxel[a]) * pitch[a]);
                for (c, value) in values.iter_mut().enumerate() {
                    let noise = f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5;
                    *value = (self.0)(at, c, noise) as f32;
                }
            }
            Ok(())
        }
    }

    /// Stripes finer than any smoothing, of three brightnesses.
    fn truth(at: [f64; 3], c: usize) -> f64 {
        0.2 + 0.2 * c as f64 + 0.1 * (at[2] * 40.0).sin().signum()
    }

    /// Root mean square error after some iterations of a fast predictor off by `bias(at, channel, truth)`.
    fn error(bias: impl Fn([f64; 3], usize, f64) -> f64, noise: f64, settings: Correction) -> f64 {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [120, 70, 150]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let materials = MaterialTable::cmykw();
        let scene = Scene { grid: &grid, surface: &surface, materials: &materials };
        let points: Vec<u32> = (0..surface.len() as u32).collect();
        let fast = Formula(|at, c, _| truth(at, c) + bias(at, c, truth(at, c)));
        let unbiased = Formula(|at, c, random| truth(at, c) + noise * random);
        let mut corrected = Corrected::new(fast, unbiased, settings).unwrap();
        let mut out = vec![0.0; points.len() * 3];
        for iteration in 0..3 {
            corrected.predict(&scene, &points, iteration, &mut out, &Control::none()).unwrap();
        }
        let mut exact = vec![0.0; out.len()];
        Formula(|at, c, _| truth(at, c)).predict(&scene, &points, 0, &mut exact, &Control::none()).unwrap();
        let squares: f64 = out.iter().zip(&exact).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (squares / out.len() as f64).sqrt()
    }

    #[test]
    fn errors_smooth_in_brightness_and_space_are_taken_out() {
        let default = Correction::default();
        // Too bright in the dark, too dark in the light: 0.06 rms. What stays is the measurement's noise, 0.087 over
        // the root of some 200.
        let tone = |_: [f64; 3], _: usize, v: f64| 0.12 - 0.3 * v + 0.05 * v * v;
        assert!(error(tone, 0.3, default) < 0.01, "{}", error(tone, 0.3, default));
        // Waves of 4 mm over the surface: 0.035 rms. Smoothing and the prior leave a few per cent of them beside the
        // noise, and more at edges, where it reaches round the corner.
        let wave = |at: [f64; 3], c: usize, _: f64| 0.05 * ((at[0] + at[2]) * 1.57 + c as f64).sin();
        let waves = error(wave, 0.3, default);
        assert!(waves < 0.015, "{waves}");
        // What changes from voxel to voxel cannot be found, but is not made worse than the noise does: 0.03 stays.
        let fine = |at: [f64; 3], _: usize, _: f64| {
            0.03 * ((at[0] * 75.0).sin() * (at[1] * 37.0).sin() * (at[2] * 116.0).sin()).signum()
        };
        let kept = error(fine, 0.3, default);
        assert!((0.028..0.033).contains(&kept), "{kept}");
    }

    #[test]
    fn noise_of_the_measurement_hardly_passes() {
        let rms = |settings| error(|_, _, _| 0.0, 0.3, settings);
        // A uniform deviate of width 0.3 deviates by 0.087; some 200 are averaged.
        let default = rms(Correction::default());
        assert!(default > 1e-4 && default < 0.087 / 10.0, "{default}");
        // Without memory about three times as much variance.
        let forgetful = rms(Correction { memory: 0.0, ..Correction::default() });
        assert!(forgetful > 1.3 * default && forgetful < 2.5 * default, "{forgetful} {default}");
    }

    #[test]
    fn refuses_settings_out_of_range() {
        let fine = Correction::default();
        for bad in [
            Correction { one_in: 0, ..fine },
            Correction { radius_mm: 0.0, ..fine },
            Correction { radius_mm: f64::NAN, ..fine },
            Correction { memory: 1.0, ..fine },
        ] {
            let make = || Formula(|_: [f64; 3], _: usize, _: f64| 0.0);
            assert!(Corrected::new(make(), make(), bad).is_err(), "{bad:?}");
        }
    }
}
