//! The study's table, text and plot.

use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::job::{Cost, Measured, TooLarge};

/// Stages that are told apart.
const STAGES: [&str; 7] =
    ["voxelise", "surface", "thickness", "nearest surface", "refine", "judge", "slices"];
/// Seconds that count as none.
const LEAST: f64 = 1e-3;
const GIB: f64 = (1u64 << 30) as f64;

/// A row a job.
pub fn table(measured: &[Measured]) -> Table {
    let mut columns = vec![
        "model".to_owned(),
        "strategy".into(),
        ">mm high".into(),
        ">surface voxels, 1000s".into(),
        ">solid voxels, millions".into(),
        ">peak GiB".into(),
        ">bytes a surface voxel".into(),
        ">expected / peak".into(),
        ">dE2000 at 0.1 mm".into(),
    ];
    columns.extend(STAGES.iter().map(|stage| format!(">{stage} s")));
    columns.push(">all s".into());
    let mut table = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    for Measured { cost, expected_bytes } in measured {
        let mut row = vec![
            cost.model.clone(),
            cost.way.name(),
            format!("{}", cost.height_mm),
            format!("{:.0}", cost.surface_voxels as f64 / 1e3),
            format!("{:.1}", cost.solid_voxels as f64 / 1e6),
            format!("{:.2}", cost.peak_bytes as f64 / GIB),
            format!("{:.0}", cost.peak_bytes as f64 / cost.surface_voxels as f64),
            format!("{:.2}", *expected_bytes as f64 / cost.peak_bytes as f64),
            format!("{:.2}", cost.error),
        ];
        row.extend(STAGES.iter().map(|stage| format!("{:.1}", cost.stage(stage))));
        row.push(format!("{:.1}", cost.seconds()));
        table.row(row);
    }
    table
}

/// Jobs of one model and strategy, by size.
fn series(measured: &[Measured]) -> Vec<(String, Vec<&Cost>)> {
    let mut all: Vec<(String, Vec<&Cost>)> = Vec::new();
    for Measured { cost, .. } in measured {
        let name = format!("{}, {}", cost.model, cost.way.name());
        match all.iter_mut().find(|(known, _)| *known == name) {
            Some((_, costs)) => costs.push(cost),
            None => all.push((name, vec![cost])),
        }
    }
    all
}

/// The exponent by which a cost grows with the height, from one size to the next.
fn exponents(costs: &[&Cost], of: impl Fn(&Cost) -> f64) -> String {
    let between = costs.windows(2).map(|pair| {
        let [a, b] = [pair[0], pair[1]];
        // What took no time at either has none.
        if of(a).min(of(b)) <= LEAST {
            "–".to_owned()
        } else {
            format!("{:.2}", (of(b) / of(a)).ln() / (b.height_mm / a.height_mm).ln())
        }
    });
    between.collect::<Vec<_>>().join(", ")
}

/// The text.
pub fn markdown(measured: &[Measured], too_large: &[TooLarge]) -> String {
    let mut out = String::from(
        "Each row is a job in a process of its own, checkpoints and all files included. Seconds are by the clock, and hold \
         only as far as the machine had no other work. Peaks are the process's resident memory; \"expected\" is what \
         `PrintJob::memory_need` said of it before the work began. \"by 10 mm\" is in sections of that height \
         (`--section-mm`).\n\n",
    );
    out += &table(measured).markdown();
    if !too_large.is_empty() {
        out += "\nNot run, since more memory than the study was given was expected:\n\n";
        for TooLarge { name, expected } in too_large {
            out += &format!("- {name} mm: {expected}\n");
        }
    }
    out += "\n## Exponents\n\nBy which a cost grows with the height, from each size to the next: surfaces grow by 2, \
            solids by 3. Voxels of both and bytes and seconds of the whole job; then seconds of single stages.\n\n";
    let mut exponent_table = Table::new(&[
        "model and strategy",
        ">surface",
        ">solid",
        ">peak bytes",
        ">all seconds",
        ">voxelise",
        ">nearest surface",
        ">refine",
        ">judge",
        ">slices",
    ]);
    for (name, costs) in series(measured) {
        let stage = |stage: &'static str| exponents(&costs, move |c| c.stage(stage).max(LEAST));
        exponent_table.row([
            name,
            exponents(&costs, |c| c.surface_voxels as f64),
            exponents(&costs, |c| c.solid_voxels as f64),
            exponents(&costs, |c| c.peak_bytes as f64),
            exponents(&costs, Cost::seconds),
            stage("voxelise"),
            stage("nearest surface"),
            stage("refine"),
            stage("judge"),
            stage("slices"),
        ]);
    }
    out += &exponent_table.markdown();
    out
}

/// Peak memory and seconds against the height.
pub fn plot(measured: &[Measured]) -> Plot {
    let panel = |title: &str, of: &dyn Fn(&Cost) -> f64| Panel {
        title: title.to_owned(),
        series: series(measured)
            .into_iter()
            .map(|(name, costs)| Series {
                name,
                points: costs.iter().map(|cost| [cost.height_mm, of(cost)]).collect(),
            })
            .collect(),
    };
    let panels =
        vec![panel("peak memory, GiB", &|c| c.peak_bytes as f64 / GIB), panel("seconds", &Cost::seconds)];
    let points = || panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points);
    Plot {
        x: Axis::around("height in mm", points().map(|p| p[0])),
        y: Axis::around("GiB; seconds", points().map(|p| p[1])),
        panels,
    }
}
