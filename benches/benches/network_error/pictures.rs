//! False-colour pictures of where predictors err.

use std::path::Path;
use std::sync::Arc;

use pellucid::color::Viewing;
use pellucid::dataset::{LabelledSet, Sampler};
use pellucid::predict::Object;
use pellucid::proof::{View, Visibility, contact_sheet};
use pellucid::trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, Surface, SurfaceOptions};
use pellucid_benches::appearance::signed_color;

use super::{Candidate, Error, shared};

/// Paths of the reference.
const REFERENCE: u32 = 1024;
/// Difference in radiance that is shown in full colour.
const FULL: f32 = 0.1;

/// Draws a row for every network and one for Monte Carlo of the first volume of a set: reference, prediction,
/// error.
pub fn draw(
    path: &Path,
    set: &LabelledSet,
    viewing: &Viewing,
    candidates: &[Candidate],
    paths: f64,
    edge: u32,
    control: &Control<'_>,
) -> Result<(), Error> {
    let header = set.header();
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    let sampler = Sampler::new(&header.recipe, &header.split, &header.materials, boundary)?;
    let grid = sampler.grid(set.volume(0))?;
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
    let view = View::front_and_back().swap_remove(0);
    let seen = Visibility::trace(&grid, &surface, &view, edge, control)?;
    let points = seen.visible_points();

    let channels = set.channels();
    let volume = Volume::new(&grid, &surface, control)?;
    let traced = |spp: u32, iteration: u32| -> Result<Vec<f32>, Error> {
        let options = TraceOptions { spp, boundary, ..Default::default() };
        let mut out = vec![0.0; points.len() * channels];
        Tracer::new(&volume, sampler.materials(), options)?
            .radiance(&points, iteration, &mut out, control)?;
        Ok(out)
    };
    let reference = traced(REFERENCE, 0)?;
    let noisy = traced((paths.round() as u32).clamp(1, REFERENCE), 1)?;

    let object = Arc::new(Object::new(surface, sampler.materials().clone(), header.recipe.refractive_index)?);
    let mut predictions = candidates
        .iter()
        .map(|c| shared::predict(c, &grid, &object, &points, control))
        .collect::<Result<Vec<_>, _>>()?;
    predictions.push(noisy);

    let spread = |colour: &dyn Fn(usize) -> [f32; 3]| {
        let mut all = vec![[0.0; 3]; object.surface().len()];
        points.iter().enumerate().for_each(|(i, &p)| all[p as usize] = colour(i));
        seen.shade(&all, control)
    };
    let appearance =
        |values: &[f32]| spread(&|i| viewing.relative_rgb(&values[i * channels..(i + 1) * channels]));
    let error = |values: &[f32]| {
        spread(&|i| {
            let own = i * channels..(i + 1) * channels;
            let sum: f32 = values[own.clone()].iter().zip(&reference[own]).map(|(a, b)| a - b).sum();
            let difference = sum / channels as f32;
            signed_color(difference, FULL)
        })
    };
    let rows = predictions
        .iter()
        .map(|predicted| Ok(vec![appearance(&reference)?, appearance(predicted)?, error(predicted)?]))
        .collect::<Result<Vec<_>, Error>>()?;
    contact_sheet(&rows, control)?.write_png(path, control)?;
    Ok(())
}
