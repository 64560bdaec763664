//! Stiff and extreme cases: what each part makes of them, measured against a closed form, double precision, or a bound.
//!
//! `cargo bench -p pellucid-benches --bench stability`: in some minutes; `-- --full` with four times the paths and whole
//! refinements, for `docs/results/stability`.

mod case;
mod derivative;
mod network;
mod print;
mod refinement;
mod scene;
mod tables;
mod tracer;

use std::fmt::Write;

use case::Case;
use clap::Parser;
use pellucid::voxel::Control;
use pellucid_benches::study::{Axis, Panel, Plot, Record, Series, Study, StudySettings, Table};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Stiff and extreme cases
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Only parts whose name holds this
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let control = Control::none();
    let paths = if args.study.full { 80_000 } else { 20_000 };
    let mut record = Record::now("stability", rayon::current_num_threads());
    record.add("paths", format!("{paths} a value"));
    let study = Study::new("stability", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let mut cases = Vec::new();
    let mut drift = Vec::new();
    let wanted = |part: &str| part.contains(&args.only);
    let mut add = |found: Vec<Case>| {
        found.iter().for_each(|case| println!("{}", case.line()));
        cases.extend(found);
    };
    if wanted(tracer::PART) {
        add(tracer::cases(paths, &control)?);
        let (found, points) = tracer::drift(paths, &control)?;
        add(found);
        drift = points;
    }
    if wanted(derivative::PART) {
        add(derivative::cases(paths, &control)?);
    }
    if wanted(tables::PART) {
        add(tables::cases(&control)?);
    }
    if wanted(network::PART) {
        add(network::cases(&control)?);
    }
    if wanted(print::PART) {
        add(print::cases(&control)?);
    }
    if wanted(refinement::PART) {
        add(refinement::cases(args.study.full)?);
    }
    let plot = plot(&drift);
    study.write("Stiff and extreme cases", &markdown(&cases), &table(&cases), &plot)?;
    Ok(())
}

fn table(cases: &[Case]) -> Table {
    let mut table = Table::new(&["part", "case", "measured", ">found", ">bound", "verdict"]);
    for case in cases {
        let bound = case.bound.map_or("none".to_owned(), case::number);
        table.row([
            case.part.to_owned(),
            case.name.clone(),
            case.measured.to_owned(),
            case::number(case.found),
            bound,
            case.verdict().to_owned(),
        ]);
    }
    table
}

fn markdown(cases: &[Case]) -> String {
    let failed = cases.iter().filter(|c| !c.holds()).count();
    let mut out = String::from(
        "z is a difference over its standard error. A case holds where what was found is finite and at most the bound; \
         \"stated\" has no bound. The plot: the tracer's kernel less double precision, over the mean number of \
         scatterings of a path in white of less and less absorption, beside the standard error.\n\n",
    );
    let _ = writeln!(out, "{} of {} cases hold.\n", cases.len() - failed, cases.len());
    out + &table(cases).markdown()
}

/// The tracer's differences by path length.
fn plot(drift: &[tracer::Drift]) -> Plot {
    let series = |name: &str, value: &dyn Fn(&tracer::Drift) -> f64| Series {
        name: name.to_owned(),
        points: drift.iter().map(|d| [d.scatterings, value(d)]).collect(),
    };
    let series =
        vec![series("difference", &|d| d.difference.abs()), series("its standard error", &|d| d.std_error)];
    let values = |k: usize| -> Vec<f64> { series.iter().flat_map(|s| &s.points).map(|p| p[k]).collect() };
    Plot {
        x: Axis::around("1 / (1 - albedo)", values(0)),
        y: Axis::around("radiance", values(1)),
        panels: vec![Panel { title: "kernel less double precision".to_owned(), series }],
    }
}
