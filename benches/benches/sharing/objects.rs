//! What the predictors are judged on: held-out volumes, a ball, and refined prints.

use std::path::Path;
use std::sync::Arc;

use pellucid::core::NoisyScore;
use pellucid::dataset::{LabelledSet, Recipe, Sampler, SetHeader, Shard, generate};
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::predict::Object;
use pellucid::trace::{Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, SurfaceOptions, near_order};
use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};
use pellucid_benches::solids::ball;

use super::{Error, TIMED_POINTS, models};

const INDEX: f64 = 1.5;
/// Name of the test set's volumes together.
pub const HELD_OUT: &str = "held-out volumes";
/// Points of an object whose radiance is traced for comparison.
const POINTS: usize = 1500;
const STD_ERROR: f32 = 0.003;
const MOST_PATHS: u32 = 65_536;
/// Held-out volumes of the small study, and their points.
const SMALL_VOLUMES: u32 = 24;
const SMALL_POINTS: u32 = 48;
/// Models whose refined labels are judged, and the height in mm at which they are printed.
const MODELS: [(&str, f64); 3] = [("vase-handle", 18.0), ("octostar", 14.0), ("tubes", 14.0)];

/// An object with reference radiances at some points.
pub struct Judged {
    pub name: String,
    pub object: Arc<Object>,
    pub labels: LabelGrid,
    pub points: Vec<u32>,
    /// `[point][channel]`.
    pub radiance: Vec<f32>,
    pub std_error: Vec<f32>,
}

impl Judged {
    /// Adds the errors of radiances at the judged points.
    pub fn compare(&self, predicted: &[f32], score: &mut NoisyScore) {
        for ((p, r), e) in predicted.iter().zip(&self.radiance).zip(&self.std_error) {
            score.add_difference(f64::from(p - r), f64::from(*e).powi(2));
        }
    }

    /// Adds the errors of the judged points among `points`, whose radiance is `predicted`.
    pub fn compare_within(&self, points: &[u32], predicted: &[f32], score: &mut NoisyScore) {
        let channels = self.object.channels();
        let mut place = vec![u32::MAX; self.object.surface().len()];
        (0..).zip(points).for_each(|(i, &p)| place[p as usize] = i);
        for (i, &point) in self.points.iter().enumerate() {
            let at = place[point as usize];
            if at == u32::MAX {
                continue;
            }
            for c in 0..channels {
                let (predicted, own) = (predicted[at as usize * channels + c], i * channels + c);
                let variance = f64::from(self.std_error[own]).powi(2);
                score.add_difference(f64::from(predicted - self.radiance[own]), variance);
            }
        }
    }

    /// Traces the reference of points spread over the first [`TIMED_POINTS`] neighbours.
    fn traced(name: &str, labels: LabelGrid, surface: Surface, control: &Control<'_>) -> Result<Self, Error> {
        println!("tracing {name}: {} surface voxels", surface.len());
        let volume = Volume::new(&labels, &surface, control)?;
        let materials = MaterialTable::cmykw();
        let options = TraceOptions { boundary: Boundary::with_index(INDEX)?, ..TraceOptions::default() };
        let order = near_order(surface.voxels());
        let near = &order[..order.len().min(TIMED_POINTS)];
        let points: Vec<u32> = near.iter().copied().step_by((near.len() / POINTS).max(1)).collect();
        let mut radiance = vec![0.0; points.len() * 3];
        let mut std_error = radiance.clone();
        let target = ErrorTarget { std_error: STD_ERROR, max_spp: MOST_PATHS };
        let tracer = Tracer::new(&volume, &materials, options)?;
        tracer.radiance_to(&points, 1, target, &mut radiance, &mut std_error, control)?;
        let object = Arc::new(Object::new(surface, materials, INDEX)?);
        Ok(Self { name: name.into(), object, labels, points, radiance, std_error })
    }
}

/// The test set of the default recipe, or a small part of it.
pub fn held_out(full: bool, folder: &Path, control: &Control<'_>) -> Result<Vec<Judged>, Error> {
    let recipe = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/recipes/default.json");
    let mut recipe = Recipe::read(Path::new(recipe))?;
    recipe.splits.retain(|split| split.name == "test");
    if !full {
        recipe.splits[0].volumes = SMALL_VOLUMES;
        recipe.splits[0].points = SMALL_POINTS;
    }
    std::fs::create_dir_all(folder)?;
    println!("labelling held-out volumes");
    let header =
        SetHeader { recipe, split: "test".into(), materials: MaterialTable::cmykw(), shard: Shard::WHOLE };
    let set = LabelledSet::load(&[generate(folder, &header, control)?], control)?;
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    let sampler = Sampler::new(&header.recipe, "test", &header.materials, boundary)?;
    let per_volume = header.split()?.points as usize * set.channels();
    (0..set.len() / per_volume)
        .map(|v| {
            let samples = v * per_volume..(v + 1) * per_volume;
            let labels = sampler.grid(set.volume(samples.start))?;
            let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
            let voxels = samples.clone().step_by(set.channels()).map(|i| set.voxel(i));
            let points = voxels.map(|v| surface.index_of(v).ok_or("a labelled voxel is inside"));
            let points = points.collect::<Result<Vec<u32>, _>>()?;
            let object = Object::new(surface, sampler.materials().clone(), header.recipe.refractive_index)?;
            Ok(Judged {
                name: HELD_OUT.into(),
                object: Arc::new(object),
                labels,
                points,
                radiance: set.radiance()[samples.clone()].to_vec(),
                std_error: set.std_error()[samples].to_vec(),
            })
        })
        .collect()
}

/// A ball and refined models, in the small study a small ball alone, of which those that are `wanted` by their names.
pub fn scenes(
    full: bool,
    wanted: &dyn Fn(&str) -> bool,
    control: &Control<'_>,
) -> Result<Vec<Judged>, Error> {
    let surface = |grid: &LabelGrid| Surface::extract(grid, &SurfaceOptions::default(), control);
    let mut scenes = Vec::new();
    let diameter = if full { 20.0 } else { 8.0 };
    let name = format!("ball of {diameter} mm");
    if wanted(&name) {
        let grid = ball(diameter, 0.5);
        let surface = surface(&grid)?;
        scenes.push(Judged::traced(&name, grid, surface, control)?);
    }
    for (model, height_mm) in MODELS.into_iter().filter(|_| full) {
        let name = format!("refined {model}");
        if !wanted(&name) {
            continue;
        }
        let settings = PrintSettings { scale: Scale::HeightMm(height_mm), ..PrintSettings::default() };
        let job = PrintJob::new(settings)?;
        let imported = import_path(models().join(format!("{model}.glb")), &ImportLimits::default())?;
        let placed = job.place(&imported, &Monitor::silent())?;
        let aimed = job.aim(placed, &Monitor::silent())?;
        let refined = job.refine(&aimed, &Workspace::none(), &Monitor::silent())?;
        let surface = surface(&refined.labels)?;
        scenes.push(Judged::traced(&name, refined.labels, surface, control)?);
    }
    Ok(scenes)
}
