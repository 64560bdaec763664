//! Draws the `curve.csv` of `pellucid train` as SVG.
//!
//! `cargo run -p pellucid-benches --example training_curve -- OUT/curve.csv OUT/curve.svg`

use std::error::Error;

use pellucid_benches::study::{Axis, Panel, Plot, Series};

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1);
    let (Some(csv), Some(svg)) = (paths.next(), paths.next()) else {
        return Err("give the curve.csv to read and the SVG to write".into());
    };
    let text = std::fs::read_to_string(&csv).map_err(|e| format!("{csv}: {e}"))?;
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap_or_default();
    let column =
        |name: &str| header.iter().position(|h| *h == name).ok_or(format!("{csv}: no column {name}"));
    let (samples, training, validation) =
        (column("samples")?, column("training_rmse")?, column("validation_rmse")?);
    let rows: Vec<Vec<&str>> = lines.collect();
    // Fields that were not measured are empty, and not drawn.
    let value = |row: &[&str], at: usize| row.get(at).and_then(|v| v.parse().ok()).unwrap_or(f64::NAN);
    let series = |name: &str, at| Series {
        name: name.to_owned(),
        points: rows.iter().map(|row| [value(row, samples), value(row, at)]).collect(),
    };
    let series = vec![
        series("training (with label noise)", training),
        series("validation, averaged weights", validation),
    ];
    let points = || series.iter().flat_map(|s| &s.points);
    let plot = Plot {
        x: Axis::around("samples", points().map(|p| p[0])),
        y: Axis::around("RMSE", points().map(|p| p[1])),
        panels: vec![Panel { title: "training".into(), series: series.clone() }],
    };
    std::fs::write(&svg, plot.svg()).map_err(|e| format!("{svg}: {e}"))?;
    Ok(())
}
