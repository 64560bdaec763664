//! Paths in halftoned prints, ours beside Mitsuba 3's: seconds of one, its standard deviation, and seconds for an error.
//!
//! `cargo bench -p pellucid-benches --bench mitsuba`: one sheet; `-- --full` for `docs/results/mitsuba`. Mitsuba is
//! measured where `--python` has it (`pip install mitsuba`), by `benches/peers/mitsuba_prints.py`.

mod peer;
mod scene;

use std::path::PathBuf;

use clap::Parser;
use pellucid::predict::{Changed, Draw, Network, Pass, Predictor, predict_all};
use pellucid::trace::{Boundary, InstructionSet, TraceOptions, Tracer, Volume};
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::{on_one_thread, seconds};
use pellucid_benches::study::{Axis, Panel, Plot, Record, ResumableSettings, Series, Study, Table};
use scene::Scene;
use serde::{Deserialize, Serialize};

/// Paths in halftoned prints, ours beside Mitsuba 3's
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
    /// Python that has Mitsuba
    #[arg(long, value_name = "FILE", default_value = "python3")]
    python: PathBuf,
}

/// Our paths a point and channel.
const SPP: u32 = 256;
/// The error in linear radiance that times are stated for, and those of the plot.
const WANTED: f64 = 0.02;
const ERRORS: [f64; 3] = [0.1, 0.03, 0.01];

/// What paths of a tracer came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Row {
    object: String,
    points: usize,
    tracer: String,
    /// Processor seconds of a path.
    seconds: f64,
    /// Mean radiance of the points that paths were traced from, all channels, and its standard error.
    radiance: [f64; 2],
    /// Standard deviation of a path's throughput, root mean square over points and channels.
    deviation: f64,
}

impl Row {
    /// Seconds of a prediction of all points and channels with a root mean square error.
    fn prediction(&self, rmse: f64) -> f64 {
        self.seconds * (self.deviation / rmse).powi(2) * self.points as f64 * scene::CHANNELS as f64
    }
}

/// What the network takes for all points.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Predicted {
    object: String,
    seconds: f64,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let scratch = env!("CARGO_TARGET_TMPDIR");
    let mut record = Record::now("mitsuba", 1);
    record.add("paths", format!("{SPP} a point and channel of ours, {} of Mitsuba's", peer::PATHS));
    record.add("boundary", "index-matched; Mitsuba without Russian roulette and sampling of emitters");
    let study = Study::new("mitsuba", scratch, &args.settings.study, record)?;
    let kept = args.settings.kept("mitsuba", scratch)?;
    let control = Control::none();
    let mitsuba = peer::is_there(&args.python);
    if !mitsuba {
        println!("not measured: Mitsuba (pip install mitsuba, or name a Python that has it)");
    }
    let (mut rows, mut networks) = (Vec::new(), Vec::new());
    for subject in scene::all(args.settings.study.full) {
        let scene = Scene::new(&subject, &control)?;
        let name = scene.name.clone();
        rows.extend(kept.or(&name, || own(&scene, &control))?);
        networks.push(kept.or(&format!("{name}, network"), || network(&scene, &control))?);
        if mitsuba {
            rows.extend(kept.or(&format!("{name}, Mitsuba"), || peer::measure(&args.python, &scene))?);
        }
    }
    study.write("Beside Mitsuba", &markdown(&rows, &networks), &table(&rows), &plot(&rows))?;
    Ok(())
}

/// Our tracer's rows, by instruction set.
fn own(scene: &Scene, control: &Control<'_>) -> Result<Vec<Row>, Error> {
    let volume = Volume::new(&scene.labels, scene.object.surface(), control)?;
    let mut rows = Vec::new();
    for set in InstructionSet::available() {
        let base = TraceOptions { boundary: Boundary::Matched, ..TraceOptions::default() };
        let options = TraceOptions { spp: SPP, instruction_set: Some(set), ..base };
        let tracer = Tracer::new(&volume, scene.object.materials(), options)?;
        if tracer.instruction_set() != set {
            continue;
        }
        let mut radiance = vec![0.0; scene.chosen.len() * scene::CHANNELS];
        let mut errors = radiance.clone();
        let start = seconds();
        tracer.radiance_with_error(&scene.chosen, 0, &mut radiance, &mut errors, control)?;
        let spent = seconds() - start;
        let values = radiance.len() as f64;
        let square = errors.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / values;
        rows.push(Row {
            object: scene.name.clone(),
            points: scene.object.surface().len(),
            tracer: format!("paths, {set}"),
            seconds: spent / values / f64::from(SPP),
            radiance: [
                radiance.iter().map(|l| f64::from(*l)).sum::<f64>() / values,
                (square / values).sqrt(),
            ],
            deviation: (square * f64::from(SPP)).sqrt(),
        });
    }
    Ok(rows)
}

