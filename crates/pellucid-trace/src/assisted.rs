//! Few paths a point, assisted by regression over patches of the surface. Biased.
//!
//! Radiance changes within 0.1 mm on a halftoned surface, so neighbours cannot be averaged. But how
//! it depends on the material below changes slowly: over a patch of some millimetres, a ridge
//! regression on what lies below each point (see the `features` module) predicts it to about 0.02,
//! however few the paths. The prediction and the point's own estimate are then mixed by the
//! variances that the residuals show, so that the estimate still converges with more paths.

use std::collections::BTreeMap;

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::features::{Composition, FEATURES};
use crate::tally::Tally;
use crate::{TraceError, Tracer};

/// Fewest points of a regression; smaller patches join their neighbour.
const MIN_POINTS: usize = 4 * FEATURES;

/// How radiances are shared between points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AssistOptions {
    /// Edge of a patch in mm, 0.1 to 100.
    pub patch_mm: f64,
    /// Ridge penalty on the coefficients, per point, above 0.
    pub ridge: f64,
}

impl Default for AssistOptions {
    fn default() -> Self {
        Self { patch_mm: 3.0, ridge: 1e-3 }
    }
}

/// Noisy values of points, `[point][value]`: radiances or anything linear in them, such as colours.
#[derive(Clone, Copy, Debug)]
pub struct Estimates<'a> {
    /// The channel whose coefficients explain each value.
    pub features_of: &'a [usize],
    /// Two independent halves of the paths.
    pub halves: [&'a [f32]; 2],
    /// What the values are without noise but for an error that is smooth or depends on the material below, as a network's
    /// does; only that error is then sought among the noise.
    pub guess: Option<&'a [f32]>,
}

impl Estimates<'_> {
    fn check(&self, points: usize, channels: usize, out: usize) -> Result<(), TraceError> {
        let per_point = self.features_of.len();
        let lengths = self.halves.iter().chain(&self.guess).map(|values| values.len());
        if out != points * per_point || lengths.clone().any(|length| length != out) {
            let lengths: Vec<usize> = lengths.collect();
            return Err(TraceError::invalid(
                "values",
                format!("{lengths:?} for {points} points of {per_point}"),
            ));
        }
        match self.features_of.iter().find(|&&c| c >= channels) {
            None => Ok(()),
            Some(c) => Err(TraceError::invalid("features_of", format!("{c}; there are {channels} channels"))),
        }
    }
}

impl AssistOptions {
    fn check(&self) -> Result<(), TraceError> {
        let in_range = (0.1..=100.0).contains(&self.patch_mm) && self.ridge > 0.0;
        if in_range && self.ridge.is_finite() {
            return Ok(());
        }
        Err(TraceError::invalid(
            "assist options",
            format!("{self:?}; patch_mm must lie within 0.1 to 100 and ridge above 0"),
        ))
    }
}

