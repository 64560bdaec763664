//! The refinement loop.

use std::time::Instant;

use pellucid_voxel::{Control, LabelGrid, MaterialTable, NearestSurface, Surface};
use rayon::prelude::*;

use crate::demand::{Demand, advance};
use crate::halftone::{Changes, Halftone};
use crate::layers::{DepthLayers, available, reach_mm};
use crate::metrics::{differences, stats};
use crate::smooth::smooth;
use crate::table::DemandTable;
use crate::{
    AppearancePredictor, BlueNoiseMask, ErrorStats, InkModel, IterationReport, RefineError, RefineReport,
    RefineSettings, Scene, density,
};

/// What is refined towards what.
#[derive(Clone, Copy)]
pub struct RefineInput<'a> {
    /// Surface voxels of the grid.
    pub surface: &'a Surface,
    /// The nearest surface voxel of each voxel, at least to the coloured depth.
    pub nearest: &'a NearestSurface,
    /// Coefficients of the labels.
    pub materials: &'a MaterialTable,
    /// Printable colours and their mixtures.
    pub ink: &'a dyn InkModel,
    /// Target of each surface voxel: media-relative linear RGB, print white = 1.
    pub target: &'a [[f32; 3]],
    /// The target brought into reach (gamut and thickness), which the loop aims at; `None` maps
    /// `target` by [`InkModel::gamut_map`].
    pub aim: Option<&'a [[f32; 3]]>,
}

/// A second predictor that scores the iterations at a fixed set of surface voxels, such as a path
/// tracer with many paths beside a biased or noisy predictor in the loop.
pub struct Judge<'a> {
    /// Predicts the scored voxels. It is asked with the same iteration number each time, so that
    /// its random error is the same for all iterations.
    pub predictor: &'a mut dyn AppearancePredictor,
    /// Indices into the surface.
    pub points: &'a [u32],
}

/// A state of the labels that was predicted.
pub struct RefineState<'a> {
    /// Its errors and times.
    pub report: &'a IterationReport,
    /// Its labels.
    pub grid: &'a LabelGrid,
    /// Its absolute radiance in the loop, `[surface voxel][channel]`.
    pub radiance: &'a [f32],
    /// True when it is the best so far.
    pub best: bool,
}

/// Called after each iteration, first with the unrefined halftone.
pub type Observer<'a> = dyn FnMut(&RefineState<'_>) + 'a;

