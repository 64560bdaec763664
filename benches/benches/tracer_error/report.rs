//! The tables and the plot of the tracer's study.

use std::fmt::Write as _;

use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::Row;

/// The estimators, as rows name them.
const ESTIMATORS: [&str; 3] = ["plain", "adaptive", "assisted"];
/// Errors whose times are told.
const LEVELS: [f64; 4] = [0.05, 0.03, 0.02, 0.01];
/// Scatterings of a path in the white cube.
const SCATTERINGS: f64 = 331.0;

/// The time at which an estimator's curve passes `rmse`, interpolated in logarithms.
fn time_for(rows: &[Row], scene: &str, estimator: &str, rmse: f64) -> Option<f64> {
    let curve: Vec<&Row> = rows.iter().filter(|r| r.scene == scene && r.estimator == estimator).collect();
    if curve.first()?.rmse <= rmse {
        return Some(curve[0].microseconds);
    }
    curve.windows(2).find(|w| w[0].rmse > rmse && w[1].rmse <= rmse).map(|w| {
        let t = (w[0].rmse / rmse).ln() / (w[0].rmse / w[1].rmse).ln();
        (w[0].microseconds.ln() + t * (w[1].microseconds / w[0].microseconds).ln()).exp()
    })
}

/// The summary for readers.
pub(super) fn markdown(scenes: &[(&str, &str)], rows: &[Row], rates: &[(String, f64)]) -> String {
    let mut text = String::from(
        "Times are processor time per point and channel. Boundary n = 1.5, default materials. RMSE over about 500 points \
         and 3 channels against the reference, whose own variance is subtracted.\n\n",
    );
    let mut table = Table::new(&["scene", "what"]);
    for (name, what) in scenes {
        table.row([(*name).into(), (*what).into()]);
    }
    text += &table.markdown();
    text += "\n## Microseconds a point and channel for an RMSE\n\n";
    text += &times(scenes, rows).markdown();
    text += "\n`assisted` is biased: its mean error is in [tracer_error.csv](tracer_error.csv). A dash: not reached within \
             the paths measured. `adaptive` spends paths to make the error even over points, which the RMSE over all of \
             them does not reward.\n";
    text += "\n## White cube of 10 mm, blue, index-matched\n\n";
    let mut table = Table::new(&["tracer", ">paths/s", ">ns a scattering"]);
    for (name, rate) in rates {
        table.row([name.clone(), format!("{rate:.0}"), format!("{:.2}", 1e9 / rate / SCATTERINGS)]);
    }
    text += &table.markdown();
    text += &beside_mitsuba(rates);
    let _ = writeln!(text, "\n{SCATTERINGS} scatterings a path on average. Plain unbiased tracking.");
    text
}

/// Times to reach each error, and gains over plain tracking.
fn times(scenes: &[(&str, &str)], rows: &[Row]) -> Table {
    let mut columns: Vec<String> = vec!["scene".into(), "estimator".into()];
    columns.extend(LEVELS.map(|rmse| format!(">{rmse}")));
    columns.extend([">gain at 0.03".into(), ">gain at 0.02".into()]);
    let mut table = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    let show = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.1}"));
    for (scene, _) in scenes {
        for estimator in ESTIMATORS {
            let time = |rmse| time_for(rows, scene, estimator, rmse);
            let gain = |rmse| time_for(rows, scene, "plain", rmse).zip(time(rmse)).map(|(p, e)| p / e);
            let mut cells = vec![(*scene).to_owned(), estimator.to_owned()];
            cells.extend(LEVELS.map(|rmse| show(time(rmse))));
            cells.extend([show(gain(0.03)), show(gain(0.02))]);
            table.row(cells);
        }
    }
    table
}

/// How many times Mitsuba's rates our vectorised ones are, where it was measured.
fn beside_mitsuba(rates: &[(String, f64)]) -> String {
    let peer = |what: &str| {
        rates.iter().find(|(n, _)| n.starts_with("Mitsuba") && n.contains(what)).map(|(_, rate)| *rate)
    };
    let mut text = String::new();
    let peers = peer("voxel grid, default").zip(peer("voxel grid, emitter sampling off"));
    if let Some((default, fast)) = peers {
        for (name, ours) in rates.iter().filter(|(name, _)| name.starts_with("voxel grid, ")) {
            let _ = writeln!(
                text,
                "\n{name}: {:.0} times Mitsuba's with its default settings, {:.0} times with emitter sampling off.",
                ours / default,
                ours / fast
            );
        }
    }
    text
}

/// One row a measurement.
pub(super) fn table(rows: &[Row]) -> Table {
    let mut table =
        Table::new(&["scene", "estimator", "spp", "microseconds_per_value", "rmse", "mean_error"]);
    for r in rows {
        table.row([
            r.scene.into(),
            r.estimator.into(),
            format!("{:.1}", r.spp),
            format!("{:.3}", r.microseconds),
            format!("{:.5}", r.rmse),
            format!("{:.5}", r.bias),
        ]);
    }
    table
}

/// Error against time, a panel a scene.
pub(super) fn plot(scenes: &[(&str, &str)], rows: &[Row]) -> Plot {
    let series = |scene: &str, estimator: &str| Series {
        name: estimator.to_owned(),
        points: rows
            .iter()
            .filter(|r| r.scene == scene && r.estimator == estimator)
            .map(|r| [r.microseconds, r.rmse])
            .collect(),
    };
    Plot {
        x: Axis { title: "microseconds a point and channel, one thread".into(), range: [0.1, 10_000.0] },
        y: Axis { title: "RMSE of linear radiance".into(), range: [0.001, 0.5] },
        panels: scenes
            .iter()
            .map(|(scene, _)| Panel {
                title: (*scene).to_owned(),
                series: ESTIMATORS.map(|estimator| series(scene, estimator)).into(),
            })
            .collect(),
    }
}
