//! What every shortcut saves, and what it changes: each with and without, in one run.
//!
//! `cargo bench -p pellucid-benches --bench leave_out`: in minutes; `-- --full` on larger objects, with build times and the
//! command's size, for `docs/results/leave_out`. A study that was cut off goes on where it was.

mod features;
mod network;
mod paths;
mod scene;
mod tables;

use clap::Parser;
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::on_one_thread;
use pellucid_benches::study::{Axis, Panel, Plot, Record, ResumableSettings, Series, Study, Table};
use scene::Scene;
use serde::{Deserialize, Serialize};

/// What every shortcut saves
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
    /// Only parts whose name holds this: tables, paths, network, features
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
}

/// One shortcut.
#[derive(Serialize, Deserialize)]
pub struct Saving {
    /// What is left out.
    pub what: String,
    /// On which object.
    pub object: String,
    /// Of what the two figures are.
    pub unit: String,
    /// Without the shortcut.
    pub without: f64,
    /// With it.
    pub with: f64,
    /// What it changes in the result.
    pub changes: String,
}

impl Saving {
    /// How many times less it takes.
    fn times(&self) -> f64 {
        self.without / self.with
    }

    /// Whether it takes less at all.
    fn pays(&self) -> bool {
        self.times() >= 1.0
    }
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let full = args.settings.study.full;
    let mut record = Record::now("leave_out", 1);
    record.add("times", "processor seconds");
    let scratch = env!("CARGO_TARGET_TMPDIR");
    let study = Study::new("leave_out", scratch, &args.settings.study, record)?;
    let kept = args.settings.kept("leave_out", scratch)?;
    let scene = Scene::new(if full { 12.0 } else { 5.0 }, &control)?;
    type Part<'a> = (&'static str, &'a dyn Fn() -> Result<Vec<Saving>, Error>);
    let parts: [Part<'_>; 4] = [
        ("tables", &|| tables::savings(&scene, &control)),
        ("paths", &|| paths::savings(&scene, &control)),
        ("network", &|| network::savings(&scene, &control)),
        ("features", &|| features::savings(full)),
    ];
    let mut savings = Vec::new();
    for (part, measure) in parts.into_iter().filter(|(part, _)| part.contains(&args.only)) {
        savings.extend(kept.or(part, measure)?);
    }
    // What does not pay comes first.
    savings.sort_by_key(Saving::pays);
    let table = table(&savings);
    println!("{}", table.markdown());
    study.write("What is left out", &markdown(&table), &table, &plot(&savings))?;
    Ok(())
}

fn table(savings: &[Saving]) -> Table {
    let mut table = Table::new(&["left out", "object", "of", ">without", ">with", ">times less", "changes"]);
    for s in savings {
        table.row([
            s.what.clone(),
            s.object.clone(),
            s.unit.clone(),
            figure(s.without),
            figure(s.with),
            format!("{:.1}", s.times()),
            s.changes.clone(),
        ]);
    }
    table
}

/// Three digits.
fn figure(value: f64) -> String {
    let digits = (2 - value.abs().max(1e-9).log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

fn markdown(table: &Table) -> String {
    format!(
        "Each row is one shortcut: the work with it, and the same work done without it, on one thread. \"Changes\" is what \
         the result loses, measured too. What does not pay here comes first.\n\n{}",
        table.markdown()
    )
}

fn plot(savings: &[Saving]) -> Plot {
    let point = |(i, s): (usize, &Saving)| [(i + 1) as f64, s.times()];
    let points: Vec<[f64; 2]> = savings.iter().enumerate().map(point).collect();
    Plot {
        x: Axis::around("row of the table", points.iter().map(|p| p[0])),
        y: Axis::around("times less", points.iter().map(|p| p[1])),
        panels: vec![Panel {
            title: "what is saved".into(),
            series: points
                .iter()
                .zip(savings)
                .map(|(&p, s)| Series { name: s.what.clone(), points: vec![p] })
                .collect(),
        }],
    }
}

/// Greatest difference of two results.
pub fn greatest(a: &[f32], b: &[f32]) -> String {
    let most = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
    if most == 0.0 { "nothing".into() } else { format!("values by at most {most:.1e}") }
}
