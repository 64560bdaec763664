//! The study's text.

use std::fmt::Write;
use std::path::Path;

use super::finished::Finished;
use super::held_out::SETS;
use super::pictures::{FULL_DELTA_E, FULL_DIFFERENCE};
use super::plan::{Plan, Shapes};
use super::scores::Row;
use super::speed::Speed;
use super::tables;

/// A picture and what it shows.
pub struct Shown {
    pub file: String,
    pub title: String,
}

/// Everything that was measured.
pub struct Measured<'a> {
    pub plan: &'a Plan,
    pub networks: &'a [Finished],
    /// Networks and what they were not judged on.
    pub not_judged: &'a [String],
    pub rows: &'a [Row],
    pub speeds: &'a [Speed],
    /// Microseconds that the stencil of a sample takes.
    pub stencil_us: f64,
    /// Models judged.
    pub models: &'a [&'a str],
    /// Paths of the pictures' references.
    pub picture_spp: u32,
    pub pictures: &'a [Shown],
}

/// The report; `findings` are the words that somebody wrote on these numbers.
pub fn markdown(measured: &Measured<'_>, findings: Option<&str>) -> String {
    let Measured { plan, networks, rows, .. } = measured;
    let mut out = String::new();
    if let Some(findings) = findings {
        let _ = writeln!(out, "## What holds here\n\n{}\n", findings.trim());
    }
    let _ = writeln!(
        out,
        "## How it was measured\n\nAll networks have the paper's form: levels read from fine to coarse, coefficients \
         scaled by 2^(k-1)/64, one output; no mirrored samples. Those of one group see the same batches of 256 samples, \
         {} steps each: Adam, at most {:.0e}, {} steps of warm-up and a cosine to zero, gradients clipped at 0.5; labels \
         of {} paths, {} points of each volume, every sample new. Predictions are those of the weights' moving average. \
         \"{}\" is the training split of `datasets/recipes/paper.json`; \"{}\" has its cubes, rotated cubes, balls and \
         cuboids of 1 to 2.5 mm alone, the paper's training shapes (section 4.1). Seeds change volumes and initial \
         weights. Both have the default inks in their own density.\n",
        plan.steps,
        plan.settings(plan.groups[0], pellucid::rpnn::Variant::Baseline).peak_rate,
        plan.settings(plan.groups[0], pellucid::rpnn::Variant::Baseline).warm_up,
        plan.spp,
        plan.points,
        Shapes::All.name(),
        Shapes::Paper.name(),
    );
    out += "A sample is one surface point in one channel. RMSE and bias are in linear radiance, 0 to 1; the references' \
            own variance is taken out of the RMSE, not out of the mean dE2000, which is relative to the print's white. \
            Several numbers in a cell are seeds 1 and 2.\n\n## The four architectures\n\nProcessor time on one thread, \
            measured for the report; minutes are those by the clock of a machine that had other work as well, samples \
            and validation not included.\n\n";
    out += &tables::architectures(measured.speeds, measured.stencil_us, networks).markdown();
    let _ = writeln!(
        out,
        "\n## Is the budget enough?\n\nA learning rate that falls to zero makes the last quarter of a run fall, so \
         the error on the way at 75 % says little. Therefore each network was copied at half its steps and came to rest \
         at step {} (the cosine that ends there). The last quarter is told by both at rest: beyond 3 % more steps would \
         still help.\n",
        plan.three_quarters()
    );
    out += &tables::flatness(plan, networks).markdown();
    if !measured.not_judged.is_empty() {
        let _ = writeln!(
            out,
            "\nNot judged, since the machine that they were trained on, and their weights with it, was gone: {}.",
            measured.not_judged.join("; ")
        );
    }
    for shapes in [Shapes::All, Shapes::Paper] {
        if rows.iter().any(|r| r.shapes == shapes.name()) {
            sets(measured, shapes, &mut out);
        }
    }
    pictures(measured, &mut out);
    out
}

/// The tables of the networks trained on some shapes.
fn sets(measured: &Measured<'_>, shapes: Shapes, out: &mut String) {
    let Measured { rows, models, .. } = measured;
    let noise = |set: &str| rows.iter().find(|r| r.set == set).map_or(0.0, |r| r.noise);
    let samples = |set: &str| rows.iter().find(|r| r.set == set).map_or(0, |r| r.samples);
    let _ = writeln!(out, "\n## Trained on {}: held-out volumes\n", shapes.name());
    let sizes: Vec<String> =
        SETS.iter().map(|s| format!("{s}: {} samples, labels to {:.4}", samples(s), noise(s))).collect();
    let _ = writeln!(out, "{}.\n", sizes.join("; "));
    tables_of(rows, shapes, &SETS, out);
    out.push_str("\nRMSE on test by shape:\n\n");
    *out += &tables::by_family(rows, shapes, "test").markdown();
    let _ = writeln!(
        out,
        "\n## Trained on {}: the paper's objects' counterparts\n\nUnrefined halftones of `datasets/models`, {} samples \
         each, evenly over the surface, references to {:.4}.\n",
        shapes.name(),
        models.first().map_or(0, |m| samples(m)),
        models.iter().map(|m| noise(m)).fold(0.0, f64::max)
    );
    tables_of(rows, shapes, models, out);
}

fn tables_of(rows: &[Row], shapes: Shapes, sets: &[&str], out: &mut String) {
    let mut add = |title: &str, table: pellucid_benches::study::Table| {
        let _ = write!(out, "{title}:\n\n{}", table.markdown());
    };
    add("RMSE", tables::by_set(rows, shapes, sets, |r| format!("{:.4}", r.rmse)));
    add("\nRMSE as part of the baseline's, mean over seeds", tables::against_baseline(rows, shapes, sets));
    add("\nBias", tables::by_set(rows, shapes, sets, |r| format!("{:+.4}", r.bias)));
    add("\nMean dE2000", tables::by_set(rows, shapes, sets, |r| format!("{:.2}", r.delta_e)));
}

fn pictures(measured: &Measured<'_>, out: &mut String) {
    let _ = writeln!(out, "\n## RMSE against parameters\n\n![RMSE against parameters](sizes.svg)");
    if measured.pictures.is_empty() {
        return;
    }
    let _ = writeln!(
        out,
        "\n## Pictures\n\nSingle predictions of the networks of seed 1. From the left: reference ({} paths), baseline, L, \
         O, L+O. From the top: appearance; CIEDE2000 of the pixels, 0 (black) to {FULL_DELTA_E} (bright); mean difference \
         over channels, -{FULL_DIFFERENCE} (blue, too dark) to +{FULL_DIFFERENCE} (red, too light).",
        measured.picture_spp
    );
    for Shown { file, title } in measured.pictures {
        let _ = write!(out, "\n{title}:\n\n![{title}]({file})\n");
    }
}

/// What somebody wrote on the numbers of a folder: its `findings.md`.
pub fn findings(folder: &Path) -> Option<String> {
    std::fs::read_to_string(folder.join("findings.md")).ok()
}
