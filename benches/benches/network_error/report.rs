//! The study's table and text.

use std::fmt::Write;

use pellucid::dataset::ShapeClass;
use pellucid::rpnn::Precision;
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::scores::Row;
use super::{Candidate, shared};

/// A number format in words.
pub fn precision(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f32",
        Precision::Bf16 => "factors rounded to bfloat16, sums in f32",
    }
}

/// A family of shapes, or all of them.
fn class_name(class: Option<ShapeClass>) -> &'static str {
    class.map_or("all", ShapeClass::name)
}

/// Paths that plain tracing traces in the time of a network, by the time of the most paths measured.
pub fn equal_time_paths(rows: &[Row], network: &str) -> f64 {
    let whole = || rows.iter().filter(|r| r.class.is_none());
    let ours = whole().find(|r| r.predictor == network);
    let most = whole().max_by_key(|r| r.spp);
    match (ours, most) {
        (Some(ours), Some(most)) => f64::from(most.spp) * ours.microseconds / most.microseconds,
        _ => 1.0,
    }
}

/// All rows.
pub fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "set",
        "class",
        "predictor",
        "paths",
        "microseconds_a_sample",
        "samples",
        "rmse",
        "bias",
        "p95",
        "mean_de2000",
    ]);
    for r in rows {
        table.row([
            r.set.clone(),
            class_name(r.class).into(),
            r.predictor.clone(),
            r.spp.to_string(),
            format!("{:.3}", r.microseconds),
            r.samples.to_string(),
            format!("{:.5}", r.rmse),
            format!("{:.5}", r.bias),
            format!("{:.5}", r.p95),
            format!("{:.3}", r.delta_e),
        ]);
    }
    table
}

/// Error against time, a panel a set: Monte Carlo's curve, a dot for each network.
pub fn plot(rows: &[Row]) -> Plot {
    let panel = |set: &str| {
        let mut series: Vec<Series> = Vec::new();
        for r in rows.iter().filter(|r| r.set == set && r.class.is_none()) {
            let name = if r.spp > 0 { "Monte Carlo" } else { r.predictor.as_str() };
            let point = [r.microseconds, r.rmse];
            match series.iter_mut().find(|s| s.name == name) {
                Some(known) => known.points.push(point),
                None => series.push(Series { name: name.to_owned(), points: vec![point] }),
            }
        }
        Panel { title: set.to_owned(), series }
    };
    Plot {
        x: Axis { title: "microseconds a sample, one thread".into(), range: [0.1, 100.0] },
        y: Axis { title: "RMSE of linear radiance".into(), range: [0.01, 0.5] },
        panels: sets(rows).into_iter().map(panel).collect(),
    }
}

/// Names of the sets, in the order of the rows.
fn sets(rows: &[Row]) -> Vec<&str> {
    let mut sets: Vec<&str> = rows.iter().map(|r| r.set.as_str()).collect();
    sets.dedup();
    sets
}

/// The report.
pub fn markdown(rows: &[Row], candidates: &[Candidate], pictures: &[(String, String, f64)]) -> String {
    let mut out = String::from(
        "A sample is one surface point in one channel. RMSE and bias are in linear radiance, 0 to 1, the labels' own \
         variance taken out of the RMSE; dE2000 is the mean over points relative to the print's white, label noise \
         included. Times are processor time; a network's contains the extraction of its stencils, not the summed-area \
         table. ",
    );
    let _ = writeln!(
        out,
        "\"Coarse levels shared\" is the network as prints use it: {}. Monte Carlo is this project's vectorised tracer, \
         timed at its largest number of paths and in proportion below.\n",
        shared::description()
    );
    for c in candidates {
        let parameters = c.trained.weights.values().len();
        let _ = writeln!(out, "- {}: {parameters} parameters. {}", c.name, c.trained.provenance.history);
    }
    for set in sets(rows) {
        let of_set = || rows.iter().filter(|r| r.set == set);
        let _ = writeln!(out, "\n## {set}: {} samples\n", of_set().next().map_or(0, |r| r.samples));
        let columns = ["predictor", ">us a sample", ">RMSE", ">bias", ">95 % below", ">mean dE2000"];
        let mut table = Table::new(&columns);
        for r in of_set().filter(|r| r.class.is_none()) {
            table.row([
                r.predictor.clone(),
                format!("{:.1}", r.microseconds),
                format!("{:.4}", r.rmse),
                format!("{:+.4}", r.bias),
                format!("{:.4}", r.p95),
                format!("{:.2}", r.delta_e),
            ]);
        }
        out += &table.markdown();
    }
    out += "\n## By shape, at equal time\n\nThe first network as prints use it; \
            [network_error.csv](network_error.csv) has all. Monte Carlo's RMSE is scaled from its largest number of \
            paths to the network's time of the set, as the inverse root of the number of paths.\n\n";
    if let Some(first) = candidates.first() {
        out += &by_shape(rows, &shared::name_in_use(first)).markdown();
    }
    if !pictures.is_empty() {
        out += "\n## Pictures\n\nFrom the left: reference (1024 paths), prediction, its error. Rows: the networks in the \
                order above, then Monte Carlo in the first one's time. Errors are the mean over channels: red too light, \
                blue too dark, full colour at 0.1.\n";
    }
    for (file, set, paths) in pictures {
        let _ = write!(
            out,
            "\nA volume of {set}; {paths:.0} paths take the first network's time:\n\n![{set}]({file})\n"
        );
    }
    out
}

/// A network beside Monte Carlo in its time, by family of shapes.
fn by_shape(rows: &[Row], network: &str) -> Table {
    let mut table = Table::new(&[
        "set",
        "shape",
        ">samples",
        ">network's RMSE",
        ">Monte Carlo paths in its time",
        ">their RMSE",
    ]);
    for set in sets(rows) {
        let of_set: Vec<&Row> = rows.iter().filter(|r| r.set == set).collect();
        let most = of_set.iter().map(|r| r.spp).max().unwrap_or(0);
        let whole = of_set.iter().find(|r| r.class.is_none() && r.spp == most);
        for r in of_set.iter().filter(|r| r.predictor == network) {
            let mc = of_set.iter().find(|m| m.class == r.class && m.spp == most);
            let (Some(whole), Some(mc)) = (whole, mc) else { continue };
            let paths = f64::from(most) * r.microseconds / whole.microseconds;
            table.row([
                set.to_owned(),
                class_name(r.class).into(),
                r.samples.to_string(),
                format!("{:.4}", r.rmse),
                format!("{paths:.0}"),
                format!("{:.4}", mc.rmse * (f64::from(most) / paths).sqrt()),
            ]);
        }
    }
    table
}
