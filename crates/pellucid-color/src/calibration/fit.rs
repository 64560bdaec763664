//! The fit: white and black first, then every ink by itself, channel by channel.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use pellucid_voxel::{Control, Material, MaterialTable};
use rayon::prelude::*;

use super::checks;
use super::model::{Coefficients, Model, State};
use super::plan::Plan;
use super::result::{Calibration, Coefficient, MaterialFit, PatchFit};
use super::stage::{Measured, Stage};
use super::{Measurements, Patch};
use crate::ColorError;
use crate::delta_e::delta_e_2000;
use crate::plane_parallel::Solver;
use crate::space::Lab;
use crate::spectrum::Illuminant;

/// Directions per hemisphere: radiances are within 1e-5 of the exact ones.
const DIRECTIONS: usize = 16;

/// What is given, and how much scatter is taken for usual.
#[derive(Clone, Debug)]
pub struct FitOptions {
    /// Refractive index of all materials, 1 to 3.
    pub refractive_index: f64,
    /// Henyey-Greenstein mean cosine, -0.99 to 0.99.
    pub g: f64,
    /// Mean cosines of materials that have another one, by name.
    pub g_of: BTreeMap<String, f64>,
    /// Name of the white material.
    pub white: String,
    /// Name of the black material.
    pub black: String,
    /// Standard error of a measured radiance, as a part of it.
    pub relative_error: f64,
    /// Standard error of a measured radiance that does not depend on it: stray light, digits.
    pub least_error: f64,
    /// CIEDE2000 from which on measurement and fit contradict each other.
    pub most_delta_e: f64,
    /// Under which light colours are compared.
    pub illuminant: Illuminant,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            refractive_index: 1.5,
            g: 0.4,
            g_of: BTreeMap::new(),
            white: "white".into(),
            black: "black".into(),
            relative_error: 0.01,
            least_error: 0.0005,
            most_delta_e: 5.0,
            illuminant: Illuminant::D65,
        }
    }
}

impl FitOptions {
    fn check(&self) -> Result<(), ColorError> {
        let within = |what: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(ColorError::invalid(what, format!("{value} must lie within {low} to {high}")))
        };
        within("refractive index", self.refractive_index, 1.0, 3.0)?;
        self.g_of.values().chain([&self.g]).try_for_each(|g| within("g", *g, -0.99, 0.99))?;
        within("relative error", self.relative_error, 1e-5, 1.0)?;
        within("least error", self.least_error, 1e-6, 1.0)?;
        within("largest dE", self.most_delta_e, 0.01, 1000.0)
    }
}

/// What is known of one channel.
struct ChannelFit {
    /// By material of the plan.
    coefficients: Vec<Coefficients>,
    /// Covariance of the logarithms, by material.
    covariance: Vec<DMatrix<f64>>,
    /// By patch: measurements, then probes.
    radiance: Vec<f64>,
    /// Standard error of the probes' radiance.
    probe_error: Vec<f64>,
}

/// Fits scattering and absorption of every material and channel to measured layers.
///
/// Materials of patches that check are found from the others. The model is the exact solution for plane-parallel
/// layers ([`Solver`]). White and black are found together from patches of nothing else, then each ink from patches of
/// it, white and black. Progress counts channels.
///
/// ```
/// use pellucid_color::calibration::{FitOptions, Measurements, ReadOptions, fit};
/// use pellucid_voxel::Control;
/// let table = "patch,stack,LAB_L,LAB_A,LAB_B\n1,white 4 / black,92,0,2\n2,black,10,0,0\n";
/// let measurements = Measurements::parse(table, &ReadOptions::default())?;
/// let error = fit(&measurements, &FitOptions::default(), &Control::none()).unwrap_err();
/// assert!(error.to_string().contains("too few"));
/// # Ok::<(), pellucid_color::ColorError>(())
/// ```
///
/// # Errors
/// [`ColorError::Invalid`] for options out of range, too few patches to tell a material's coefficients or its colour
/// to `most_delta_e`, and measurements that contradict each other or any coefficients by more than that, naming them;
/// [`ColorError::Cancelled`].
pub fn fit(
    measurements: &Measurements,
    options: &FitOptions,
    control: &Control<'_>,
) -> Result<Calibration, ColorError> {
    options.check()?;
    checks::repeated_patches_agree(measurements, options)?;
    let plan = Plan::new(measurements, options)?;
    let channels = measurements.channels().count();
    let done = std::sync::atomic::AtomicU64::new(0);
    let solver = Solver::with_directions(options.refractive_index, DIRECTIONS)?;
    let fits = (0..channels)
        .into_par_iter()
        .map(|channel| {
            let fitted = fit_channel(&plan, measurements, options, &solver, channel, control)?;
            control.advance(&done, 1, channels as u64);
            Ok(fitted)
        })
        .collect::<Result<Vec<_>, ColorError>>()?;
    let patches = patches(measurements, options, &fits)?;
    checks::patches_agree(&patches, options)?;
    let fits_of_materials = material_fits(&plan, measurements, options, &fits)?;
    checks::colours_are_known(&fits_of_materials, options)?;
    let order = plan.table_order();
    let materials = order.iter().map(|&m| Material {
        name: plan.names[m].clone(),
        sigma_s: fits.iter().map(|fit| fit.coefficients[m][0] as f32).collect(),
        sigma_a: fits.iter().map(|fit| fit.coefficients[m][1] as f32).collect(),
        g: (plan.g[m] as f32).into(),
    });
    Ok(Calibration {
        materials: MaterialTable::over(measurements.channels().clone(), materials.collect())?,
        refractive_index: options.refractive_index,
        fits: order.iter().map(|&m| fits_of_materials[m].clone()).collect(),
        patches,
    })
}

