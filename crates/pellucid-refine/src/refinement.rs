//! The loop: predict, compare, correct, halftone (Rittig et al. 2021, Figure 3; Sumin et al. 2019).

use std::time::Instant;

use pellucid_voxel::{AIR, Control, LabelGrid, MaterialTable, NearestSurface, Surface};
use rayon::prelude::*;

use crate::demand::{Demand, MAX_LABELS, Plan};
use crate::halftone::{Changes, Halftone};
use crate::layers::Layers;
use crate::smoothing::Smoother;
use crate::{
    AppearancePredictor, BlueNoiseMask, ErrorStats, InkModel, IterationReport, RefineError, RefineReport,
    RefineSettings, Scene,
};

/// CIEDE2000 by which a target must be moved to count as out of gamut.
const OUT_OF_GAMUT: f32 = 1.0;

/// What is refined towards what.
#[derive(Clone, Copy)]
pub struct RefineInput<'a> {
    /// Surface voxels of the grid.
    pub surface: &'a Surface,
    /// The nearest surface voxel of each voxel, at least to the coloured depth.
    pub nearest: &'a NearestSurface,
    /// Coefficients of the labels, over R, G and B.
    pub materials: &'a MaterialTable,
    /// Printable colours and their mixtures.
    pub ink: &'a dyn InkModel,
    /// The texture's colour at each surface voxel, linear RGB relative to the ink model's white.
    pub target: &'a [[f32; 3]],
    /// The target brought within reach of gamut and thickness, which the loop aims at.
    pub aim: &'a [[f32; 3]],
}

/// A finished refinement.
#[derive(Debug)]
pub struct Refined {
    /// The halftone before the first correction.
    pub unrefined: LabelGrid,
    /// What happened.
    pub report: RefineReport,
}

