//! Tables and plot of the study.

use pellucid::refine::{ClassErrors, RefineReport, StateErrors};
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::{Run, STRATEGIES};

/// Share of the surface from which a class of colours is listed.
const LISTED: f64 = 0.03;

impl Run {
    fn after(&self) -> &StateErrors {
        &self.report.evaluation.refined
    }

    fn stage_seconds(&self, wanted: impl Fn(&str) -> bool) -> f64 {
        self.report.stages.iter().filter(|s| wanted(&s.stage)).map(|s| s.seconds).sum()
    }

    fn refine_seconds(&self) -> f64 {
        self.stage_seconds(|stage| stage == "refine")
    }
}

/// A run in one line.
pub fn line(run: &Run) -> String {
    let e = run.after();
    format!(
        "{}, {}: voxel {:.2}, 0.1 mm {:.2}, {:.0} s",
        run.object,
        run.strategy.name(),
        e.voxel.printable.mean,
        e.at_0_1_mm.printable.mean,
        run.refine_seconds()
    )
}

/// All runs, and what they began with.
pub fn table(runs: &[Run]) -> Table {
    let mut table = Table::new(&[
        "object",
        "strategy",
        ">surface voxels",
        ">voxel",
        ">0.045 mm",
        ">0.1 mm",
        ">0.1 mm, 95 %",
        ">0.2 mm",
        ">sharpness",
        ">iterations",
        ">refinement s",
        ">whole job s",
    ]);
    let mut add = |run: &Run, name: &str, e: &StateErrors, counted: [String; 3]| {
        let errors = [
            e.voxel.printable.mean,
            e.at_0_045_mm.printable.mean,
            e.at_0_1_mm.printable.mean,
            e.at_0_1_mm.printable.p95,
            e.at_0_2_mm.printable.mean,
        ];
        let sharpness = e.sharpness.slope.map_or(String::new(), |s| format!("{s:.2}"));
        let head = [run.object.clone(), name.to_owned(), run.report.surface_voxels.to_string()];
        let errors = errors.map(|v| format!("{v:.2}"));
        table.row(head.into_iter().chain(errors).chain([sharpness]).chain(counted));
    };
    for run in runs {
        if run.strategy == STRATEGIES[0] {
            add(run, "none", &run.report.evaluation.unrefined, Default::default());
        }
        let counted = [
            (run.report.refinement.iterations.len() - 1).to_string(),
            format!("{:.0}", run.refine_seconds()),
            format!("{:.0}", run.stage_seconds(|_| true)),
        ];
        add(run, run.strategy.name(), run.after(), counted);
    }
    table
}

/// Runs of one object by both strategies.
fn pairs(runs: &[Run]) -> impl Iterator<Item = (&Run, &Run)> {
    runs.iter().filter(|r| r.strategy == STRATEGIES[0]).filter_map(|first| {
        let second = runs.iter().find(|r| r.object == first.object && r.strategy == STRATEGIES[1])?;
        Some((first, second))
    })
}

/// What descent leaves of surface-first's errors.
fn ratios(runs: &[Run]) -> Table {
    let mut table =
        Table::new(&["object", ">voxel", ">0.1 mm", ">0.1 mm, 95 %", ">0.2 mm", ">sharpness", ">time"]);
    let values = |run: &Run| {
        let e = run.after();
        [
            e.voxel.printable.mean,
            e.at_0_1_mm.printable.mean,
            e.at_0_1_mm.printable.p95,
            e.at_0_2_mm.printable.mean,
            e.sharpness.slope.unwrap_or(f64::NAN),
            run.refine_seconds(),
        ]
    };
    let mut sums = [[0.0; 6]; 2];
    let cells =
        |ratios: [f64; 6]| ratios.map(|r| if r.is_finite() { format!("{r:.3}") } else { String::new() });
    for (first, second) in pairs(runs) {
        let (a, b) = (values(first), values(second));
        for (sums, values) in sums.iter_mut().zip([a, b]) {
            sums.iter_mut().zip(values).filter(|(_, v)| v.is_finite()).for_each(|(sum, v)| *sum += v);
        }
        let ratios = std::array::from_fn(|i| b[i] / a[i]);
        table.row([first.object.clone()].into_iter().chain(cells(ratios)));
    }
    let all = std::array::from_fn(|i| sums[1][i] / sums[0][i]);
    table.row(["all, sums".to_owned()].into_iter().chain(cells(all)));
    table
}