/// Refines the material arrangement of `grid` until its predicted appearance is as near to the
/// target as it gets, and leaves the best state in `grid`.
///
/// `grid` is solid on entry, of any labels; they are overwritten. Iteration 0 is the target colour
/// extruded through the coloured depth and halftoned. Each further iteration predicts, adds the
/// residual to the surface voxels' density budgets, spreads them over depth surface first (with
/// overflow moved deeper and windup cut off) and halftones again. The iteration with the least
/// mean CIEDE2000 to the aim is kept: as scored by `judge`, or else by the loop's own prediction.
/// The latter is fair as long as a noisy predictor draws fresh numbers in every iteration, since
/// each state's noise is then independent of the state and raises all means alike.
///
/// The result depends on inputs, settings and seed only, not on the number of threads.
/// `control` reports predictions finished, of all.
///
/// # Errors
/// [`RefineError::Invalid`] or [`RefineError::Unsupported`] for settings or inputs that do not fit
/// together, with the grid untouched. [`RefineError::Cancelled`] or [`RefineError::Predict`] later
/// on: the grid then holds the best state predicted so far.
pub fn refine(
    grid: &mut LabelGrid,
    input: &RefineInput<'_>,
    predictor: &mut dyn AppearancePredictor,
    mut judge: Option<Judge<'_>>,
    settings: &RefineSettings,
    observer: &mut Observer<'_>,
    control: &Control<'_>,
) -> Result<RefineReport, RefineError> {
    let setup = Setup::new(grid, input, settings)?;
    if let Some(bad) = judge.iter().flat_map(|j| j.points).find(|p| **p as usize >= input.surface.len()) {
        return Err(RefineError::invalid(
            "judge points",
            format!("{bad} of a surface with {} voxels", input.surface.len()),
        ));
    }
    let mut report = RefineReport {
        predictor: predictor.name().to_owned(),
        surface_voxels: input.surface.len() as u64,
        out_of_gamut: setup.out_of_gamut,
        thin: setup.thin,
        ..RefineReport::default()
    };
    let points: Vec<u32> = (0..input.surface.len() as u32).collect();
    let mut radiance = vec![0.0f32; points.len() * input.materials.channels()];
    let mut demand = Demand::extrusion(&setup.aim);
    let mut best: Option<(f64, Demand)> = None;

    let mut run = || -> Result<(), RefineError> {
        for iteration in 0..=settings.iterations {
            control.check()?;
            let start = Instant::now();
            let changes = setup.halftone.apply(grid, &demand);
            if iteration > 0 {
                predictor.tiles_changed(&changes.tiles);
                if let Some(judge) = &mut judge {
                    judge.predictor.tiles_changed(&changes.tiles);
                }
            }
            let halftone_seconds = start.elapsed().as_secs_f64();
            let start = Instant::now();
            let scene = Scene { grid, surface: input.surface, materials: input.materials };
            predictor
                .predict(&scene, &points, iteration, &mut radiance, &control.silent())
                .map_err(|e| RefineError::predict(iteration, e))?;
            let seen = setup.relative(&radiance);
            let predict_seconds = start.elapsed().as_secs_f64();
            let (raw, mapped) = match &mut judge {
                Some(judge) => setup.judged(judge, &scene, iteration, control)?,
                None => setup.scored(&seen, None),
            };
            let state = IterationReport {
                iteration,
                raw,
                mapped,
                label_flips: changes.flips,
                changed_tiles: changes.tiles.len() as u64,
                halftone_seconds,
                predict_seconds,
            };
            let better = best.as_ref().is_none_or(|(least, _)| mapped.mean < *least);
            if better {
                best = Some((mapped.mean, demand.clone()));
                report.best = iteration;
            }
            observer(&RefineState { report: &state, grid, radiance: &radiance, best: better });
            report.iterations.push(state);
            control.report(u64::from(iteration) + 1, u64::from(settings.iterations) + 1);
            if iteration < settings.iterations {
                setup.correct(&mut demand, &seen, iteration + 1);
            }
        }
        Ok(())
    };
    let outcome = run();
    if let Some((_, kept)) = &best {
        setup.halftone.apply(grid, kept);
    }
    outcome.map(|()| report)
}

/// Halftones the unrefined state, iteration 0 of [`refine`], into `grid`. Returns the positions of
/// the tiles that changed.
///
/// # Errors
/// As [`refine`], before any prediction.
pub fn initial_halftone(
    grid: &mut LabelGrid,
    input: &RefineInput<'_>,
    settings: &RefineSettings,
) -> Result<Vec<u32>, RefineError> {
    let setup = Setup::new(grid, input, settings)?;
    let Changes { tiles, .. } = setup.halftone.apply(grid, &Demand::extrusion(&setup.aim));
    Ok(tiles)
}

/// What does not change over the iterations.
struct Setup<'a> {
    input: RefineInput<'a>,
    settings: &'a RefineSettings,
    halftone: Halftone<'a>,
    aim: Vec<[f32; 3]>,
    available: Vec<u8>,
    out_of_gamut: f64,
    thin: f64,
}

