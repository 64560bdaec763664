//! What prints of growing size cost: seconds by stage and memory, each size in a process of its own, with the exponents
//! by which they grow.
//!
//! `cargo bench -p pellucid-benches --bench size`: two small sizes, in minutes; `-- --full` larger ones, for
//! `docs/results/size`. A study that was cut off goes on where it was. Further models by `--also FILE=MM,…`; prints that
//! would take more memory than there is are named and left out.

mod job;
mod report;

use std::path::PathBuf;

use clap::Parser;
use job::{Cost, Measured, Task, TooLarge, Way};
use pellucid::core::Bytes;
use pellucid::core::memory::free_bytes;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::{Record, ResumableSettings, Study};

/// Cost by size
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
    /// Further models and the heights in mm that they are printed at
    #[arg(long, value_name = "FILE=MM,…", value_parser = further)]
    also: Vec<(PathBuf, Vec<f64>)>,
    /// Most memory of a job: those that are expected to take more are not run. What is free without it
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    memory: Option<Bytes>,
    /// One job, whose cost is printed: what the study runs in processes of their own
    #[arg(long, hide = true)]
    task: Option<String>,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    match &args.task {
        Some(task) => {
            let cost = serde_json::from_str::<Task>(task)?.run()?;
            println!("{}", serde_json::to_string(&cost)?);
            Ok(())
        }
        None => study(&args),
    }
}

/// An amount of memory.
fn memory(text: &str) -> Result<Bytes, String> {
    text.parse().map_err(|fault: pellucid::core::Fault| fault.to_string())
}

/// A model and its heights.
fn further(text: &str) -> Result<(PathBuf, Vec<f64>), String> {
    let (file, heights) = text.rsplit_once('=').ok_or("FILE=MM,… is needed")?;
    let heights = heights.split(',').map(|mm| mm.parse().map_err(|_| format!("{mm:?} is no height in mm")));
    Ok((PathBuf::from(file), heights.collect::<Result<_, _>>()?))
}

fn study(args: &Args) -> Result<(), Error> {
    let full = args.settings.study.full;
    let mut record = Record::now("size", rayon::current_num_threads());
    record.add("effort", job::EFFORT);
    let kept = args.settings.kept("size", env!("CARGO_TARGET_TMPDIR"))?;
    let vase = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/models/vase-hollow.glb");
    let (heights, section_mm) = if full { (vec![10.0, 20.0], 10.0) } else { (vec![6.0, 12.0], 6.0) };
    let limit = args.memory.or(free_bytes().map(Bytes)).unwrap_or(Bytes(u64::MAX));
    let (mut measured, mut too_large): (Vec<Measured>, Vec<TooLarge>) = Default::default();
    for (model, heights) in std::iter::once((PathBuf::from(vase), heights)).chain(args.also.clone()) {
        for height_mm in heights {
            for way in Way::all(height_mm, section_mm) {
                let task = Task { model: model.clone(), height_mm, way };
                let expected_bytes = task.expected_bytes()?;
                if Bytes(expected_bytes) > limit {
                    too_large.push(TooLarge { name: task.name(), expected: Bytes(expected_bytes) });
                    continue;
                }
                let cost: Cost = kept.or(&task.name(), || task.run_apart())?;
                measured.push(Measured { cost, expected_bytes });
            }
        }
    }
    // By way, then by height.
    measured.sort_by_key(|m| (m.cost.model.clone(), m.cost.way.name()));
    let study = Study::new("size", env!("CARGO_TARGET_TMPDIR"), &args.settings.study, record)?;
    let table = report::table(&measured);
    println!("{}", table.markdown());
    study.write(
        "Cost by size",
        &report::markdown(&measured, &too_large),
        &table,
        &report::plot(&measured),
    )?;
    Ok(())
}
