//! Judging any labels against any target by fresh predictions.

mod classes;
mod effort;
mod errors;
mod judged;
mod mean_color;
mod noise;
mod passes;
mod shares;

use pellucid_color::Viewing;
use pellucid_core::random::{Domain, hash};
use pellucid_core::{Control, ErrorStats};
use pellucid_predict::{BoundPredictor, Capabilities, Changed, Object};
use pellucid_voxel::{LabelGrid, Surface, near_order};

use crate::difference::{differences, lab_of};
use crate::low_pass::{LOCAL_MM, LowPass};
use crate::problem::{check_colors, check_list};
use crate::{Problem, RefineError, SurfaceSmoother};

use noise::{Energy, mean_noise, mean_of, noise_of, without_noise};
use passes::{Halves, Meter};
use shares::divided;

pub use classes::ColorClass;
pub use effort::Effort;
pub use errors::{ClassErrors, Errors, Evaluation, Sharpness, StateErrors};
pub use judged::Judged;
pub use mean_color::MeanColor;
pub use shares::ErrorShares;

/// Standard deviations in mm of the Gaussians after which errors are taken.
const RADII_MM: [f64; 3] = [0.045, 0.1, 0.2];
/// Position in [`RADII_MM`] of the one at which classes and sharpness are taken.
const VIEWED: usize = 1;
/// Position of the one at which classes' mean colours are taken.
const WIDE: usize = 2;
const POINTS: Domain = Domain::new("judge points");

/// What the judge looks at.
#[derive(Clone, Copy)]
pub struct JudgeInput<'a> {
    /// Surface voxels, materials and optical boundary.
    pub object: &'a Object,
    /// How radiance becomes colour.
    pub viewing: &'a Viewing,
    /// The texture's colour at each surface voxel, linear RGB relative to the print's white.
    pub target: &'a [[f32; 3]],
    /// The target brought within reach of gamut and thickness.
    pub printable_target: &'a [[f32; 3]],
}

impl<'a> From<Problem<'a>> for JudgeInput<'a> {
    fn from(problem: Problem<'a>) -> Self {
        let Problem { object, viewing, target, printable_target, .. } = problem;
        Self { object, viewing, target, printable_target }
    }
}

/// Says how well labels show a target. What depends on object and target alone is made once, for any number of labels.
pub struct Judge<'a> {
    input: JudgeInput<'a>,
    effort: Effort,
    seed: u64,
    points: Vec<u32>,
    smoother: SurfaceSmoother,
    /// Leads from the last radius but one to the last.
    last_step: LowPass,
    /// Makes the means that contrast leaves out, and those of the noise's energy.
    low_pass: LowPass,
    classes: Vec<ColorClass>,
    /// `[radius]`, the printable target and the target in Lab.
    targets: Vec<[Vec<[f32; 3]>; 2]>,
    /// Local contrast of both.
    contrasts: [Vec<f32>; 2],
    /// CIEDE2000 at [`VIEWED`] from the target to what gamut leaves of it, and on to what thickness leaves.
    steps: Vec<[f32; 2]>,
}

impl<'a> Judge<'a> {
    /// Checks the input, draws the points, and smooths the targets.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when targets or viewing do not fit the object, or the effort is out of range;
    /// [`RefineError::Cancelled`].
    pub fn new(
        input: JudgeInput<'a>,
        effort: Effort,
        seed: u64,
        control: &Control<'_>,
    ) -> Result<Self, RefineError> {
        effort.check()?;
        let JudgeInput { object, viewing, target, printable_target } = input;
        check_colors(object, viewing, target, printable_target)?;
        let control = &control.silent();
        let smoother = SurfaceSmoother::exact(object.surface(), RADII_MM[0], control)?;
        let last_step = LowPass::new(object.surface(), step_mm(RADII_MM.len() - 1), control)?;
        let low_pass = LowPass::new(object.surface(), LOCAL_MM, control)?;
        let classes = lab_of(target).into_iter().map(ColorClass::of).collect();
        let mut judge = Self {
            input,
            effort,
            seed,
            points: draw_points(seed, object.surface(), effort.points as usize),
            smoother,
            last_step,
            low_pass,
            classes,
            targets: Vec::with_capacity(RADII_MM.len()),
            contrasts: Default::default(),
            steps: Vec::new(),
        };
        let mut fields = [printable_target.to_vec(), target.to_vec()];
        for radius in 0..RADII_MM.len() {
            for field in &mut fields {
                *field = judge.widen(std::mem::take(field), radius, control)?;
            }
            judge.targets.push(fields.each_ref().map(|field| lab_of(field)));
        }
        let contrast = |lab: &Vec<[f32; 3]>| contrast(&judge.low_pass, lab, control);
        let [printable, target] = &judge.targets[VIEWED];
        judge.contrasts = [contrast(printable)?, contrast(target)?];
        judge.steps = differences(target, printable).into_iter().map(|step| [step, 0.0]).collect();
        Ok(judge)
    }

