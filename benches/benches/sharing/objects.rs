//! What the predictors are judged on: held-out volumes, a ball, and refined prints.

use std::path::Path;
use std::sync::Arc;

use pellucid::dataset::{LabelledSet, Recipe, Sampler, SetHeader, Shard, generate};
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::predict::Object;
use pellucid::trace::Boundary;
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, SurfaceOptions};
use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};
use pellucid_benches::judged::Judged;
use pellucid_benches::solids::ball;

use super::{Error, TIMED_POINTS, models};

/// Name of the test set's volumes together.
pub const HELD_OUT: &str = "held-out volumes";
/// Points of an object whose radiance is traced for comparison.
const POINTS: usize = 1500;
/// Held-out volumes of the small study, and their points.
const SMALL_VOLUMES: u32 = 24;
const SMALL_POINTS: u32 = 48;
/// Models whose refined labels are judged, and the height in mm at which they are printed.
const MODELS: [(&str, f64); 3] = [("vase-handle", 18.0), ("octostar", 14.0), ("tubes", 14.0)];

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
        scenes.push(Judged::traced(&name, grid, surface, [TIMED_POINTS, POINTS], control)?);
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
        scenes.push(Judged::traced(&name, refined.labels, surface, [TIMED_POINTS, POINTS], control)?);
    }
    Ok(scenes)
}
