//! Error against run time of every predictor, on balls, sheets, white, and refined prints.
//!
//! `cargo bench -p pellucid-benches --bench error_vs_time`: a small ball and a sheet, in minutes; `-- --full` for all of
//! `docs/results/error_vs_time`. A study that was cut off goes on where it was.

mod objects;
mod predictors;
mod report;
mod table_one;

use clap::Parser;
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::on_one_thread;
use pellucid_benches::study::{Record, ResumableSettings, Study};
use predictors::Row;
use table_one::Line;

/// Error against run time of every predictor
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
    /// Only objects whose name holds this, such as "sheet"
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let full = args.settings.study.full;
    let kept = args.settings.kept("error_vs_time", env!("CARGO_TARGET_TMPDIR"))?;
    let mut record = Record::now("error_vs_time", 1);
    record.add("weights", pellucid::rpnn::shipped()?.weights.digest());
    record.add("matrix products", "factors rounded to bfloat16, sums in f32");
    let study = Study::new("error_vs_time", env!("CARGO_TARGET_TMPDIR"), &args.settings.study, record)?;
    let mut rows: Vec<Row> = Vec::new();
    for subject in objects::all(full).into_iter().filter(|s| s.name.contains(&args.only)) {
        rows.extend(kept.or(&subject.name, || {
            let object = subject.judged(&control)?;
            predictors::measure(&subject, &object, &control)
        })?);
    }
    let mut lines: Vec<Line> = Vec::new();
    for (model, height_mm) in table_one::models(full).into_iter().filter(|(m, _)| m.contains(&args.only)) {
        let name = format!("table one, {model}");
        lines.push(kept.or(&name, || table_one::measure(model, height_mm, &control))?);
    }
    study.write(
        "Error against run time",
        &report::markdown(&rows, &lines),
        &report::table(&rows),
        &report::plot(&rows),
    )?;
    Ok(())
}
