//! Constant tiles, unchanged tiles, levels that hold nothing new.

use pellucid::stencil::{ChangedTiles, Coefficients, Features, StencilSpec, Stencils};
use pellucid::voxel::{Control, CountSat, LabelGrid, MaterialTable};
use pellucid_benches::appearance::Error;
use pellucid_benches::dense::DenseSat;
use pellucid_benches::solids::ball;
use pellucid_benches::study::stopwatch::time;

use super::scene::Scene;
use super::{Saving, greatest};

/// Points whose stencils are timed.
const POINTS: usize = 4096;
/// Levels of the stencil that are no wider than the smallest object.
const FINE: usize = 6;
/// Boxes on which tables are compared.
const BOXES: i64 = 500;

pub fn savings(scene: &Scene, control: &Control<'_>) -> Result<Vec<Saving>, Error> {
    let table = MaterialTable::cmykw();
    let (sat, build) = time(|| CountSat::build(&scene.labels, table.len(), control))?;
    let mut savings = constant_tiles(scene, &table, &sat, build)?;

    let mut updated = CountSat::build(&scene.labels, table.len(), control)?;
    let mut forward = true;
    let (_, update) = time(|| {
        let grid = if forward { &scene.moved } else { &scene.labels };
        forward = !forward;
        updated.update(grid, &scene.changed, control)
    })?;
    savings.push(Saving {
        what: "tiles of the summed-area table that did not change".into(),
        object: scene.name(),
        unit: "s a rebuild".into(),
        without: build,
        with: update,
        changes: "nothing (integers)".into(),
    });

    let coefficients = Coefficients::all(&table, Features::ScatterAbsorb)?;
    let points: Vec<[u32; 3]> =
        scene.near.iter().take(POINTS).map(|&p| scene.object.surface().voxels()[p as usize]).collect();
    savings.extend(refreshed(scene, &table, &coefficients, &points, control)?);
    savings.push(coarse_levels(scene, &sat, &coefficients, &points, control)?);
    Ok(savings)
}

/// Against dense tables of every coefficient, as the method's authors sum them.
fn constant_tiles(
    scene: &Scene,
    table: &MaterialTable,
    sat: &CountSat,
    build: f64,
) -> Result<Vec<Saving>, Error> {
    let (dense, spent) = time(|| Ok::<_, Error>(DenseSat::of_channels(&scene.labels, table)))?;
    let sigma: Vec<f64> = table.materials().iter().map(|m| f64::from(m.sigma_s[0])).collect();
    let size = scene.labels.size().map(i64::from);
    let off = (0..BOXES)
        .map(|i| {
            let low: [i64; 3] = std::array::from_fn(|a| i * (7 + 4 * a as i64) % (size[a] - 8));
            let high: [i64; 3] = std::array::from_fn(|a| (low[a] + 8 + i % 60).min(size[a]));
            let volume: i64 = (0..3).map(|a| high[a] - low[a]).product();
            (sat.mean(low, high, &sigma) - dense[0].sum(low, high) / volume as f64).abs()
        })
        .fold(0.0, f64::max);
    let bytes = |bytes: usize| bytes as f64 / f64::from(1 << 20);
    let changes = match off > 0.0 {
        true => format!("means by at most {off:.0e} per mm (the dense ones' rounding)"),
        false => "nothing".into(),
    };
    let row = |unit, without, with| Saving {
        what: "air and solid white: constant tiles of the summed-area table".into(),
        object: scene.name(),
        unit: String::from(unit),
        without,
        with,
        changes: changes.clone(),
    };
    let memory = dense.iter().map(DenseSat::bytes).sum();
    Ok(vec![row("MiB", bytes(memory), bytes(sat.memory().total())), row("s a build", spent, build)])
}

/// Stencils of points after some tiles changed.
fn refreshed(
    scene: &Scene,
    table: &MaterialTable,
    coefficients: &Coefficients,
    points: &[[u32; 3]],
    control: &Control<'_>,
) -> Result<Vec<Saving>, Error> {
    let sat = CountSat::build(&scene.moved, table.len(), control)?;
    let stencils = Stencils::new(StencilSpec::paper(), &scene.moved, &sat)?;
    let old_sat = CountSat::build(&scene.labels, table.len(), control)?;
    let old = Stencils::new(StencilSpec::paper(), &scene.labels, &old_sat)?;
    let row = coefficients.values_per_point(stencils.spec());
    let mut before = vec![0.0; points.len() * row];
    old.extract(coefficients, points, &mut before, control)?;
    let mut anew = before.clone();
    let (_, all) = time(|| stencils.extract(coefficients, points, &mut anew, control))?;
    let changed = ChangedTiles::new(&scene.moved, &scene.changed)?;
    let mut kept = before;
    let (_, some) = time(|| stencils.refresh(coefficients, points, &changed, &mut kept, control))?;
    Ok(vec![Saving {
        what: "levels of stencils that meet no changed tile".into(),
        object: scene.name(),
        unit: "us a point".into(),
        without: 1e6 * all / points.len() as f64,
        with: 1e6 * some / points.len() as f64,
        changes: greatest(&anew, &kept),
    }])
}

/// What the coarse levels take where they hold air and solid white, and where every voxel of the object is halftoned.
fn coarse_levels(
    scene: &Scene,
    sat: &CountSat,
    coefficients: &Coefficients,
    points: &[[u32; 3]],
    control: &Control<'_>,
) -> Result<Saving, Error> {
    let paper = StencilSpec::paper();
    let fine = StencilSpec::new(paper.cells(), FINE)?;
    let spent = |grid: &LabelGrid, sat: &CountSat| -> Result<f64, Error> {
        let mut seconds = [0.0; 2];
        for (spec, seconds) in [fine, paper].into_iter().zip(&mut seconds) {
            let stencils = Stencils::new(spec, grid, sat)?;
            let mut out = vec![0.0; points.len() * coefficients.values_per_point(&spec)];
            *seconds = time(|| stencils.extract(coefficients, points, &mut out, control))?.1;
        }
        Ok(1e6 * (seconds[1] - seconds[0]) / points.len() as f64)
    };
    let mixed = ball(scene.mm, scene.mm);
    let mixed_sat = CountSat::build(&mixed, coefficients.materials(), control)?;
    Ok(Saving {
        what: "boxes of stencils that lie in solid white".into(),
        object: format!("{} beside one that is halftoned throughout", scene.name()),
        unit: "us of a point's levels 7 to 9".into(),
        without: spent(&mixed, &mixed_sat)?,
        with: spent(&scene.labels, sat)?,
        changes: "nothing (integers)".into(),
    })
}
