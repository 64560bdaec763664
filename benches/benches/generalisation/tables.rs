//! The study's tables and plots.

use pellucid::rpnn::Variant;
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::finished::Finished;
use super::plan::{Plan, Shapes};
use super::scores::Row;
use super::speed::Speed;

/// All rows.
pub fn all(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "set",
        "class",
        "trained_on",
        "seed",
        "variant",
        "samples",
        "rmse",
        "bias",
        "p95",
        "mean_de2000",
        "reference_std_error",
    ]);
    for r in rows {
        table.row([
            r.set.clone(),
            if r.class.is_empty() { "all".into() } else { r.class.clone() },
            r.shapes.clone(),
            r.seed.to_string(),
            r.variant.clone(),
            r.samples.to_string(),
            format!("{:.5}", r.rmse),
            format!("{:.5}", r.bias),
            format!("{:.5}", r.p95),
            format!("{:.3}", r.delta_e),
            format!("{:.5}", r.noise),
        ]);
    }
    table
}

/// The paper's Table 2, with times.
pub fn architectures(speeds: &[Speed], stencil_us: f64, networks: &[Finished]) -> Table {
    let mut table = Table::new(&[
        "architecture",
        ">parameters",
        ">ms a training step",
        ">minutes of steps in the runs",
        ">us a sample",
        ">with its stencil",
    ]);
    for speed in speeds {
        let own: Vec<f64> =
            networks.iter().filter(|n| n.variant == speed.variant).map(|n| n.seconds / 60.0).collect();
        table.row([
            speed.variant.name().into(),
            speed.variant.parameters().to_string(),
            format!("{:.1}", speed.step_ms),
            own.iter().map(|m| format!("{m:.0}")).collect::<Vec<_>>().join(", "),
            format!("{:.1}", speed.sample_us),
            format!("{:.1}", speed.sample_us + stencil_us),
        ]);
    }
    table
}

/// Whether the runs came to rest.
pub fn flatness(plan: &Plan, networks: &[Finished]) -> Table {
    let mut table = Table::new(&[
        "trained on",
        ">seed",
        "architecture",
        ">RMSE on the way at 75 %",
        ">at rest at 75 %",
        ">at rest at 100 %",
        ">last quarter, at rest",
        ">bias",
    ]);
    for n in networks {
        let (Some(end), Some(way)) = (n.validation(), n.validation_at(plan.three_quarters())) else {
            continue;
        };
        let rest = n.three_quarters.map(|score| score.rmse);
        table.row([
            n.group.shapes.name().into(),
            n.group.seed.to_string(),
            n.variant.name().into(),
            format!("{:.4}", way.rmse),
            rest.map_or("-".into(), |r| format!("{r:.4}")),
            format!("{:.4}", end.rmse),
            rest.map_or("-".into(), |r| format!("{:+.1} %", 100.0 * (end.rmse / r - 1.0))),
            format!("{:+.4}", end.bias),
        ]);
    }
    table
}

/// Rows of whole sets of networks trained on some shapes.
fn whole(rows: &[Row], shapes: Shapes) -> impl Iterator<Item = &Row> + Clone {
    rows.iter().filter(move |r| r.class.is_empty() && r.shapes == shapes.name())
}

/// A row an architecture, a column a set; seeds beside each other.
pub fn by_set(rows: &[Row], shapes: Shapes, sets: &[&str], value: impl Fn(&Row) -> String) -> Table {
    let columns: Vec<String> = sets.iter().map(|set| format!(">{set}")).collect();
    let columns: Vec<&str> =
        std::iter::once("architecture").chain(columns.iter().map(String::as_str)).collect();
    let mut table = Table::new(&columns);
    for variant in Variant::ALL {
        let cell = |set: &&str| {
            let own = whole(rows, shapes).filter(|r| r.variant == variant.name() && r.set == **set);
            own.map(&value).collect::<Vec<_>>().join(", ")
        };
        table.row(std::iter::once(variant.name().to_owned()).chain(sets.iter().map(cell)));
    }
    table
}

