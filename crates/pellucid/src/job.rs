//! The main job: from a model to a prepared print.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pellucid_color::gamut::{DEFAULT_THICKNESSES_MM, ThicknessGamut};
use pellucid_color::intent::{MediaWhite, Rendering, RenderingIntent};
use pellucid_color::mixture::table::DEFAULT_NODES;
use pellucid_color::{Gamut, MatchOptions, MixtureModel};
use pellucid_mesh::voxelise::{VoxeliseOptions, voxelise};
use pellucid_mesh::{MeshReport, Model, surface_colors};
use pellucid_refine::{AppearancePredictor, GamutInk, RefineError, RefineInput, Scene, refine};
use pellucid_trace::TraceOptions;
use pellucid_voxel::{
    Control, LabelGrid, NearestSurface, Surface, SurfaceOptions, VoxelError, local_thickness_mm,
};

#[cfg(feature = "rpnn")]
use pellucid_rpnn::Precision;
use rayon::prelude::*;

use crate::clock::Clock;
use crate::evaluate::{self, Judge};
use crate::predictor::MonteCarlo;
#[cfg(feature = "rpnn")]
use crate::predictor::{Corrected, Correction, Rpnn};
use crate::proof::{View, Visibility};
use crate::report::{Report, StageTime, Thinness};
use crate::stage::{Observer, Stage};
use crate::{PredictorKind, PrintError, PrintSettings};

/// Thickness in mm from which a part counts as thick.
const THICK_MM: f64 = 10.0;
/// Nodes a side of the gamut tables of thin parts.
const THIN_NODES: usize = 17;

/// Prepares prints: settings that were checked once.
///
/// ```no_run
/// use std::{path::Path, sync::atomic::AtomicBool};
/// use pellucid::{PrintJob, PrintSettings, mesh, stage::Silent};
/// let model = mesh::import_path("model.glb", &mesh::ImportLimits::default())?;
/// let job = PrintJob::new(PrintSettings::default())?;
/// let cancel = AtomicBool::new(false);
/// let prepared = job.prepare(&model, &Silent, &cancel)?;
/// let report = prepared.write(Path::new("print"), false, &Silent, &cancel)?;
/// println!("mean dE2000 {:.2}", report.evaluation.refined.mapped.mean);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PrintJob {
    pub(crate) settings: PrintSettings,
    white: u8,
}

/// A prepared print in memory.
pub struct Prepared {
    pub(crate) settings: PrintSettings,
    /// The labels to print.
    pub grid: LabelGrid,
    /// The halftone before refinement.
    pub unrefined: LabelGrid,
    /// Surface voxels and normals of both.
    pub surface: Surface,
    /// Linear RGB that each surface voxel should show, media-relative, not gamut-mapped.
    pub target: Vec<[f32; 3]>,
    /// Appearance in each view of the proof.
    pub views: Vec<ProofView>,
    pub(crate) report: Report,
    pub(crate) times: Vec<StageTime>,
}

/// What one view of the proof shows; colours are media-relative linear RGB.
pub struct ProofView {
    /// The view's name.
    pub name: String,
    /// Target, unrefined and refined appearance.
    pub pictures: [crate::proof::Picture; 3],
}

/// The loop's predictor.
enum Predictor {
    MonteCarlo(Box<MonteCarlo>),
    #[cfg(feature = "rpnn")]
    Rpnn(Box<Corrected<Rpnn, MonteCarlo>>),
}

impl Predictor {
    fn as_dyn(&mut self) -> &mut dyn AppearancePredictor {
        match self {
            Self::MonteCarlo(predictor) => predictor.as_mut(),
            #[cfg(feature = "rpnn")]
            Self::Rpnn(predictor) => predictor.as_mut(),
        }
    }

    /// The network without its correction.
    fn network(&mut self) -> Option<&mut dyn AppearancePredictor> {
        match self {
            Self::MonteCarlo(_) => None,
            #[cfg(feature = "rpnn")]
            Self::Rpnn(predictor) => Some(predictor.fast_mut()),
        }
    }

    /// Predictions of the last call that the predictor was not made for.
    fn outside_training(&self) -> u64 {
        match self {
            Self::MonteCarlo(_) => 0,
            #[cfg(feature = "rpnn")]
            Self::Rpnn(predictor) => predictor.fast().outside_training(),
        }
    }
}

impl PrintJob {
    /// Checks settings.
    ///
    /// # Errors
    /// [`PrintError::Voxel`] naming the setting that is out of range, [`PrintError::Refine`] and
    /// [`PrintError::Trace`] likewise.
    pub fn new(mut settings: PrintSettings) -> Result<Self, PrintError> {
        let white = settings.check()?;
        settings.refine.seed = settings.seed;
        settings.refine.check()?;
        Ok(Self { settings, white })
    }

    /// Tells before any work whether [`Prepared::write`] would refuse the output folder.
    ///
    /// # Errors
    /// [`PrintError::Slice`] when the folder exists and may not be replaced.
    pub fn check_output(&self, dir: &Path, force: bool) -> Result<(), PrintError> {
        drop(pellucid_slice::StagedDir::begin(dir, force)?);
        Ok(())
    }

