//! Tables, plots and text of the study.

use std::path::Path;

use pellucid::core::files::write_whole_bytes;
use pellucid_benches::appearance::Error;
use pellucid_benches::slab::rule::Rule;
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::models::ModelRun;
use super::pictures::FULL_DELTA_E;
use super::runs::{HEURISTICS, NEAR_MM, Point, Run, Start};
use super::scene::Scene;
use super::verdict;

fn optional(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |v| format!("{v:.digits$}"))
}

fn iteration(point: Option<&Point>) -> String {
    point.map_or("-".into(), |p| p.iteration.to_string())
}

/// Final errors on the slab.
fn ends(runs: &[Run]) -> Table {
    let near = format!(">within {NEAR_MM} mm %");
    let mut table = Table::new(&[
        "method",
        "start",
        ">rate",
        ">RMSE",
        ">dE2000",
        ">sharpness",
        &near,
        ">iterations",
        ">to 5 %: RMSE",
        ">to 5 %: dE2000",
        ">as the heuristic",
        ">paths to that",
    ]);
    for run in runs {
        let matches = verdict::matches(run, &runs[0]);
        table.row([
            run.method.clone(),
            run.start.clone(),
            run.rate.map_or(String::new(), |r| r.to_string()),
            format!("{:.4}", run.last.rmse),
            format!("{:.2}", run.last.delta_e),
            optional(run.last.sharpness, 2),
            format!("{:.0}", 100.0 * run.near_surface),
            run.last.iteration.to_string(),
            iteration(verdict::settled(run, |p| p.rmse)),
            iteration(verdict::settled(run, |p| p.delta_e)),
            iteration(matches),
            matches.map_or("-".into(), |p| p.paths.to_string()),
        ]);
    }
    table
}

/// Final errors of the models.
fn model_ends(runs: &[ModelRun]) -> Table {
    let mut table = Table::new(&[
        "model",
        "method",
        ">surface voxels",
        ">RMSE",
        ">voxel",
        ">0.1 mm",
        ">sharpness",
        ">iterations",
        ">kept",
        ">to 5 %",
        ">paths to that",
        ">seconds to that",
    ]);
    for run in runs {
        let settled = verdict::model_settled(run);
        table.row([
            run.model.clone(),
            run.method.clone(),
            run.surface_voxels.to_string(),
            format!("{:.4}", run.rmse),
            format!("{:.2}", run.voxel),
            format!("{:.2}", run.delta_e),
            optional(run.sharpness, 2),
            run.points.last().map_or(String::new(), |p| p.iteration.to_string()),
            run.best.to_string(),
            settled.map_or("-".into(), |p| p.iteration.to_string()),
            settled.map_or("-".into(), |p| format!("{:.0}", p.paths)),
            settled.map_or("-".into(), |p| format!("{:.0}", p.seconds)),
        ]);
    }
    table
}

/// All judged iterates, and those of models as their loops see them.
pub fn points(runs: &[Run], models: &[ModelRun]) -> Table {
    let mut table =
        Table::new(&["object", "method", "start", "iteration", "paths", "rmse", "delta_e", "sharpness"]);
    for run in runs {
        for p in &run.points {
            table.row([
                "slab".into(),
                run.method.clone(),
                run.start.clone(),
                p.iteration.to_string(),
                p.paths.to_string(),
                format!("{:.5}", p.rmse),
                format!("{:.3}", p.delta_e),
                optional(p.sharpness, 3),
            ]);
        }
    }
    for run in models {
        for p in &run.points {
            table.row([
                run.model.clone(),
                run.method.clone(),
                String::new(),
                p.iteration.to_string(),
                format!("{:.1}", p.paths),
                String::new(),
                format!("{:.3}", p.delta_e),
                String::new(),
            ]);
        }
    }
    table
}

/// A panel a method of descent, with the heuristics in each.
fn plot(runs: &[Run], [across, up]: [&str; 2], x: impl Fn(&Point) -> f64, y: impl Fn(&Point) -> f64) -> Plot {
    let curve = |run: &Run, name: &str| Series {
        name: name.to_owned(),
        points: run.points.iter().map(|p| [x(p), y(p)]).collect(),
    };
    let (heuristics, descents) = runs.split_at(HEURISTICS.len());
    let panels: Vec<Panel> = descents
        .chunks(Start::ALL.len())
        .map(|row| {
            let heuristics = heuristics.iter().map(|run| curve(run, &run.method));
            let descents = row.iter().map(|run| curve(run, &format!("descent from {}", run.start)));
            Panel { title: row[0].method.clone(), series: heuristics.chain(descents).collect() }
        })
        .collect();
    framed(across, up, panels)
}

