//! Tables and plot of the study.

use std::path::Path;

use pellucid::core::files::write_whole_bytes;
use pellucid::refine::{ClassErrors, StateErrors};
use pellucid_benches::appearance::Error;
use pellucid_benches::faces::{Faces, PERIODS_MM, RIM_MM};
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::runs::{FULL_DELTA_E, QUANTILES, Run};
use super::ways::{DESCENT, SURFACE_FIRST, WAYS};

/// Share of the surface from which a class of colours is listed.
const LISTED: f64 = 0.03;
/// The least share of a class's chroma that is no loss.
const CHROMA_KEPT: f64 = 0.9;
/// Minutes at which the ways are compared.
const MINUTES: [f64; 4] = [1.0, 2.0, 5.0, 10.0];

/// All runs, and what they began with.
pub fn table(runs: &[Run]) -> Table {
    let mut table = Table::new(&[
        "object",
        "way",
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
    for of_object in objects(runs) {
        for (i, run) in of_object.iter().enumerate() {
            if i == 0 {
                add(run, "none", run.before(), Default::default());
            }
            let counted = [
                (run.report.refinement.iterations.len() - 1).to_string(),
                format!("{:.0}", run.refine_seconds()),
                format!("{:.0}", run.all_seconds()),
            ];
            add(run, &run.way, run.after(), counted);
        }
    }
    table
}

/// Runs object by object.
fn objects(runs: &[Run]) -> impl Iterator<Item = &[Run]> {
    runs.chunk_by(|a, b| a.object == b.object)
}

/// Which way is ahead after some minutes.
fn ahead(runs: &[Run]) -> Table {
    let titles = MINUTES.map(|m| format!("{m} min"));
    let columns: Vec<&str> = std::iter::once("object").chain(titles.iter().map(String::as_str)).collect();
    let mut table = Table::new(&columns);
    for of_object in objects(runs) {
        let best = |minutes: f64| {
            let reached = of_object.iter().filter_map(|r| Some((r, r.best_within(60.0 * minutes)?)));
            let best = reached.min_by(|a, b| a.1.total_cmp(&b.1));
            best.map_or(String::new(), |(run, error)| match error == run.iterates[0].delta_e[1] {
                true => format!("none, {error:.2}"),
                false => format!("{}, {error:.2}", run.way),
            })
        };
        table.row([of_object[0].object.clone()].into_iter().chain(MINUTES.map(best)));
    }
    table
}

/// How errors are spread over the surface.
fn quantiles(runs: &[Run]) -> Table {
    let titles = QUANTILES.map(|q| format!(">{:.0} %", 100.0 * q));
    let columns: Vec<&str> = ["object", "way"].into_iter().chain(titles.iter().map(String::as_str)).collect();
    let mut table = Table::new(&columns);
    for of_object in objects(runs) {
        let first = of_object.iter().take(1).map(|run| ("none", &run.quantiles[0]));
        for (way, values) in first.chain(of_object.iter().map(|run| (run.way.as_str(), &run.quantiles[1]))) {
            let head = [of_object[0].object.clone(), way.to_owned()];
            table.row(head.into_iter().chain(values.map(|v| format!("{v:.2}"))));
        }
    }
    table
}

/// Where the library's default is behind, object by object.
fn losses(runs: &[Run]) -> String {
    let mut lines = String::new();
    for (first, second) in pairs(runs) {
        let [a, b] = [first.after(), second.after()];
        let figures = [
            ("by voxel", a.voxel.printable.mean, b.voxel.printable.mean),
            ("at 0.1 mm", a.at_0_1_mm.printable.mean, b.at_0_1_mm.printable.mean),
            ("at 0.1 mm in the worst 5 %", a.at_0_1_mm.printable.p95, b.at_0_1_mm.printable.p95),
        ];
        for (what, a, b) in figures.into_iter().filter(|(_, a, b)| b > a) {
            lines += &format!("- {} {what}: {b:.2} by descent, {a:.2} by surface-first\n", first.object);
        }
        if let (Some(a), Some(b)) = (a.sharpness.slope, b.sharpness.slope)
            && b < a
        {
            lines +=
                &format!("- {} in sharpness: {b:.2} by descent, {a:.2} by surface-first\n", first.object);
        }
        for (class, kept) in larger_classes(first, second).map(|[a, b]| (a.class, chroma_kept(a, b))) {
            if kept < CHROMA_KEPT {
                lines += &format!("- {} in {class:?}: {kept:.2} of the chroma kept\n", first.object);
            }
        }
    }
    let early = objects(runs).filter_map(|of_object| {
        let at = |way: &str| of_object.iter().find(|r| r.way == way)?.best_within(60.0 * MINUTES[0]);
        let (own, other) = (at(DESCENT)?, at(SURFACE_FIRST)?);
        (own > other).then(|| format!("{} ({own:.2} and {other:.2})", of_object[0].object))
    });
    let early: Vec<String> = early.collect();
    if !early.is_empty() {
        lines +=
            &format!("- behind surface-first at 0.1 mm after {} min: {}\n", MINUTES[0], early.join(", "));
    }
    if lines.is_empty() { "- nowhere here\n".to_owned() } else { lines }
}

/// Runs of one object by the defaults of both strategies.
fn pairs(runs: &[Run]) -> impl Iterator<Item = (&Run, &Run)> {
    objects(runs).filter_map(|of_object| {
        let by = |way: &str| of_object.iter().find(|run| run.way == way);
        Some((by(SURFACE_FIRST)?, by(DESCENT)?))
    })
}

/// What descent leaves of surface-first's errors.
fn ratios(runs: &[Run]) -> Table {
    let mut table = Table::new(&[
        "object",
        ">voxel",
        ">0.1 mm",
        ">0.1 mm, 95 %",
        ">0.2 mm",
        ">sharpness",
        ">refinement s",
        ">whole job s",
    ]);
    let values = |run: &Run| {
        let e = run.after();
        [
            e.voxel.printable.mean,
            e.at_0_1_mm.printable.mean,
            e.at_0_1_mm.printable.p95,
            e.at_0_2_mm.printable.mean,
            e.sharpness.slope.unwrap_or(f64::NAN),
            run.refine_seconds(),
            run.all_seconds(),
        ]
    };
    let mut sums = [[0.0; 7]; 2];
    let cells =
        |ratios: [f64; 7]| ratios.map(|r| if r.is_finite() { format!("{r:.3}") } else { String::new() });
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

/// Classes of colours that are listed, by two ways.
fn larger_classes<'r>(first: &'r Run, second: &'r Run) -> impl Iterator<Item = [&'r ClassErrors; 2]> {
    first.after().color_classes.iter().filter(|c| c.share >= LISTED).filter_map(|class| {
        let other = second.after().color_classes.iter().find(|c| c.class == class.class)?;
        Some([class, other])
    })
}

/// What `other` keeps of the chroma that can be printed or that `class` shows, whichever is less.
fn chroma_kept(class: &ClassErrors, other: &ClassErrors) -> f64 {
    other.shown.chroma / class.printable.chroma.min(class.shown.chroma)
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
        for [class, other] in larger_classes(first, second) {
            table.row([
                first.object.clone(),
                format!("{:?}", class.class),
                format!("{:.0}", 100.0 * class.share),
                colour(&class.printable),
                colour(&class.shown),
                colour(&other.shown),
                format!("{:.2}", chroma_kept(class, other)),
                format!("{:+.1}", other.shown.lightness - class.shown.lightness),
                format!("{:.2}", class.mean),
                format!("{:.2}", other.mean),
            ]);
        }
    }
    table
}

/// Rims and patterns on the faces of boxes; nothing where there are none.
fn faces(runs: &[Run]) -> String {
    let bands = PERIODS_MM.iter().map(|mm| format!(">to {mm} mm"));
    let columns =
        ["object", "way", "rim L* a* b*", "elsewhere L* a* b*"].map(str::to_owned).into_iter().chain(bands);
    let columns: Vec<String> = columns.chain([">above".to_owned()]).collect();
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new(&columns);
    let mut add = |run: &Run, way: &str, faces: &Faces| {
        let means = [faces.rim, faces.inner].map(|m| m.map(|v| format!("{v:+.2}")).join(" "));
        let head = [run.object.clone(), way.to_owned()];
        table.row(head.into_iter().chain(means).chain(faces.bands.map(|v| format!("{v:.2}"))));
    };
    let mut some = false;
    for of_object in objects(runs) {
        for (i, run) in of_object.iter().enumerate() {
            let Some([before, after]) = &run.faces else { continue };
            if i == 0 {
                add(run, "none", before);
            }
            add(run, &run.way, after);
            some = true;
        }
    }
    if !some {
        return String::new();
    }
    format!(
        "## Rims and patterns of the cube\n\nWhat its faces show less the printable target: the mean within {RIM_MM} mm of an \
         edge and elsewhere, and the root mean square Lab difference elsewhere by the period of its pattern (Fourier \
         transforms of the faces). What the halftone before refinement has below a millimetre is its grain, with the noise of \
         the judge's paths; above that, what scattering does to the colours.\n\n{}\n",
        table.markdown()
    )
}

/// Where the error to the texture sits.
fn shares(runs: &[Run]) -> Table {
    let mut table = Table::new(&["object", "way", ">out of gamut %", ">too thin %", ">cross-talk %"]);
    for run in pairs(runs).flat_map(|(first, second)| [first, second]) {
        let s = run.after().shares;
        let values = [s.out_of_gamut, s.too_thin, s.cross_talk].map(|v| format!("{:.0}", 100.0 * v));
        table.row([run.object.clone(), run.way.clone()].into_iter().chain(values));
    }
    table
}

/// The pictures, one an object.
fn shown(runs: &[Run]) -> String {
    let each = objects(runs).map(|of_object| {
        let object = &of_object[0].object;
        let ways: Vec<&str> = of_object.iter().map(|run| run.way.as_str()).collect();
        format!("![{object}]({object}.png)\n\n{object}: {}\n\n", ways.join("; "))
    });
    each.collect()
}

/// The text.
pub fn markdown(runs: &[Run]) -> String {
    format!(
        "Mean dE2000 to the printable target, voxel by voxel and as smoothed over so much of the surface, of labels \
         predicted with paths of the judge's own. Sharpness is the share of the target's local contrast. One seed; all \
         settings but those that a way is named by are the library's own for every object. Seconds are wall time from the \
         model on. The library's default is descent by paths: 4 a point and channel in the first half of its steps unless \
         noise is most of the loss, 8 or more in the second.\n\n\
         ## Where the default loses\n\n{}\n\
         ## What is reached\n\n{}\n\
         ## Which way is ahead\n\nThe least mean dE2000 at 0.1 mm that was reached so many minutes from the model on, of \
         iterates that were judged (iterates.csv; the judge's own time does not count).\n\n{}\n\
         ## Descent against surface-first\n\nWhat the first leaves of the second's; the last row is of the sums.\n\n{}\n\
         ## How errors are spread\n\nQuantiles over the surface of dE2000 at 0.1 mm to the texture itself (the paper's \
         box plots).\n\n{}\n\
         ## Classes of colours\n\nThose of 3 % of a surface or more; mean L*, chroma and hue at 0.2 mm, mean dE2000 at \
         0.1 mm. Chroma kept is descent's by the lower of the other two; L* gained is descent's above surface-first's.\n\n{}\n\
         {}## Where the error sits\n\nShares of the mean dE2000 at 0.1 mm to the texture itself.\n\n{}\n\
         ## Pictures\n\nThe texture relative to the print's white, the halftone before refinement, then each way as named; \
         below the error to the texture at 0.1 mm, black for 0 to white for {FULL_DELTA_E} dE2000.\n\n{}",
        losses(runs),
        table(runs).markdown(),
        ahead(runs).markdown(),
        ratios(runs).markdown(),
        quantiles(runs).markdown(),
        classes(runs).markdown(),
        faces(runs),
        shares(runs).markdown(),
        shown(runs)
    )
}

/// `iterates.csv`: every iterate that was judged.
///
/// # Errors
/// When the file cannot be written.
pub fn write_iterates(folder: &Path, runs: &[Run]) -> Result<(), Error> {
    let columns = [
        "object",
        "way",
        "iteration",
        "seconds",
        "0.045 mm",
        "0.1 mm",
        "0.2 mm",
        "0.1 mm, 95 %",
        "sharpness",
    ];
    let mut table = Table::new(&columns);
    for run in runs {
        for i in &run.iterates {
            let head = [run.object.clone(), run.way.clone(), i.iteration.to_string()];
            let [fine, viewed, wide] = i.delta_e.map(|e| format!("{e:.3}"));
            let sharpness = i.sharpness.map_or(String::new(), |s| format!("{s:.3}"));
            let values =
                [format!("{:.1}", i.seconds), fine, viewed, wide, format!("{:.3}", i.p95), sharpness];
            table.row(head.into_iter().chain(values));
        }
    }
    write_whole_bytes(folder.join("iterates.csv"), table.csv().as_bytes())?;
    Ok(())
}

/// A panel an object: judged errors against time.
pub fn plot(runs: &[Run]) -> Plot {
    let series = |run: &Run| Series {
        name: run.way.clone(),
        points: run.iterates.iter().map(|i| [i.seconds, i.delta_e[1]]).collect(),
    };
    // In the ways' order, so that each has its colour whatever the first object lacks.
    let legend = WAYS.iter().map(|way| Series { name: way.name.to_owned(), points: Vec::new() });
    let legend: Vec<Series> = legend.filter(|s| runs.iter().any(|run| run.way == s.name)).collect();
    let panels: Vec<Panel> = objects(runs)
        .map(|of_object| Panel {
            title: of_object[0].object.clone(),
            series: legend.iter().cloned().chain(of_object.iter().map(series)).collect(),
        })
        .collect();
    let values = |k: usize| -> Vec<f64> {
        panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points).map(|p| p[k]).collect()
    };
    Plot {
        x: Axis::around("seconds", values(0)),
        y: Axis::around("judged mean dE2000 at 0.1 mm", values(1)),
        panels,
    }
}
