//! Table and plot of the study.

use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::Row;

/// All rows.
pub fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&["object", "predictor", ">microseconds", ">rmse", ">bias"]);
    for row in rows {
        let time = match row.microseconds.is_finite() {
            true => format!("{:.2}", row.microseconds),
            false => String::new(),
        };
        table.row([
            row.object.clone(),
            row.predictor.clone(),
            time,
            format!("{:.4}", row.rmse),
            format!("{:+.4}", row.bias),
        ]);
    }
    table
}

/// The text.
pub fn markdown(rows: &[Row]) -> String {
    format!(
        "Root mean square error of linear radiance, the reference's noise taken out, and processor time a point and \
         channel of neighbouring surface points on one thread: stencils, first flights and interpolation included, the \
         choice of points and the tables of an object not. A network that is run every so many mm gives other points \
         what a plane fitted to its outputs gives; so it is with levels that are read farther apart.\n\n{}",
        table(rows).markdown()
    )
}

/// The group that a row's curve belongs to.
fn group(predictor: &str) -> &str {
    match predictor {
        p if p.starts_with("network") && p.contains("levels") => "network, coarse levels farther apart",
        p if p.starts_with("network") => "network",
        p if p.starts_with("assisted") => "assisted paths",
        _ => "paths",
    }
}

/// Error against time, a panel an object.
pub fn plot(rows: &[Row]) -> Plot {
    let timed = || rows.iter().filter(|r| r.microseconds.is_finite());
    let mut panels: Vec<Panel> = Vec::new();
    for row in timed() {
        let at = panels.iter().position(|p| p.title == row.object).unwrap_or_else(|| {
            panels.push(Panel { title: row.object.clone(), series: Vec::new() });
            panels.len() - 1
        });
        let series = &mut panels[at].series;
        let name = group(&row.predictor);
        let line = series.iter().position(|s| s.name == name).unwrap_or_else(|| {
            series.push(Series { name: name.into(), points: Vec::new() });
            series.len() - 1
        });
        series[line].points.push([row.microseconds, row.rmse]);
    }
    for series in panels.iter_mut().flat_map(|p| &mut p.series) {
        series.points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    Plot {
        x: Axis::around("microseconds a point and channel", timed().map(|r| r.microseconds)),
        y: Axis::around("rmse", timed().map(|r| r.rmse)),
        panels,
    }
}