fn fit_channel(
    plan: &Plan,
    measurements: &Measurements,
    options: &FitOptions,
    solver: &Solver,
    channel: usize,
    control: &Control<'_>,
) -> Result<ChannelFit, ColorError> {
    let list = measurements.list();
    let all = list.iter().map(|m| &m.patch).chain(&plan.probes);
    let model = Model::new(solver, &plan.names, &plan.g, all);
    let radiance: Vec<f64> = list.iter().map(|m| m.radiance[channel]).collect();
    let error: Vec<f64> =
        radiance.iter().map(|v| (options.relative_error * v).hypot(options.least_error)).collect();
    let mut state = model.state(vec![[1.0, 1.0]; plan.names.len()])?;
    let mut covariance = DMatrix::zeros(2 * plan.names.len(), 2 * plan.names.len());
    for step in &plan.steps {
        control.check()?;
        let mut stage = Stage {
            model: &model,
            state: &mut state,
            materials: &step.materials,
            patches: &step.patches,
            measured: Measured { radiance: &radiance, error: &error },
        };
        stage.solve(&step.starts)?;
        control.check()?;
        let spread = stage.spread(&step.held)?;
        let of = |materials: &[usize]| -> Vec<usize> {
            materials.iter().flat_map(|&m| [2 * m, 2 * m + 1]).collect()
        };
        let (own, held) = (of(&step.materials), of(&step.held));
        let of_held = covariance.select_rows(&held).select_columns(&held);
        let total = spread.own + &spread.by_held * of_held * spread.by_held.transpose();
        for (i, &row) in own.iter().enumerate() {
            for (j, &column) in own.iter().enumerate() {
                covariance[(row, column)] = total[(i, j)];
            }
        }
    }
    let covariance =
        (0..plan.names.len()).map(|m| covariance.view((2 * m, 2 * m), (2, 2)).into_owned()).collect();
    finish(plan, &model, state, list.len(), covariance)
}

fn finish(
    plan: &Plan,
    model: &Model<'_>,
    mut state: State,
    measured: usize,
    covariance: Vec<DMatrix<f64>>,
) -> Result<ChannelFit, ColorError> {
    let total = measured + plan.probes.len();
    let radiance =
        (0..total).map(|patch| model.radiance(&state, patch)).collect::<Result<Vec<_>, ColorError>>()?;
    let mut probe_error = Vec::with_capacity(plan.probes.len());
    const STEP: f64 = 1e-3;
    for (i, &material) in plan.probe_material.iter().enumerate() {
        let mut slope = nalgebra::DVector::zeros(2);
        for which in 0..2 {
            let mut moved = state.coefficients[material];
            moved[which] *= STEP.exp();
            let old = model.set(&mut state, material, moved)?;
            slope[which] = (model.radiance(&state, measured + i)? - radiance[measured + i]) / STEP;
            Model::put_back(&mut state, material, old);
        }
        probe_error.push((slope.transpose() * &covariance[material] * &slope)[(0, 0)].max(0.0).sqrt());
    }
    Ok(ChannelFit { coefficients: state.coefficients, covariance, radiance, probe_error })
}

/// From radiance by channel to L\*a\*b\*.
pub(super) fn lab_of(rows: &[Vec<f64>; 3], radiance: &[f64]) -> Lab {
    let rgb = [0, 1, 2].map(|c| rows[c].iter().zip(radiance).map(|(w, v): (&f64, &f64)| w * v).sum());
    Lab::from_linear_rgb(rgb)
}

fn patches(
    measurements: &Measurements,
    options: &FitOptions,
    fits: &[ChannelFit],
) -> Result<Vec<PatchFit>, ColorError> {
    let rows = options.illuminant.rows_for(measurements.channels())?;
    let all = measurements.list().iter().enumerate().map(|(i, m)| {
        let Patch { id, stack, check } = &m.patch;
        let predicted: Vec<f64> = fits.iter().map(|fit| fit.radiance[i]).collect();
        let (measured, predicted) = (lab_of(&rows, &m.radiance), lab_of(&rows, &predicted));
        let delta_e = delta_e_2000(measured, predicted);
        PatchFit { id: id.clone(), stack: stack.to_string(), check: *check, measured, predicted, delta_e }
    });
    Ok(all.collect())
}

/// By material of the plan.
fn material_fits(
    plan: &Plan,
    measurements: &Measurements,
    options: &FitOptions,
    fits: &[ChannelFit],
) -> Result<Vec<MaterialFit>, ColorError> {
    let rows = options.illuminant.rows_for(measurements.channels())?;
    let measured = measurements.list().len();
    let mut color_error = vec![0.0f64; plan.names.len()];
    for (i, &material) in plan.probe_material.iter().enumerate() {
        let radiance: Vec<f64> = fits.iter().map(|fit| fit.radiance[measured + i]).collect();
        let seen = lab_of(&rows, &radiance);
        let squared: f64 = (0..fits.len())
            .map(|channel| {
                let mut moved = radiance.clone();
                moved[channel] += fits[channel].probe_error[i];
                delta_e_2000(seen, lab_of(&rows, &moved)).powi(2)
            })
            .sum();
        color_error[material] = color_error[material].max(squared.sqrt());
    }
    let coefficients = |material: usize, which: usize| {
        let one = |fit: &ChannelFit| Coefficient {
            value: fit.coefficients[material][which],
            relative_error: fit.covariance[material][(which, which)].max(0.0).sqrt(),
        };
        fits.iter().map(one).collect()
    };
    let all = plan.names.iter().enumerate().map(|(m, name)| MaterialFit {
        name: name.clone(),
        sigma_s: coefficients(m, 0),
        sigma_a: coefficients(m, 1),
        color_error: color_error[m],
    });
    Ok(all.collect())
}