/// RMSE as parts of the baseline's, geometric means over seeds.
pub fn against_baseline(rows: &[Row], shapes: Shapes, sets: &[&str]) -> Table {
    let columns: Vec<String> = sets.iter().map(|set| format!(">{set}")).collect();
    let columns: Vec<&str> =
        std::iter::once("architecture").chain(columns.iter().map(String::as_str)).collect();
    let mut table = Table::new(&columns);
    for variant in Variant::ALL {
        let cell = |set: &&str| {
            let of = |variant: Variant| {
                let own = whole(rows, shapes).filter(|r| r.variant == variant.name() && r.set == **set);
                let logs: Vec<f64> = own.map(|r| r.rmse.ln()).collect();
                logs.iter().sum::<f64>() / logs.len() as f64
            };
            let ratio = (of(variant) - of(Variant::Baseline)).exp();
            if ratio.is_finite() { format!("{ratio:.2}") } else { "-".into() }
        };
        table.row(std::iter::once(variant.name().to_owned()).chain(sets.iter().map(cell)));
    }
    table
}

/// RMSE by shape family of a set: a row a family, a column an architecture, seeds beside each other.
pub fn by_family(rows: &[Row], shapes: Shapes, set: &str) -> Table {
    let mut columns = vec!["shape".to_owned(), ">samples".to_owned()];
    columns.extend(Variant::ALL.iter().map(|v| format!(">{}", v.name())));
    let mut table = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    let of_set: Vec<&Row> =
        rows.iter().filter(|r| r.set == set && r.shapes == shapes.name() && !r.class.is_empty()).collect();
    let mut classes: Vec<&str> = Vec::new();
    for row in &of_set {
        if !classes.contains(&row.class.as_str()) {
            classes.push(&row.class);
        }
    }
    for class in classes {
        let own = || of_set.iter().filter(|r| r.class == class);
        let cell = |variant: &Variant| {
            let own = own().filter(|r| r.variant == variant.name());
            own.map(|r| format!("{:.4}", r.rmse)).collect::<Vec<_>>().join(", ")
        };
        let samples = own().next().map_or(0, |r| r.samples);
        let head = [class.to_owned(), samples.to_string()];
        table.row(head.into_iter().chain(Variant::ALL.iter().map(cell)));
    }
    table
}

/// Validation over the runs, a panel a group; a dot is a run that came to rest at three quarters.
pub fn curves(plan: &Plan, networks: &[Finished]) -> Plot {
    let mut panels: Vec<Panel> = Vec::new();
    for n in networks {
        let title = format!("{}, seed {}", n.group.shapes.name(), n.group.seed);
        if panels.last().is_none_or(|p| p.title != title) {
            panels.push(Panel { title, series: Vec::new() });
        }
        let Some(panel) = panels.last_mut() else { continue };
        let name = n.variant.name().to_owned();
        let points = n.curve.iter().filter_map(|p| Some([p.step as f64, p.validation?.rmse]));
        panel.series.push(Series { name: name.clone(), points: points.collect() });
        if let Some(rest) = n.three_quarters {
            panel.series.push(Series { name, points: vec![[plan.three_quarters() as f64, rest.rmse]] });
        }
    }
    let points = || panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points);
    Plot {
        x: Axis::around("training steps", points().map(|p| p[0])),
        y: Axis::around("validation RMSE", points().map(|p| p[1])),
        panels,
    }
}

/// RMSE against the number of parameters, a panel a set; seeds of an architecture are joined.
pub fn sizes(rows: &[Row], sets: &[&str]) -> Plot {
    let series = |set: &str| {
        let shapes = [Shapes::All, Shapes::Paper];
        let each = shapes.into_iter().flat_map(|s| Variant::ALL.map(|v| (s, v)));
        let series = each.map(|(shapes, variant)| {
            let own = whole(rows, shapes).filter(|r| r.set == set && r.variant == variant.name());
            Series {
                name: format!("{} on {}", variant.name(), shapes.name()),
                points: own.map(|r| [variant.parameters() as f64, r.rmse]).collect(),
            }
        });
        series.filter(|s| !s.points.is_empty()).collect::<Vec<_>>()
    };
    let panels: Vec<Panel> =
        sets.iter().map(|set| Panel { title: (*set).to_owned(), series: series(set) }).collect();
    let points = || panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points);
    Plot {
        x: Axis { title: "parameters".into(), range: [2.5e5, 5e6] },
        y: Axis::around("RMSE of linear radiance", points().map(|p| p[1])),
        panels,
    }
}