impl Tracer<'_> {
    /// As [`Tracer::radiance`], but each point borrows from its neighbours: **biased**, with an
    /// error of about 0.02 from 16 paths where plain tracing needs some 200.
    ///
    /// Meant for surfaces, not for scattered points: a patch needs a few hundred of them, and the
    /// result depends on which points are asked for together. The error is that of a model, not
    /// noise: it does not average out over iterations as that of [`Tracer::radiance`] does.
    ///
    /// # Errors
    /// As [`Tracer::radiance`], and [`TraceError::Invalid`] for options out of range.
    pub fn radiance_assisted(
        &self,
        points: &[u32],
        iteration: u32,
        options: &AssistOptions,
        radiance: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        options.check()?;
        let spp = self.options.spp;
        let channels = self.channels();
        let mut tallies = self.tallies_for(points, radiance.len())?;
        self.add_samples(points, iteration, 0..spp, &mut tallies, control)?;
        let own = |i: usize, c: usize| {
            let tally: &Tally = &tallies[i * channels + c];
            (tally.mean(spp), tally.cautious_variance(spp) / f64::from(spp))
        };
        let features_of: Vec<usize> = (0..channels).collect();
        let plan = Regression { features_of: &features_of, lattices: &[0.0], shrunk: false, options };
        self.regress(points, own, &plan, radiance, control)?;
        radiance.iter_mut().for_each(|l| *l = l.clamp(0.0, 1.0));
        Ok(())
    }

    /// Takes most of the noise out of values of few paths that are already there: as [`Tracer::radiance_assisted`], but
    /// nothing is traced. **Biased**: for pictures, not for figures.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for options out of range, a point or channel that does not exist, or lengths that do not
    /// fit; [`TraceError::Cancelled`].
    pub fn assist(
        &self,
        points: &[u32],
        estimates: &Estimates<'_>,
        options: &AssistOptions,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        options.check()?;
        let Estimates { features_of, halves, guess } = *estimates;
        estimates.check(points.len(), self.channels(), out.len())?;
        if let Some(p) = points.iter().find(|&&p| p as usize >= self.volume.len()) {
            return Err(TraceError::invalid("points", format!("{p}; there are {}", self.volume.len())));
        }
        let own = |i: usize, k: usize| {
            let at = i * features_of.len() + k;
            let [a, b] = halves.map(|half| f64::from(half[at]));
            (0.5 * (a + b) - guess.map_or(0.0, |guess| f64::from(guess[at])), (0.5 * (a - b)).powi(2))
        };
        let plan = Regression { features_of, lattices: &[0.0, 0.5], shrunk: guess.is_some(), options };
        self.regress(points, own, &plan, out, control)?;
        let guesses = guess.unwrap_or_default().iter().copied().chain(std::iter::repeat(0.0));
        out.iter_mut().zip(guesses).for_each(|(value, guess)| *value = (*value + guess).max(0.0));
        Ok(())
    }

    /// Mixes every value, of which `own` gives mean and variance by position in `points` and in `features_of`, with the
    /// regression over its patch.
    fn regress(
        &self,
        points: &[u32],
        own: impl Fn(usize, usize) -> (f64, f64) + Sync,
        plan: &Regression<'_>,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        let (per_point, patch_mm) = (plan.features_of.len(), plan.options.patch_mm);
        let mut sums = vec![0.0f32; out.len()];
        let mut weights = vec![0.0f32; points.len()];
        for &lattice in plan.lattices {
            let patches = self.patches(points, patch_mm, lattice);
            let fitted = patches
                .par_iter()
                .map(|members| {
                    control.check()?;
                    Ok(self.fit(points, members, &own, plan))
                })
                .collect::<Result<Vec<Vec<f32>>, TraceError>>()?;
            for (members, values) in patches.iter().zip(&fitted) {
                for (&i, values) in members.iter().zip(values.chunks_exact(per_point)) {
                    let i = i as usize;
                    let weight = self.inwardness(points[i], patch_mm, lattice);
                    weights[i] += weight;
                    let sums = sums[i * per_point..].iter_mut();
                    sums.zip(values).for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        for ((out, sums), weight) in
            out.chunks_exact_mut(per_point).zip(sums.chunks_exact(per_point)).zip(&weights)
        {
            out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum / weight);
        }
        Ok(())
    }

    /// The mixed values of a patch's members, `[member][value]`.
    fn fit(
        &self,
        points: &[u32],
        members: &[u32],
        own: &(impl Fn(usize, usize) -> (f64, f64) + Sync),
        plan: &Regression<'_>,
    ) -> Vec<f32> {
        let per_point = plan.features_of.len();
        let below: Vec<Composition> =
            members.iter().map(|&i| Composition::of(self.volume, points[i as usize])).collect();
        let mut values = vec![0.0f32; members.len() * per_point];
        let mut rows = vec![[0.0; FEATURES]; members.len()];
        for (k, &channel) in plan.features_of.iter().enumerate() {
            rows.iter_mut().zip(&below).for_each(|(row, b)| b.features(self.optics(channel), row));
            let own: Vec<(f64, f64)> = members.iter().map(|&i| own(i as usize, k)).collect();
            let mixed = mixed(&rows, &own, plan);
            values[k..].iter_mut().step_by(per_point).zip(mixed).for_each(|(value, mixed)| *value = mixed);
        }
        values
    }

    /// How far inside its patch a point lies: 1 in the middle, hardly more than 0 at a border.
    fn inwardness(&self, point: u32, patch_mm: f64, lattice: f64) -> f32 {
        let hat = |x: f64| 1.0 - (2.0 * (x / patch_mm + lattice).rem_euclid(1.0) - 1.0).abs();
        (self.volume.point_mm(point).map(hat).iter().product::<f64>() + 1e-3) as f32
    }

    /// Groups points by cubic cells; positions in `points`.
    fn patches(&self, points: &[u32], patch_mm: f64, lattice: f64) -> Vec<Vec<u32>> {
        let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for (i, &p) in points.iter().enumerate() {
            let cell = self.volume.point_mm(p).map(|x| (x / patch_mm + lattice).floor() as i64);
            cells.entry(cell).or_default().push(i as u32);
        }
        let mut patches: Vec<Vec<u32>> = Vec::new();
        for members in cells.into_values() {
            match patches.last_mut() {
                Some(last) if last.len() < MIN_POINTS || members.len() < MIN_POINTS => last.extend(members),
                _ => patches.push(members),
            }
        }
        patches
    }
}

/// What is regressed, and how.
struct Regression<'a> {
    features_of: &'a [usize],
    /// Lattices of patches, offset by that share of a patch: their results are blended by the distance from their patches'
    /// borders, which then do not show.
    lattices: &'a [f64],
    /// The values may well be nothing but noise.
    shrunk: bool,
    options: &'a AssistOptions,
}

