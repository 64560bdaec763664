//! Cutouts beside each other, as in the paper's Figure 14.

use std::path::Path;

use pellucid::color::delta_e_2000;
use pellucid::color::space::Lab;
use pellucid::proof::{Picture, contact_sheet};
use pellucid::voxel::Control;
use pellucid_benches::appearance::{Error, heat_color};
use pellucid_benches::slab::field::Gaussian;
use pellucid_benches::slab::loss::VIEWED_MM;

use super::models::ModelRun;
use super::runs::{HEURISTICS, Run, Start};
use super::scene::Scene;

/// CIEDE2000 that is shown brightest, as in the paper.
pub const FULL_DELTA_E: f32 = 10.0;
/// Pixels across a cutout, about.
const CUTOUT: usize = 192;

/// A cutout of colours `[y][x]`, every voxel several pixels wide.
fn cutout(colors: &[[f32; 3]], width: usize) -> Result<Picture, Error> {
    let scale = (CUTOUT / width).max(1);
    let height = colors.len() / width;
    let pixel = |i: usize| {
        let (x, y) = (i % (width * scale) / scale, i / (width * scale) / scale);
        let [r, g, b] = colors[y * width + x];
        [r, g, b, 1.0]
    };
    let rgba = (0..colors.len() * scale * scale).flat_map(pixel).collect();
    Ok(Picture::new((width * scale) as u32, (height * scale) as u32, rgba)?)
}

/// `slabs.png`, `differences.png` and `sections.png`: target and heuristics above, then one row a
/// method of descent, one column a start.
pub fn slabs(folder: &Path, scene: &Scene, runs: &[Run], control: &Control<'_>) -> Result<(), Error> {
    let edge = scene.slab.edge;
    let target: Vec<[f32; 3]> = scene.target.iter().map(|v| v.map(|v| v as f32)).collect();
    let gaussian = Gaussian::new(&scene.slab, VIEWED_MM);
    let lab = |colors: &[[f32; 3]]| -> Vec<Lab> {
        let colors: Vec<[f64; 3]> = colors.iter().map(|v| v.map(f64::from)).collect();
        gaussian.apply(&colors).into_iter().map(Lab::from_linear_rgb).collect()
    };
    let target_lab = lab(&target);
    let sheet = |name: &str, first: Option<Picture>, draw: &dyn Fn(&Run) -> Result<Picture, Error>| {
        let (heuristics, descents) = runs.split_at(HEURISTICS.len());
        let mut top: Vec<Picture> = first.into_iter().collect();
        for run in heuristics {
            top.push(draw(run)?);
        }
        let mut rows = vec![top];
        for row in descents.chunks(Start::ALL.len()) {
            rows.push(row.iter().map(draw).collect::<Result<_, _>>()?);
        }
        contact_sheet(&rows, control)?.write_png(folder.join(name), control)?;
        Ok::<(), Error>(())
    };
    sheet("slabs.png", Some(cutout(&target, edge)?), &|run| cutout(&run.shown, edge))?;
    sheet("differences.png", None, &|run| {
        let differences = lab(&run.shown).into_iter().zip(&target_lab).map(|(a, b)| delta_e_2000(a, *b));
        let colors: Vec<_> = differences.map(|d| heat_color(d as f32, FULL_DELTA_E)).collect();
        cutout(&colors, edge)
    })?;
    sheet("sections.png", None, &|run| cutout(&section(scene, run), edge))
}

/// A cut down through the stripes: what a thick block of each voxel's albedo looks like.
fn section(scene: &Scene, run: &Run) -> Vec<[f32; 3]> {
    let slab = &scene.slab;
    let y = slab.edge / 4;
    let color = |voxel: usize| {
        std::array::from_fn(|c| scene.ink.color(c, f64::from(run.albedo[c][voxel])).powi(3) as f32)
    };
    (0..slab.layers * slab.edge)
        .map(|i| color((i / slab.edge * slab.edge + y) * slab.edge + i % slab.edge))
        .collect()
}

/// `models.png`: one row a model, the target and each way to refine.
pub fn models(folder: &Path, runs: &[ModelRun], control: &Control<'_>) -> Result<(), Error> {
    let mut rows: Vec<Vec<Picture>> = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        if i == 0 || runs[i - 1].model != run.model {
            rows.push(vec![run.pictures[0].picture()?]);
        }
        if let Some(row) = rows.last_mut() {
            row.push(run.pictures[1].picture()?);
        }
    }
    contact_sheet(&rows, control)?.write_png(folder.join("models.png"), control)?;
    Ok(())
}