/// Rearranges the materials of `grid` until its predicted appearance comes close to the aim.
///
/// `grid` is solid, of any labels; those within the coloured depth are replaced by a halftone, deeper ones
/// stay. Iteration 0 is the aim extruded through the coloured depth. In each further iteration the predicted
/// lack is added to the demand, surface-first with overflow deeper, and halftoned again: the aim's own
/// mixture is kept near the surface only, and what the loop adds decides how deep colour goes. On success
/// `grid` holds the iterate with the least smoothed mean CIEDE2000 to the aim. The result does not depend on
/// the number of threads.
///
/// # Errors
/// [`RefineError::Invalid`] when settings are out of range, inputs do not fit together, or the predictor
/// returns values that are not finite; [`RefineError::Predict`]; [`RefineError::Cancelled`]. After an error
/// in the loop `grid` holds some iterate.
pub fn refine(
    grid: &mut LabelGrid,
    input: &RefineInput<'_>,
    predictor: &mut dyn AppearancePredictor,
    settings: &RefineSettings,
    control: &Control<'_>,
) -> Result<Refined, RefineError> {
    settings.check()?;
    check_input(grid, input, settings)?;
    let RefineInput { surface, nearest, materials, ink, target, aim } = *input;
    let raw_lab: Vec<[f32; 3]> = target.par_iter().map(|&t| ink.lab(t)).collect();
    let aim_lab: Vec<[f32; 3]> = aim.par_iter().map(|&t| ink.lab(t)).collect();
    let out_of_gamut =
        raw_lab.par_iter().zip(&aim_lab).filter(|(r, m)| ink.delta_e(**r, **m) > OUT_OF_GAMUT).count();

    let layers = Layers::new(settings.coloured_depth_mm, settings.layers);
    let available = layers.available(surface, nearest, grid.tile_dims());
    let plan = |iteration: u32| Plan {
        layers: &layers,
        available: &available,
        based: if iteration == 0 { layers.len() } else { layers.above(settings.base_mm).max(1) },
        veiled: if iteration == 0 { 0 } else { layers.above(settings.veil_mm) },
    };
    let mask = BlueNoiseMask::new(grid.frame().pitch(), settings.seed);
    let halftone = Halftone { surface, nearest, ink, mask: &mask };
    let smoother = Smoother::new(surface, settings.residual_blur_mm, &control.silent())?;
    let points: Vec<u32> = (0..surface.len() as u32).collect();
    let mut demand = Demand::new(aim);
    let mut report = RefineReport {
        predictor: predictor.name().to_owned(),
        surface_voxels: surface.len() as u64,
        out_of_gamut: out_of_gamut as f64 / surface.len().max(1) as f64,
        ..RefineReport::default()
    };
    let white = ink.media_white();
    let steps = u64::from(settings.iterations) + 1;
    let mut unrefined = None;
    let mut best: Option<(f64, Demand)> = None;
    let mut radiance = vec![0.0f32; surface.len() * 3];
    for iteration in 0..=settings.iterations {
        let start = Instant::now();
        let Changes { tiles, voxels, unspent } =
            halftone.apply(grid, &demand, &plan(iteration), &control.silent())?;
        let halftone_seconds = start.elapsed().as_secs_f64();
        if iteration == 0 {
            unrefined = Some(grid.clone());
        } else {
            predictor.tiles_changed(&tiles);
        }
        let start = Instant::now();
        let done = u64::from(iteration);
        let progress =
            |part: u64, total: u64| control.report(done * total.max(1) + part, steps * total.max(1));
        let inner = control.silent().with_progress(&progress);
        let scene = Scene { grid, surface, materials };
        predictor
            .predict(&scene, &points, iteration, &mut radiance, &inner)
            .map_err(|e| RefineError::predict(iteration, e))?;
        let predict_seconds = start.elapsed().as_secs_f64();
        if radiance.par_iter().any(|v| !v.is_finite()) {
            return Err(RefineError::invalid("prediction", "a radiance is not finite"));
        }
        let relative: Vec<[f32; 3]> =
            radiance.par_chunks_exact(3).map(|l| std::array::from_fn(|c| l[c] / white[c])).collect();
        let lab: Vec<[f32; 3]> = relative.par_iter().map(|&r| ink.lab(r)).collect();
        let errors = |to: &[[f32; 3]]| {
            ErrorStats::of(lab.par_iter().zip(to).map(|(a, b)| ink.delta_e(*a, *b)).collect())
        };
        // Smoothed as light adds up: the cube root of a few paths' mean is biased far down.
        let lack: Vec<[f32; 3]> = aim
            .par_iter()
            .zip(&relative)
            .map(|(aim, shown)| std::array::from_fn(|c| aim[c] - shown[c]))
            .collect();
        let reached = Demand::reached(aim, &smoother.apply(lack));
        let lack = demand.lack(&reached);
        let smoothed = ErrorStats::of(
            reached.par_iter().zip(&aim_lab).map(|(&r, m)| ink.delta_e(ink.lab(r), *m)).collect(),
        );
        report.iterations.push(IterationReport {
            iteration,
            raw: errors(&raw_lab),
            mapped: errors(&aim_lab),
            smoothed,
            label_flips: voxels,
            changed_tiles: tiles.len() as u64,
            halftone_seconds,
            predict_seconds,
        });
        if best.as_ref().is_none_or(|(mean, _)| smoothed.mean < *mean) {
            best = Some((smoothed.mean, demand.clone()));
            report.best = iteration;
        }
        if iteration < settings.iterations {
            demand.settle(&unspent);
            demand.add(&lack, settings.gain / (1.0 + settings.gain_decay * iteration as f32));
        }
    }
    // The last prediction judged the last labels; an earlier best is halftoned again.
    if let Some((_, best)) = best
        && report.best != settings.iterations
    {
        halftone.apply(grid, &best, &plan(report.best), &control.silent())?;
    }
    let unrefined = unrefined.unwrap_or_else(|| grid.clone());
    Ok(Refined { unrefined, report })
}

fn check_input(
    grid: &LabelGrid,
    input: &RefineInput<'_>,
    settings: &RefineSettings,
) -> Result<(), RefineError> {
    let surface = input.surface;
    if surface.frame() != grid.frame() || input.nearest.frame() != grid.frame() {
        return Err(RefineError::invalid(
            "surface",
            "surface, nearest-surface map and grid must lie in the same frame",
        ));
    }
    if input.nearest.depth_mm() < settings.coloured_depth_mm {
        return Err(RefineError::invalid(
            "nearest",
            format!(
                "reaches {} mm deep; build it to the coloured depth of {} mm",
                input.nearest.depth_mm(),
                settings.coloured_depth_mm
            ),
        ));
    }
    for (field, colors) in [("target", input.target), ("aim", input.aim)] {
        if colors.len() != surface.len() {
            return Err(RefineError::invalid(
                field,
                format!("{} colours for {} surface voxels", colors.len(), surface.len()),
            ));
        }
        if colors.iter().flatten().any(|v| !v.is_finite()) {
            return Err(RefineError::invalid(field, "a colour is not finite"));
        }
    }
    if input.materials.channels() != 3 {
        return Err(RefineError::invalid(
            "materials",
            format!("{} channels; R, G, B are needed", input.materials.channels()),
        ));
    }
    let labels = input.ink.labels();
    let known = |l: &u8| *l != AIR && input.materials.get(*l).is_some();
    if !(2..=MAX_LABELS).contains(&labels.len()) || !labels.iter().all(known) {
        return Err(RefineError::invalid("ink model", "needs 2 to 16 labels, each of the material table"));
    }
    Ok(())
}
