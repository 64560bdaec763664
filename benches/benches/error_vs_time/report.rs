//! Tables and plot of the study.

use std::fmt::Write;

use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::predictors::Row;
use super::table_one::Line;

/// Errors for which the fastest predictor is named.
const WANTED: [f64; 5] = [0.1, 0.05, 0.03, 0.02, 0.01];

/// What predictors judged in a loop are called, after their name.
const LOOP: &str = ", in a loop";

/// All rows.
pub fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "class",
        "object",
        "predictor",
        ">us a point and channel",
        ">s a pass",
        ">RMSE",
        ">bias",
        ">95 % below",
        ">mean dE2000",
    ]);
    for row in rows {
        table.row([
            row.class.clone(),
            row.object.clone(),
            row.predictor.clone(),
            format!("{:.2}", row.microseconds),
            row.pass_seconds.map_or(String::new(), |s| format!("{s:.1}")),
            format!("{:.4}", row.rmse),
            format!("{:+.4}", row.bias),
            format!("{:.3}", row.p95),
            format!("{:.2}", row.delta_e),
        ]);
    }
    table
}

/// The text.
pub fn markdown(rows: &[Row], lines: &[Line]) -> String {
    let mut out = String::from(
        "A predictor's error in linear radiance (0 to 1; the reference's noise is taken out of the RMSE, and is part of \
         the 95 % and of dE2000), and its processor time a point and channel of neighbouring surface points on one \
         thread. \"s a pass\" is what a refinement waits for: all surface points, on the clock, on all cores. The \
         network alone is biased and its error does not average out over passes; that of plain and adaptive paths \
         does. The corrected network in a loop was judged in its sixth pass, its memory filled.\n\n",
    );
    let _ = writeln!(out, "## The fastest for an error\n\n{}", fastest(rows).markdown());
    let _ = writeln!(out, "## The front\n\nNo other predictor errs less in less time.\n");
    for (class, front) in fronts(rows) {
        let _ = writeln!(out, "- {class}: {}", front.join("; "));
    }
    let _ = writeln!(out, "\n## Seconds a prediction\n\n{}", table_one(lines));
    let _ = writeln!(out, "## All\n\n{}", table(rows).markdown());
    out
}

/// Means over the objects of a class: predictor, family, microseconds, RMSE; the means of squares for the latter.
fn of_class(rows: &[Row], class: &str) -> Vec<(String, f64, f64)> {
    let mut means: Vec<(String, f64, f64, f64)> = Vec::new();
    for row in rows.iter().filter(|r| r.class == class) {
        match means.iter_mut().find(|m| m.0 == row.predictor) {
            Some(mean) => {
                mean.1 += row.microseconds;
                mean.2 += row.rmse.powi(2);
                mean.3 += 1.0;
            }
            None => means.push((row.predictor.clone(), row.microseconds, row.rmse.powi(2), 1.0)),
        }
    }
    means.into_iter().map(|(name, us, squares, n)| (name, us / n, (squares / n).sqrt())).collect()
}

fn classes(rows: &[Row]) -> Vec<&str> {
    let mut classes: Vec<&str> = Vec::new();
    for row in rows {
        if !classes.contains(&row.class.as_str()) {
            classes.push(&row.class);
        }
    }
    classes
}

/// The fastest predictor of each class whose RMSE is at most so much.
fn fastest(rows: &[Row]) -> Table {
    let mut table = Table::new(&["class", ">RMSE at most", "predictor", ">us", ">RMSE", ">plain paths' us"]);
    for class in classes(rows) {
        let means = of_class(rows, class);
        for wanted in WANTED {
            let reaches = means.iter().filter(|m| m.2 <= wanted);
            let Some(best) = reaches.min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            // An error of paths falls as the root of their number.
            let most = means.iter().rfind(|m| m.0.starts_with("paths, "));
            let paths = most.map_or(String::new(), |m| format!("{:.1}", m.1 * (m.2 / wanted).powi(2)));
            table.row([
                class.to_owned(),
                wanted.to_string(),
                best.0.clone(),
                format!("{:.1}", best.1),
                format!("{:.4}", best.2),
                paths,
            ]);
        }
    }
    table
}

/// Of each class the predictors that no other beats, from the fastest on.
fn fronts(rows: &[Row]) -> Vec<(&str, Vec<String>)> {
    let front = |class| {
        let mut means = of_class(rows, class);
        means.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut least = f64::INFINITY;
        means.retain(|m| {
            let better = m.2 < least;
            least = least.min(m.2);
            better
        });
        means.into_iter().map(|(name, us, rmse)| format!("{name} ({us:.1} us, {rmse:.3})")).collect()
    };
    classes(rows).into_iter().map(|class| (class, front(class))).collect()
}

fn table_one(lines: &[Line]) -> String {
    let mut table = Table::new(&[
        "model",
        ">surface points",
        ">network s",
        ">corrected network s",
        ">512 paths s",
        ">speedup",
        ">corrected",
    ]);
    for line in lines {
        let [network, corrected, paths] = line.seconds;
        table.row([
            line.model.clone(),
            line.points.to_string(),
            format!("{network:.1}"),
            format!("{corrected:.1}"),
            format!("{paths:.0}"),
            format!("{:.0}", paths / network),
            format!("{:.0}", paths / corrected),
        ]);
    }
    format!(
        "Of a whole model at its own size, before refinement, in processor seconds of one core, as the paper's Table 1 has \
         them; those of 512 paths from some 400 points. Both sides are this project's.\n\n{}",
        table.markdown()
    )
}

/// Error against time, a panel an object.
pub fn plot(rows: &[Row]) -> Plot {
    let mut panels: Vec<Panel> = Vec::new();
    for row in rows {
        let at = panels.iter().position(|p| p.title == row.object).unwrap_or_else(|| {
            panels.push(Panel { title: row.object.clone(), series: Vec::new() });
            panels.len() - 1
        });
        // With its memory filled it is another curve.
        let name = row.family.clone() + if row.predictor.ends_with(LOOP) { LOOP } else { "" };
        let series = &mut panels[at].series;
        let line = series.iter().position(|s| s.name == name).unwrap_or_else(|| {
            series.push(Series { name, points: Vec::new() });
            series.len() - 1
        });
        series[line].points.push([row.microseconds, row.rmse]);
    }
    for series in panels.iter_mut().flat_map(|p| &mut p.series) {
        series.points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    Plot {
        x: Axis::around("microseconds a point and channel", rows.iter().map(|r| r.microseconds)),
        y: Axis::around("RMSE", rows.iter().map(|r| r.rmse)),
        panels,
    }
}