fn framed(across: &str, up: &str, panels: Vec<Panel>) -> Plot {
    let values = |k: usize| -> Vec<f64> {
        panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points).map(|p| p[k]).collect()
    };
    Plot { x: Axis::around(across, values(0)), y: Axis::around(up, values(1)), panels }
}

/// CIEDE2000 by iteration: the paper's Figure 15.
pub fn by_iteration(runs: &[Run]) -> Plot {
    let axes = ["iterations + 1", "mean dE2000 at 0.1 mm"];
    plot(runs, axes, |p| f64::from(p.iteration + 1), |p| p.delta_e)
}

/// Writes the other plots.
pub fn plots(folder: &Path, runs: &[Run], models: &[ModelRun]) -> Result<(), Error> {
    let axes = ["paths a point and channel", "mean dE2000 at 0.1 mm"];
    let paths = plot(runs, axes, |p| f64::from(p.paths), |p| p.delta_e);
    let axes = ["iterations + 1", "RMSE of linear colours"];
    let rmse = plot(runs, axes, |p| f64::from(p.iteration + 1), |p| p.rmse);
    let mut panels: Vec<Panel> = Vec::new();
    for run in models {
        if panels.last().is_none_or(|p| p.title != run.model) {
            panels.push(Panel { title: run.model.clone(), series: Vec::new() });
        }
        let points = run.points.iter().map(|p| [f64::from(p.iteration + 1), p.delta_e]).collect();
        let series = Series { name: run.method.clone(), points };
        panels.iter_mut().last().into_iter().for_each(|panel| panel.series.push(series.clone()));
    }
    let models = framed("iterations + 1", "dE2000 at 0.1 mm in the loop", panels);
    for (name, plot) in [("paths.svg", paths), ("rmse.svg", rmse), ("models.svg", models)] {
        write_whole_bytes(folder.join(name), plot.svg().as_bytes())?;
    }
    Ok(())
}

/// The text.
pub fn markdown(scene: &Scene, runs: &[Run], models: &[ModelRun]) -> String {
    let e = &scene.effort;
    let [smoothed, alone] = e.heuristic_spp;
    let (sgd, adam) = (Rule::Sgd.rates(), Rule::Adam.rates());
    let rows: Vec<&str> =
        runs[HEURISTICS.len()..].chunks(Start::ALL.len()).map(|row| row[0].method.as_str()).collect();
    format!(
        "## In a setting like the paper's\n\n{verdicts}\n{ends}\n\
         A slab of constant extinction with isotropic scattering whose albedos are free, voxel by voxel and channel by \
         channel: nothing is halftoned. Mean dE2000 is taken after a Gaussian of 0.1 mm, RMSE voxel by voxel, the judge's \
         noise taken out; sharpness is the share of the target's local contrast. The heuristic is surface-first: the \
         target's albedo to begin with, then what each voxel lacks, smoothed by 0.1 mm as in the library, added from the \
         surface down; {smoothed} paths a point and channel predict. Unsmoothed, each voxel has only its own, and {alone} paths \
         predict. Descent takes derivatives by path replay at other paths than its prediction's; its rate, \
         which falls to a fifth, is the best of {sgd:?} (SGD) and {adam:?} (Adam) after {trial} iterations from grey. \"To 5 %\" \
         is the first iterate that was judged within 5 % of the run's best, \"as the heuristic\" the first within 5 % of its \
         last dE2000.\n\n\
         ![by paths](paths.svg)\n\n![RMSE](rmse.svg)\n\n\
         Target, heuristic, unsmoothed heuristic; below, from the top, {rows}; from the left, from {starts}:\n\n\
         ![cutouts](slabs.png)\n\n\
         The same without the target as CIEDE2000 at 0.1 mm, brightest at {FULL_DELTA_E}:\n\n![differences](differences.png)\n\n\
         And cut down through the stripes, the surface above; a voxel's colour is that of a thick block of its \
         albedo:\n\n![sections](sections.png)\n\n\
         ## In the full setting\n\n{model_verdicts}\n{model_ends}\n\
         Layers, inks and halftone of a print, by the library's `SurfaceFirst` and `Descent` (which opens with five steps of \
         the former, and follows a perceptual loss). The judge's paths are its own. Paths are those of the loop, a point and \
         channel.\n\n![models](models.svg)\n\nThe printable target, then each in the table's order:\n\n![models](models.png)",
        verdicts = verdict::slabs(runs),
        ends = ends(runs).markdown(),
        trial = e.trial_iterations,
        rows = rows.join(", "),
        starts = Start::ALL.map(Start::name).join(", "),
        model_verdicts = verdict::models(models),
        model_ends = model_ends(models).markdown(),
    )
}