/// Mean colours of the larger classes.
fn classes(runs: &[Run]) -> Table {
    let mut table = Table::new(&[
        "object",
        "class",
        ">surface %",
        ">printable L* C h",
        ">surface-first L* C h",
        ">descent L* C h",
        ">chroma kept",
        ">L* gained",
        ">dE surface-first",
        ">dE descent",
    ]);
    let colour =
        |c: &pellucid::refine::MeanColor| format!("{:.0} {:.0} {:.0}°", c.lightness, c.chroma, c.hue_deg);
    for (first, second) in pairs(runs) {
        for class in first.after().color_classes.iter().filter(|c| c.share >= LISTED) {
            let same = |c: &&ClassErrors| c.class == class.class;
            let Some(other) = second.after().color_classes.iter().find(same) else { continue };
            table.row([
                first.object.clone(),
                format!("{:?}", class.class),
                format!("{:.0}", 100.0 * class.share),
                colour(&class.printable),
                colour(&class.shown),
                colour(&other.shown),
                format!("{:.2}", other.shown.chroma / class.printable.chroma.min(class.shown.chroma)),
                format!("{:+.1}", other.shown.lightness - class.shown.lightness),
                format!("{:.2}", class.mean),
                format!("{:.2}", other.mean),
            ]);
        }
    }
    table
}

/// Where the error to the texture sits.
fn shares(runs: &[Run]) -> Table {
    let mut table = Table::new(&["object", "strategy", ">out of gamut %", ">too thin %", ">cross-talk %"]);
    for run in runs {
        let s = run.after().shares;
        let values = [s.out_of_gamut, s.too_thin, s.cross_talk].map(|v| format!("{:.0}", 100.0 * v));
        table.row([run.object.clone(), run.strategy.name().to_owned()].into_iter().chain(values));
    }
    table
}

/// The text.
pub fn markdown(runs: &[Run]) -> String {
    format!(
        "Mean dE2000 to the printable target, voxel by voxel and as smoothed over so much of the surface, of labels \
         predicted with paths of the judge's own. Sharpness is the share of the target's local contrast. One seed; all \
         settings are the library's own for every object.\n\n{}\n\
         ## Descent against surface-first\n\nWhat the first leaves of the second's; the last row is of the sums.\n\n{}\n\
         ## Classes of colours\n\nThose of 3 % of a surface or more; mean L*, chroma and hue at 0.2 mm, mean dE2000 at \
         0.1 mm. Chroma kept is descent's by the lower of the other two; L* gained is descent's above surface-first's.\n\n{}\n\
         ## Where the error sits\n\nShares of the mean dE2000 at 0.1 mm to the texture itself.\n\n{}",
        table(runs).markdown(),
        ratios(runs).markdown(),
        classes(runs).markdown(),
        shares(runs).markdown()
    )
}

/// Least error so far, as the loop sees it, against its time.
fn curve(report: &RefineReport) -> Vec<[f64; 2]> {
    let (mut seconds, mut least) = (0.0, f64::INFINITY);
    report
        .iterations
        .iter()
        .map(|i| {
            seconds += i.halftone_seconds + i.predict_seconds;
            least = i.smoothed.mean.min(least);
            let point = [seconds, least];
            seconds += i.update_seconds;
            point
        })
        .collect()
}

/// A panel an object.
pub fn plot(runs: &[Run]) -> Plot {
    let series =
        |run: &Run| Series { name: run.strategy.name().to_owned(), points: curve(&run.report.refinement) };
    let panels: Vec<Panel> = pairs(runs)
        .map(|(first, second)| Panel {
            title: first.object.clone(),
            series: vec![series(first), series(second)],
        })
        .collect();
    let values = |k: usize| -> Vec<f64> {
        panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points).map(|p| p[k]).collect()
    };
    Plot {
        x: Axis::around("seconds", values(0)),
        y: Axis::around("mean dE2000 at 0.1 mm, as the loop sees it", values(1)),
        panels,
    }
}