    /// Tells apart in [`ErrorShares`] what the gamut and what thickness takes of the target: `colors` are the targets
    /// brought within reach of the gamut alone, as if all material were thick, linear RGB relative to the print's white.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when there is not one finite colour a surface voxel; [`RefineError::Cancelled`].
    pub fn with_gamut_target(
        mut self,
        colors: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Self, RefineError> {
        check_list(self.input.object, "gamut target", colors)?;
        let colors = self.viewed(colors, control)?;
        let [printable, target] = &self.targets[VIEWED];
        let (gamut, thickness) = (differences(target, &colors), differences(&colors, printable));
        self.steps = gamut.into_iter().zip(thickness).map(|(gamut, thickness)| [gamut, thickness]).collect();
        Ok(self)
    }

    /// Where an appearance is off the target as given at 0.1 mm: CIEDE2000 of every surface voxel in three parts, out of
    /// gamut, too thin, cross-talk, as in [`ErrorShares`]; their sum is the error. `shown` is linear RGB relative to the
    /// print's white; noise in it counts as error.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when there is not one finite colour a surface voxel; [`RefineError::Cancelled`].
    pub fn error_parts(
        &self,
        shown: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, RefineError> {
        check_list(self.input.object, "appearance", shown)?;
        let shown = self.viewed(shown, control)?;
        let [printable, target] = &self.targets[VIEWED];
        Ok(divided(&differences(&shown, target), &self.steps, &differences(&shown, printable)))
    }

    /// Lab of colours smoothed to [`VIEWED`].
    fn viewed(&self, colors: &[[f32; 3]], control: &Control<'_>) -> Result<Vec<[f32; 3]>, RefineError> {
        let mut colors = colors.to_vec();
        for radius in 0..=VIEWED {
            colors = self.widen(colors, radius, &control.silent())?;
        }
        Ok(lab_of(&colors))
    }

    /// Smooths further, from the radius before to `radius`.
    fn widen(
        &self,
        field: Vec<[f32; 3]>,
        radius: usize,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, RefineError> {
        Ok(if radius + 1 == RADII_MM.len() {
            self.last_step.apply(&field, control)?
        } else {
            let from = radius.checked_sub(1).map_or(0.0, |before| RADII_MM[before]);
            self.smoother.widen(field, from, RADII_MM[radius], control)?
        })
    }

    /// The surface voxels drawn for per-voxel errors, ascending.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// Judges labels by `bound`, a predictor of the judge's object that can do what `capabilities` says. Labels judged by
    /// one judge are predicted with the same random numbers. Progress counts predicted surface voxels.
    ///
    /// Errors after smoothing have the noise's share taken out: of each squared difference the noise's energy, measured
    /// by the halves of the passes and averaged over a millimetre of surface. Per-voxel errors contain their noise, which is
    /// stated.
    ///
    /// # Errors
    /// [`RefineError::Judge`] when the predictor fails, [`RefineError::Invalid`] when it predicts what is not finite,
    /// [`RefineError::Cancelled`].
    pub fn judge(
        &self,
        labels: &LabelGrid,
        bound: &mut dyn BoundPredictor,
        capabilities: Capabilities,
        control: &Control<'_>,
    ) -> Result<Judged, RefineError> {
        self.judge_with(labels, bound, [1; 2], capabilities, control)
    }

    /// [`Judge::judge`] with the [efforts](pellucid_predict::Draw::effort) of a pass over every surface voxel and of one over
    /// the points of per-voxel errors: few long passes over few points take less time than many short ones.
    ///
    /// # Errors
    /// As there.
    pub fn judge_with(
        &self,
        labels: &LabelGrid,
        bound: &mut dyn BoundPredictor,
        efforts: [u32; 2],
        capabilities: Capabilities,
        control: &Control<'_>,
    ) -> Result<Judged, RefineError> {
        bound.update(labels, Changed::Unknown, &control.silent()).map_err(RefineError::judge)?;
        let all = self.input.object.points();
        let Effort { mut point_passes, mut surface_passes, .. } = self.effort;
        if !capabilities.random {
            (point_passes, surface_passes) = (1, 1);
        }
        let total =
            self.points.len() as u64 * u64::from(point_passes) + all.len() as u64 * u64::from(surface_passes);
        let mut meter = Meter { control: *control, done: 0, total };
        let mut paths = 0;
        let [surface_effort, point_effort] = efforts;
        let surface =
            self.surface_halves(&all, surface_passes, surface_effort, bound, &mut meter, &mut paths)?;
        let passes = surface_passes..surface_passes + point_passes;
        let halves = self.point_halves(passes, point_effort, bound, &mut meter, &mut paths)?;
        let mut errors = StateErrors {
            voxel: self.voxel_errors(&halves),
            points: self.points.len() as u64,
            point_passes,
            surface_passes,
            paths,
            ..StateErrors::default()
        };
        let shown = [surface[0].clone(), surface[surface.len() - 1].clone()];
        self.smoothed_errors(surface, &mut errors, &control.silent())?;
        Ok(Judged { errors, points: self.points.clone(), halves, shown })
    }

    fn voxel_errors(&self, halves: &[Vec<f32>; 2]) -> Errors {
        let JudgeInput { viewing, target, printable_target, .. } = self.input;
        let rgb = |values: &[f32]| -> Vec<[f32; 3]> {
            values.chunks_exact(viewing.channels()).map(|l| viewing.relative_rgb(l)).collect()
        };
        let halves = halves.iter().map(|half| rgb(half)).collect::<Vec<_>>();
        let mean = lab_of(&mean_of(&halves));
        let at_points =
            |all: &[[f32; 3]]| lab_of(&self.points.iter().map(|&p| all[p as usize]).collect::<Vec<_>>());
        let against = |all: &[[f32; 3]]| ErrorStats::of(differences(&mean, &at_points(all)));
        Errors {
            printable: against(printable_target),
            raw: against(target),
            noise: mean_noise(&noise_of(&halves, &mean)),
        }
    }

    fn smoothed_errors(
        &self,
        mut halves: Halves,
        errors: &mut StateErrors,
        control: &Control<'_>,
    ) -> Result<(), RefineError> {
        let mut energy = vec![Energy::default(); if halves.len() > 1 { self.classes.len() } else { 0 }];
        let mut found = Vec::with_capacity(RADII_MM.len());
        let mut wide = Vec::new();
        for i in 0..RADII_MM.len() {
            for half in &mut halves {
                *half = self.widen(std::mem::take(half), i, control)?;
            }
            let mean = lab_of(&mean_of(&halves));
            let noise = noise_of(&halves, &mean);
            for (energy, &[noise, across]) in energy.iter_mut().zip(&noise) {
                energy[i] = noise * noise;
                energy[RADII_MM.len()] = across;
            }
            let [printable, target] = &self.targets[i];
            found.push((differences(&mean, printable), differences(&mean, target), mean_noise(&noise)));
            if i == VIEWED {
                errors.sharpness = self.sharpness(&mean, control)?;
            }
            if i == WIDE {
                wide = mean;
            }
        }
        if halves.len() > 1 {
            energy = self.low_pass.apply(&energy, control)?;
        }
        for (i, (printable, raw, noise)) in found.into_iter().enumerate() {
            let [printable, raw] = [printable, raw].map(|differences| without_noise(differences, &energy, i));
            if i == VIEWED {
                errors.color_classes = self.class_errors(&printable, &raw, &wide, &energy);
                errors.shares = ErrorShares::of(&divided(&raw, &self.steps, &printable));
            }
            let state = Errors { printable: ErrorStats::of(printable), raw: ErrorStats::of(raw), noise };
            *[&mut errors.at_0_045_mm, &mut errors.at_0_1_mm, &mut errors.at_0_2_mm][i] = state;
        }
        Ok(())
    }

    fn sharpness(&self, shown: &[[f32; 3]], control: &Control<'_>) -> Result<Sharpness, RefineError> {
        let shown = contrast(&self.low_pass, shown, control)?;
        let [(slope, edges), (raw, _)] = [0, 1].map(|i| slope(&shown, &self.contrasts[i]));
        Ok(Sharpness { slope, raw, edges })
    }

    /// Errors at [`VIEWED`], and colours shown at [`WIDE`] with the noise's energy.
    fn class_errors(
        &self,
        printable: &[f32],
        raw: &[f32],
        wide: &[[f32; 3]],
        energy: &[Energy],
    ) -> Vec<ClassErrors> {
        let of = |class: ColorClass| {
            let members: Vec<usize> = (0..self.classes.len()).filter(|&i| self.classes[i] == class).collect();
            let stats = |all: &[f32]| ErrorStats::of(members.iter().map(|&i| all[i]).collect());
            let planned = |lab: &[[f32; 3]]| MeanColor::of(members.iter().map(|&i| (lab[i], 0.0)));
            let noise = |i: usize| energy.get(i).map_or(0.0, |energy| energy[RADII_MM.len()]);
            let [printable_target, target] = &self.targets[WIDE];
            let errors = stats(printable);
            (!members.is_empty()).then(|| ClassErrors {
                class,
                share: members.len() as f64 / self.classes.len() as f64,
                mean: errors.mean,
                p95: errors.p95,
                raw: stats(raw).mean,
                target: planned(target),
                printable: planned(printable_target),
                shown: MeanColor::of(members.iter().map(|&i| (wide[i], noise(i)))),
            })
        };
        ColorClass::ALL.into_iter().filter_map(of).collect()
    }
}

/// Standard deviation in mm of the Gaussian that leads from the radius before to `radius`.
fn step_mm(radius: usize) -> f64 {
    (RADII_MM[radius].powi(2) - RADII_MM[radius - 1].powi(2)).sqrt()
}

/// Distinct positions in the list of surface voxels, ascending: one at random of each of `wanted` equal stretches of the
/// surface, since errors of neighbours are alike; all when there are no more.
fn draw_points(seed: u64, surface: &Surface, wanted: usize) -> Vec<u32> {
    let order = near_order(surface.voxels());
    let wanted = wanted.min(order.len());
    let start = |stretch: usize| (stretch as u64 * order.len() as u64 / wanted as u64) as usize;
    let mut points: Vec<u32> = (0..wanted)
        .map(|i| {
            let (from, to) = (start(i), start(i + 1));
            order[from + (hash(seed, POINTS, i as u64, 0) % (to - from) as u64) as usize]
        })
        .collect();
    points.sort_unstable();
    points
}

/// L* less its mean over about a millimetre.
fn contrast(low_pass: &LowPass, lab: &[[f32; 3]], control: &Control<'_>) -> Result<Vec<f32>, RefineError> {
    Ok(low_pass.contrast(lab.iter().map(|lab| lab[0]).collect(), control)?)
}

/// Regression slope through zero of `shown` on `target` at the target's edges, and the edges' share.
fn slope(shown: &[f32], target: &[f32]) -> (Option<f64>, f64) {
    let (mut products, mut squares, mut edges) = (0.0, 0.0, 0u64);
    for (&shown, &target) in shown.iter().zip(target).filter(|(_, t)| t.abs() >= Sharpness::LEAST_CONTRAST) {
        products += f64::from(shown) * f64::from(target);
        squares += f64::from(target) * f64::from(target);
        edges += 1;
    }
    ((edges > 0).then_some(products / squares), edges as f64 / target.len().max(1) as f64)
}