impl<'a> Setup<'a> {
    fn new(
        grid: &LabelGrid,
        input: &RefineInput<'a>,
        settings: &'a RefineSettings,
    ) -> Result<Self, RefineError> {
        settings.check()?;
        check_input(grid, input, settings)?;
        let table = DemandTable::build(input.ink)?;
        let white = table.labels()[table.labels().len() - 1];
        let layers = DepthLayers::new(settings, reach_mm(input.materials, white, settings.reach)?);
        let aim = match input.aim {
            Some(aim) => aim.to_vec(),
            None => input.target.par_iter().map(|c| input.ink.gamut_map(*c)).collect(),
        };
        let available = available(grid, input.surface, input.nearest, &layers);
        let share = |count: usize| count as f64 / input.surface.len().max(1) as f64;
        let moved = differences(input.ink, &aim, input.target);
        let out_of_gamut = share(moved.iter().filter(|d| **d > 1.0).count());
        let thin = share(available.iter().filter(|a| usize::from(**a) < layers.count()).count());
        let mask = BlueNoiseMask::new(grid.frame().pitch(), settings.seed);
        let halftone = Halftone { surface: input.surface, nearest: input.nearest, table, layers, mask };
        Ok(Self { input: *input, settings, halftone, aim, available, out_of_gamut, thin })
    }

    /// Media-relative colours of a radiance array.
    fn relative(&self, radiance: &[f32]) -> Vec<[f32; 3]> {
        radiance
            .par_chunks_exact(self.input.materials.channels())
            .map(|r| self.input.ink.relative_rgb(r))
            .collect()
    }

    /// Errors of the colours of all surface voxels, or of `points`, to target and aim.
    fn scored(&self, seen: &[[f32; 3]], points: Option<&[u32]>) -> (ErrorStats, ErrorStats) {
        let of = |target: &[[f32; 3]]| match points {
            None => stats(self.input.ink, seen, target),
            Some(points) => {
                let some: Vec<_> = points.iter().map(|&p| target[p as usize]).collect();
                stats(self.input.ink, seen, &some)
            }
        };
        (of(self.input.target), of(&self.aim))
    }

    fn judged(
        &self,
        judge: &mut Judge<'_>,
        scene: &Scene<'_>,
        iteration: u32,
        control: &Control<'_>,
    ) -> Result<(ErrorStats, ErrorStats), RefineError> {
        let mut radiance = vec![0.0f32; judge.points.len() * self.input.materials.channels()];
        judge
            .predictor
            .predict(scene, judge.points, 0, &mut radiance, &control.silent())
            .map_err(|e| RefineError::predict(iteration, e))?;
        Ok(self.scored(&self.relative(&radiance), Some(judge.points)))
    }

    /// Corrects the demand by what was seen, as step `step` (from 1).
    fn correct(&self, demand: &mut Demand, seen: &[[f32; 3]], step: u32) {
        let s = self.settings;
        let gain = s.gain / (1.0 + s.gain_decay * (step - 1) as f32);
        let mut change: Vec<[f32; 3]> = seen
            .par_iter()
            .zip(&self.aim)
            .map(|(seen, aim)| std::array::from_fn(|c| gain * density::shortfall(aim[c], seen[c])))
            .collect();
        if s.residual_blur_mm > 0.0 {
            change = smooth(self.input.surface, &change, s.residual_blur_mm);
        }
        demand.compression = s.compression;
        advance(demand, &self.halftone.table, &self.halftone.layers, &self.available, &change);
    }
}

fn check_input(
    grid: &LabelGrid,
    input: &RefineInput<'_>,
    settings: &RefineSettings,
) -> Result<(), RefineError> {
    if input.surface.is_empty() {
        return Err(RefineError::invalid("surface", "has no voxels; the grid is empty"));
    }
    if input.surface.frame() != grid.frame() || input.nearest.frame() != grid.frame() {
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
    for (field, colours) in [("target", Some(input.target)), ("aim", input.aim)] {
        let Some(colours) = colours else { continue };
        if colours.len() != input.surface.len() {
            return Err(RefineError::invalid(
                field,
                format!("has {} colours for {} surface voxels", colours.len(), input.surface.len()),
            ));
        }
        if let Some(i) = colours.iter().position(|c| c.iter().any(|v| !v.is_finite())) {
            return Err(RefineError::invalid(field, format!("colour {i} is not finite")));
        }
    }
    let labels = input.ink.labels();
    if let Some(label) = labels.iter().find(|l| input.materials.get(**l).is_none()) {
        return Err(RefineError::invalid("ink labels", format!("{label} is not among the materials")));
    }
    Ok(())
}