/// The network's time, with what else a prediction of new labels takes.
fn network(scene: &Scene, control: &Control<'_>) -> Result<Predicted, Error> {
    let mut bound = Network::shipped()?.bind(scene.printed()?)?;
    let start = seconds();
    bound.update(&scene.labels, Changed::Unknown, control)?;
    predict_all(&*bound, &scene.object, Draw::new(0, Pass::Loop(0)), control)?;
    Ok(Predicted { object: scene.name.clone(), seconds: seconds() - start })
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "object",
        ">surface points",
        "tracer",
        ">us a path",
        ">std deviation of a path",
        ">s a prediction, RMSE 0.02",
        ">times its scalar rate",
        ">times its LLVM rate",
        ">mean radiance",
        ">std error",
        ">off ours, std errors",
    ]);
    for row in rows {
        let same = || rows.iter().filter(|r| r.object == row.object);
        let rate = |of: &str| {
            let peer = same().find(|r| r.tracer.ends_with(of));
            peer.map_or(String::new(), |p| format!("{:.1}", p.prediction(WANTED) / row.prediction(WANTED)))
        };
        // Of the first instruction set: the others trace the same paths.
        let off = same()
            .next()
            .filter(|_| row.tracer.starts_with("Mitsuba"))
            .map(|own| (row.radiance[0] - own.radiance[0]) / row.radiance[1].hypot(own.radiance[1]));
        table.row([
            row.object.clone(),
            row.points.to_string(),
            row.tracer.clone(),
            format!("{:.2}", 1e6 * row.seconds),
            format!("{:.3}", row.deviation),
            format!("{:.0}", row.prediction(WANTED)),
            rate("scalar_rgb"),
            rate("llvm_ad_mono"),
            format!("{:.4}", row.radiance[0]),
            format!("{:.4}", row.radiance[1]),
            off.map_or(String::new(), |z| format!("{z:+.1}")),
        ]);
    }
    table
}

fn markdown(rows: &[Row], networks: &[Predicted]) -> String {
    let mut network = Table::new(&["object", ">network, s a prediction"]);
    for n in networks {
        network.row([n.object.clone(), format!("{:.1}", n.seconds)]);
    }
    format!(
        "Prints before refinement, their surface without internal reflection, so that both trace the same. Times are of \
         one thread; \"s a prediction\" is of all surface points and three channels, by as many paths as make the root mean \
         square error {WANTED}; rates are compared at that error. The \
         means should agree on the sheet, whose faces are flat; elsewhere light that leaves goes on into other parts with \
         Mitsuba, be it a step of voxels, and ends with us, so that Mitsuba's should be lower.\n\n{}\n\
         The network, which errs by some such amount (`error_vs_time`), with the reflection that prints have:\n\n{}",
        table(rows).markdown(),
        network.markdown()
    )
}

/// Error against time, a panel an object: of a mean of paths it falls as the root of their number.
fn plot(rows: &[Row]) -> Plot {
    let mut panels: Vec<Panel> = Vec::new();
    for row in rows {
        let at = panels.iter().position(|p| p.title == row.object).unwrap_or_else(|| {
            panels.push(Panel { title: row.object.clone(), series: Vec::new() });
            panels.len() - 1
        });
        let points = ERRORS.map(|rmse| [row.prediction(rmse), rmse]).to_vec();
        panels[at].series.push(Series { name: row.tracer.clone(), points });
    }
    let times = rows.iter().flat_map(|r| ERRORS.map(|rmse| r.prediction(rmse)));
    Plot {
        x: Axis::around("s a prediction, one thread", times),
        y: Axis::around("RMSE of linear radiance", ERRORS),
        panels,
    }
}