    /// Does the whole job in memory.
    ///
    /// # Errors
    /// [`PrintError`] of the step that failed; [`PrintError::is_cancelled`] once `cancel` is set.
    pub fn prepare(
        &self,
        model: &Model,
        observer: &dyn Observer,
        cancel: &AtomicBool,
    ) -> Result<Prepared, PrintError> {
        let s = &self.settings;
        let mut clock = Clock::new(observer, cancel);
        // Before anything takes time: the predictor may not be made for these settings.
        let mut predictor = self.predictor()?;
        let options = VoxeliseOptions {
            pitch: s.target.pitch(),
            scale: s.scale,
            label: self.white,
            ..Default::default()
        };
        let voxelised = clock.run(Stage::Voxelise, |c| voxelise(model, &options, c))?;
        let (solid, placement, mesh) = (voxelised.grid, voxelised.placement, voxelised.report);
        // A print that its target cannot hold should be refused now, not after the refinement.
        pellucid_slice::check(&solid, &s.materials, &s.target, &Default::default())?;
        mesh_warnings(&mesh, &clock);

        let surface =
            clock.run(Stage::Surface, |c| Surface::extract(&solid, &SurfaceOptions::default(), c))?;
        let thickness = local_thickness_mm(&solid, &surface, THICK_MM, &clock.quiet())?;
        let thin = thinness(&thickness);
        if thin.below_1_mm > 0.01 {
            clock.warn(&format!(
                "{:.0} % of the surface lies on less than 1 mm of material: colours pale and show through there",
                100.0 * thin.below_1_mm
            ));
        }
        let depth = s.refine.coloured_depth_mm;
        let nearest = clock.run(Stage::Nearest, |c| NearestSurface::build(&solid, &surface, depth, c))?;
        let texture = clock.run(Stage::Target, |c| surface_colors(model, &placement, &surface, c))?;
        let (gamut, gamuts) = clock.run(Stage::Color, |c| self.gamuts(c))?;
        let media_white = MediaWhite::new(gamut.model().media_white())?;
        let rendering = Rendering {
            intent: if s.absolute {
                RenderingIntent::AbsoluteColorimetric
            } else {
                RenderingIntent::RelativeColorimetric
            },
            ..Rendering::default()
        };
        let target: Vec<[f32; 3]> = texture
            .iter()
            .map(|rgb| rendering.target(rgb.map(f64::from), media_white, gamut.black()).map(|v| v as f32))
            .collect();
        drop(texture);

        let aim = self.aim(&target, &thickness, &gamut, &gamuts);
        let ink = GamutInk::new(&gamut, &s.materials);
        let judge = Judge {
            surface: &surface,
            materials: &s.materials,
            boundary: s.boundary,
            white: media_white,
            seed: s.seed,
        };
        let mut grid = solid;
        let input = RefineInput {
            surface: &surface,
            nearest: &nearest,
            materials: &s.materials,
            ink: &ink,
            target: &target,
            aim: &aim,
        };
        let refined =
            clock.run(Stage::Refine, |c| refine(&mut grid, &input, predictor.as_dyn(), &s.refine, c))?;
        let outside = predictor.outside_training();
        if outside > 0 {
            clock.warn(&format!(
                "{outside} predictions have coefficients around them that the network was not trained for"
            ));
        }
        let (unrefined, refinement) = (refined.unrefined, refined.report);
        drop(nearest);
        let (evaluation, judged) = clock.run(Stage::Evaluate, |c| {
            let sample = evaluate::Sample { points: s.evaluation_points, spp: s.evaluation_spp };
            judge.evaluate(&unrefined, &grid, &target, &aim, sample, c)
        })?;
        let prediction = match predictor.network() {
            None => None,
            Some(network) => {
                let scene = Scene { grid: &grid, surface: &surface, materials: &s.materials };
                let mut radiance = vec![0.0; judged.points.len() * 3];
                network
                    .predict(&scene, &judged.points, 0, &mut radiance, &clock.quiet())
                    .map_err(|e| RefineError::predict(refinement.best, e))?;
                Some(judge.prediction_error(&judged, &radiance))
            }
        };
        let views = clock.run(Stage::Proof, |c| self.proof(&judge, &grid, &unrefined, &target, c))?;

        let counts = grid.histogram();
        let report = Report {
            version: env!("CARGO_PKG_VERSION"),
            model: model.name().to_owned(),
            notes: model.notes().iter().map(|n| format!("{}: {}", n.object, n.text)).collect(),
            printer: s.target.name().to_owned(),
            predictor: s.predictor.name().to_owned(),
            spp: s.spp,
            outside_training: outside,
            prediction,
            seed: s.seed,
            refractive_index: s.boundary.index(),
            media_white: media_white.rgb(),
            extent_mm: mesh.extent_mm,
            layers: grid.size()[2],
            solid_voxels: counts[1..].iter().sum(),
            surface_voxels: surface.len() as u64,
            mesh: Some(mesh),
            thin,
            refinement,
            evaluation,
            ..Report::default()
        };
        let times = clock.into_times();
        Ok(Prepared { settings: s.clone(), grid, unrefined, surface, target, views, report, times })
    }

