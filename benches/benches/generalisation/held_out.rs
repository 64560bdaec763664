//! Labelled sets of volumes that no network has seen.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pellucid::color::Viewing;
use pellucid::color::spectrum::Illuminant;
use pellucid::dataset::{LabelledSet, Recipe, Sampler, SetHeader, Shard, generate};
use pellucid::predict::Object;
use pellucid::trace::Boundary;
use pellucid::voxel::{Control, MaterialTable, Surface, SurfaceOptions};

use super::Error;
use super::finished::Finished;
use super::object::Case;
use super::scores::{Labels, Row};

/// The sets, in the order of the report.
pub const SETS: [&str; 6] =
    ["test", "unseen-shape", "unseen-density-x4", "unseen-density-quarter", "thin", "loops"];
/// Samples that a network predicts at a time.
const CHUNK: usize = 4096;

/// The labelled set of a split, made on the first run; small studies have fewer volumes and points, and looser labels.
pub fn labelled(
    recipe: &Recipe,
    split: &str,
    full: bool,
    folder: &Path,
    control: &Control<'_>,
) -> Result<LabelledSet, Error> {
    let mut recipe = recipe.clone();
    if !full {
        for split in &mut recipe.splits {
            (split.volumes, split.points, split.std_error) = (12, 24, Some(0.01));
        }
    }
    let materials = MaterialTable::cmykw();
    let header = SetHeader { recipe, split: split.to_owned(), materials, shard: Shard::WHOLE };
    println!("labels of {split}");
    let file: PathBuf = generate(folder, &header, control)?;
    Ok(LabelledSet::load(&[file], control)?)
}

/// From radiance to colour for a set.
pub fn viewing(set: &LabelledSet) -> Result<Viewing, Error> {
    let header = set.header();
    Ok(Viewing::of_print(&header.materials, "white", header.recipe.refractive_index, Illuminant::D65)?)
}

/// A row for every network, and for its shape families where there are several.
pub fn judge(set: &LabelledSet, networks: &[&Finished], control: &Control<'_>) -> Result<Vec<Row>, Error> {
    let name = &set.header().split;
    let viewing = viewing(set)?;
    let mut classes = Vec::new();
    for i in (0..set.len()).step_by(set.channels()) {
        if !classes.contains(&set.class(i)) {
            classes.push(set.class(i));
        }
    }
    let mut rows = Vec::new();
    for network in networks {
        let mut inference = network.inference()?;
        let predicted = set.predictions(CHUNK, control, |stencils, flights, out| {
            Ok::<_, Error>(inference.radiance(stencils, flights, out)?)
        })?;
        let labels = Labels { radiance: set.radiance(), std_error: set.std_error(), viewing: &viewing };
        rows.push(Row::of(name, "", network, &predicted, &labels));
        if classes.len() == 1 {
            continue;
        }
        for &class in &classes {
            let pick = |from: &[f32]| -> Vec<f32> {
                (0..set.len()).filter(|&i| set.class(i) == class).map(|i| from[i]).collect()
            };
            let (radiance, std_error) = (pick(set.radiance()), pick(set.std_error()));
            let labels = Labels { radiance: &radiance, std_error: &std_error, viewing: &viewing };
            rows.push(Row::of(name, class.name(), network, &pick(&predicted), &labels));
        }
    }
    Ok(rows)
}

/// A set's first volume, to be looked at.
pub fn first_volume(set: &LabelledSet, control: &Control<'_>) -> Result<Case, Error> {
    let header = set.header();
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    let sampler = Sampler::new(&header.recipe, &header.split, &header.materials, boundary)?;
    let labels = sampler.grid(set.volume(0))?;
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
    let object = Object::new(surface, sampler.materials().clone(), header.recipe.refractive_index)?;
    Ok(Case { name: header.split.clone(), object: Arc::new(object), labels, viewing: viewing(set)? })
}
