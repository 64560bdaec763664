//! False-colour pictures of where predictors err.

use std::path::Path;

use pellucid::dataset::LabelledSet;
use pellucid::dataset::samples::Sampler;
use pellucid::proof::{View, Visibility, contact_sheet};
use pellucid::trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, Surface, SurfaceOptions};

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
    white: [f64; 3],
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

    let volume = Volume::new(&grid, &surface, control)?;
    let traced = |spp: u32, iteration: u32| -> Result<Vec<f32>, Error> {
        let options = TraceOptions { spp, boundary, ..Default::default() };
        let mut out = vec![0.0; points.len() * 3];
        Tracer::new(&volume, sampler.materials(), options)?
            .radiance(&points, iteration, &mut out, control)?;
        Ok(out)
    };
    let reference = traced(REFERENCE, 0)?;
    let noisy = traced((paths.round() as u32).clamp(1, REFERENCE), 1)?;

    let mut predictions = candidates
        .iter()
        .map(|c| shared::predict(c, &grid, &surface, sampler.materials(), &points, control))
        .collect::<Result<Vec<_>, _>>()?;
    predictions.push(noisy);

    let spread = |colour: &dyn Fn(usize) -> [f32; 3]| {
        let mut all = vec![[0.0; 3]; surface.len()];
        points.iter().enumerate().for_each(|(i, &p)| all[p as usize] = colour(i));
        seen.shade(&all, control)
    };
    let appearance =
        |values: &[f32]| spread(&|i| std::array::from_fn(|c| values[3 * i + c] / white[c] as f32));
    let error = |values: &[f32]| {
        spread(&|i| {
            let difference = (0..3).map(|c| values[3 * i + c] - reference[3 * i + c]).sum::<f32>() / 3.0;
            let part = (difference / FULL).clamp(-1.0, 1.0);
            // White at no error; the stronger the error, the less of the other two colours.
            if part > 0.0 { [1.0, 1.0 - part, 1.0 - part] } else { [1.0 + part, 1.0 + part, 1.0] }
        })
    };
    let rows = predictions
        .iter()
        .map(|predicted| Ok(vec![appearance(&reference)?, appearance(predicted)?, error(predicted)?]))
        .collect::<Result<Vec<_>, Error>>()?;
    contact_sheet(&rows, control)?.write_png(path, control)?;
    Ok(())
}