    /// Colours of thick prints, and of parts by their thickness.
    fn gamuts(&self, control: &Control<'_>) -> Result<(Gamut, ThicknessGamut), PrintError> {
        let s = &self.settings;
        let options = MatchOptions::default();
        let thick = MixtureModel::new(&s.materials, "white", s.boundary.index())?;
        let by_thickness =
            ThicknessGamut::build(&thick, &DEFAULT_THICKNESSES_MM, options, THIN_NODES, control)?;
        let gamut = Gamut::build(thick, options, DEFAULT_NODES, &control.silent())?;
        Ok((gamut, by_thickness))
    }

    /// Targets brought within reach of the material below them.
    fn aim(
        &self,
        target: &[[f32; 3]],
        thickness: &[f32],
        gamut: &Gamut,
        gamuts: &ThicknessGamut,
    ) -> Vec<[f32; 3]> {
        target
            .par_iter()
            .zip(thickness)
            .map(|(&rgb, &mm)| {
                let thin = mm < THICK_MM as f32;
                if thin { gamuts.map(rgb, f64::from(mm)).rgb } else { gamut.map(rgb).rgb }
            })
            .collect()
    }

    fn predictor(&self) -> Result<Predictor, PrintError> {
        let s = &self.settings;
        let options =
            TraceOptions { spp: s.spp, seed: s.seed, boundary: s.boundary, ..TraceOptions::default() };
        let tracer = MonteCarlo::new(options)?;
        match s.predictor {
            PredictorKind::MonteCarlo => Ok(Predictor::MonteCarlo(Box::new(tracer))),
            #[cfg(feature = "rpnn")]
            PredictorKind::Rpnn => {
                let network = match &s.weights {
                    Some(given) => {
                        Rpnn::new(given.weights.clone(), given.provenance.clone(), Precision::Bf16)
                    }
                    #[cfg(feature = "weights")]
                    None => Rpnn::shipped()?,
                    #[cfg(not(feature = "weights"))]
                    None => return Err(no_network("give weights, or build with the feature \"weights\"")),
                };
                network.check(s.boundary.index(), s.target.pitch())?;
                let corrected = Corrected::new(network, tracer, Correction::default());
                Ok(Predictor::Rpnn(Box::new(corrected.map_err(|e| RefineError::predict(0, e))?)))
            }
            #[cfg(not(feature = "rpnn"))]
            PredictorKind::Rpnn => Err(no_network("build with the feature \"weights\"")),
        }
    }

    fn proof(
        &self,
        judge: &Judge<'_>,
        refined: &LabelGrid,
        unrefined: &LabelGrid,
        target: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Vec<ProofView>, PrintError> {
        let views = View::front_and_back();
        let seen = views
            .iter()
            .map(|v| {
                Visibility::trace(refined, judge.surface, v, self.settings.proof_edge, &control.silent())
            })
            .collect::<Result<Vec<_>, VoxelError>>()?;
        let mut points: Vec<u32> = seen.iter().flat_map(Visibility::visible_points).collect();
        points.sort_unstable();
        points.dedup();
        let spp = self.settings.proof_spp;
        let half = |from: u64| move |done: u64, total: u64| control.report(from * total + done, 2 * total);
        let (first, second) = (half(0), half(1));
        let before = judge.appearance(unrefined, &points, spp, &control.silent().with_progress(&first))?;
        let after = judge.appearance(refined, &points, spp, &control.silent().with_progress(&second))?;
        views
            .into_iter()
            .zip(seen)
            .map(|(view, seen)| {
                let pictures = [seen.shade(target)?, seen.shade(&before)?, seen.shade(&after)?];
                Ok(ProofView { name: view.name, pictures })
            })
            .collect()
    }
}

impl Prepared {
    /// The report so far; times and memory are filled in by [`Prepared::write`].
    pub fn report(&self) -> &Report {
        &self.report
    }
}

#[cfg(not(feature = "weights"))]
fn no_network(remedy: &str) -> PrintError {
    VoxelError::unsupported("predictor", format!("this build carries no network weights; {remedy}")).into()
}

fn mesh_warnings(mesh: &MeshReport, clock: &Clock<'_>) {
    if !mesh.closed {
        clock.warn(&format!("the mesh is open; {} holes were closed", mesh.holes));
    }
    if mesh.flipped_shells > 0 {
        clock.warn(&format!("{} shells faced inwards and were turned round", mesh.flipped_shells));
    }
    if mesh.thin_voxels > 0 {
        clock.warn("parts thinner than a voxel were kept one voxel thick");
    }
}

fn thinness(thickness: &[f32]) -> Thinness {
    let below =
        |mm: f32| thickness.iter().filter(|&&t| t < mm).count() as f64 / thickness.len().max(1) as f64;
    Thinness {
        least_mm: f64::from(thickness.iter().copied().fold(f32::INFINITY, f32::min)),
        below_1_mm: below(1.0),
        below_2_mm: below(2.0),
    }
}