/// The regression's prediction and each point's own mean, weighted by what the residuals say of
/// either's error.
fn mixed(rows: &[[f64; FEATURES]], own: &[(f64, f64)], plan: &Regression<'_>) -> Vec<f32> {
    let n = own.len() as f64;
    let values: Vec<f64> = own.iter().map(|(mean, _)| *mean).collect();
    let noise = own.iter().map(|(_, variance)| variance).sum::<f64>() / n;
    let mut fit = ridge(rows, &values, plan.options.ridge);
    if plan.shrunk {
        // By how much less than what is found noise alone would have made appear (James and Stein 1961).
        let found = fit.iter().map(|f| f * f).sum::<f64>() / n;
        let kept = (1.0 - noise * FEATURES as f64 / n / found.max(1e-12)).max(0.0);
        fit.iter_mut().for_each(|f| *f *= kept);
    }
    let freedom = (1.0 - FEATURES as f64 / n).max(0.1);
    let residual = fit.iter().zip(&values).map(|(f, v)| (f - v).powi(2)).sum::<f64>() / n / freedom;
    let misfit = (residual - noise).max(0.0);
    let share = misfit / (misfit + noise).max(1e-12);
    fit.iter().zip(&values).map(|(f, v)| (f + share * (v - f)) as f32).collect()
}

/// Fitted values of a ridge regression; the last feature, a constant, is not penalised.
fn ridge(rows: &[[f64; FEATURES]], values: &[f64], penalty: f64) -> Vec<f64> {
    let mut a = [[0.0f64; FEATURES]; FEATURES];
    let mut b = [0.0f64; FEATURES];
    for (row, value) in rows.iter().zip(values) {
        for i in 0..FEATURES {
            b[i] += row[i] * value;
            for j in 0..=i {
                a[i][j] += row[i] * row[j];
            }
        }
    }
    let n = rows.len() as f64;
    for i in 0..FEATURES {
        a[i][i] += if i + 1 < FEATURES { penalty * n } else { 1e-9 * n };
    }
    // Cholesky, in place in the lower triangle.
    for i in 0..FEATURES {
        for j in 0..=i {
            let mut s = a[i][j];
            for k in 0..j {
                s -= a[i][k] * a[j][k];
            }
            a[i][j] = if i == j { s.max(1e-12).sqrt() } else { s / a[j][j] };
        }
    }
    for i in 0..FEATURES {
        for k in 0..i {
            b[i] -= a[i][k] * b[k];
        }
        b[i] /= a[i][i];
    }
    for i in (0..FEATURES).rev() {
        for k in i + 1..FEATURES {
            b[i] -= a[k][i] * b[k];
        }
        b[i] /= a[i][i];
    }
    rows.iter().map(|row| row.iter().zip(&b).map(|(x, w)| x * w).sum()).collect()
}
