//! Error against run time of the network by what neighbouring points share, beside the path tracer.
//!
//! `cargo bench -p pellucid-benches --bench sharing`: few volumes and a small ball, in minutes; `-- --full` for held-out
//! volumes, a ball of 20 mm, and the refined labels of three models.

mod objects;
mod report;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Parser;
use pellucid::predict::{Changed, Draw, Network, Pass, Predictor, Sharing};
use pellucid::rpnn::{Precision, TrainedNetwork};
use pellucid::trace::{AssistOptions, Boundary, TraceOptions, Tracer, Volume};
use pellucid::voxel::Control;
use pellucid_benches::judged::Judged;
use pellucid_benches::study::stopwatch::{on_one_thread, time};
use pellucid_benches::study::{Record, Study, StudySettings};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Error against run time of what the network shares
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Weights made by `pellucid train`; those that the library carries without it
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Only objects whose name holds this, such as "refined"
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// f32 products instead of bf16
    #[arg(long)]
    exact: bool,
}

/// Neighbouring points on which times are taken.
const TIMED_POINTS: usize = 40_000;
const DRAW: Draw = Draw::new(0, Pass::Loop(0));

/// A predictor on an object.
pub struct Row {
    /// The object's name.
    pub object: String,
    /// The predictor's.
    pub predictor: String,
    /// Processor time a point and channel of neighbouring points, everything included but what is done once an object.
    pub microseconds: f64,
    /// Root mean square error.
    pub rmse: f64,
    /// Mean error.
    pub bias: f64,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let trained = Arc::new(match &args.weights {
        Some(path) => pellucid::rpnn::file::load(path)?,
        None => pellucid::rpnn::shipped()?,
    });
    let precision = if args.exact { Precision::F32 } else { Precision::Bf16 };
    let mut record = Record::now("sharing", 1);
    record.add("weights", trained.weights.digest());
    let study = Study::new("sharing", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let mut rows = Vec::new();
    let wanted = |name: &str| name.contains(&args.only);
    let held_out = match wanted(objects::HELD_OUT) {
        true => objects::held_out(args.study.full, &study.folder().join("sets"), &control)?,
        false => Vec::new(),
    };
    let print = |row: &Row| {
        println!(
            "{}, {}: rmse {:.4}, bias {:+.4}, {:.2} us",
            row.object, row.predictor, row.rmse, row.bias, row.microseconds
        );
    };
    for sharing in ways().into_iter().filter(|_| !held_out.is_empty()) {
        let row = on_held_out(&held_out, &trained, precision, sharing, &control)?;
        print(&row);
        rows.push(row);
    }
    for object in objects::scenes(args.study.full, &wanted, &control)? {
        let from = rows.len();
        for sharing in ways() {
            rows.push(on_object(&object, &trained, precision, sharing, &control)?);
            rows.last().into_iter().for_each(print);
        }
        traced(&object, &mut rows, &control)?;
        rows[from..].iter().rev().take(1).for_each(print);
    }
    study.write(
        "What neighbouring points share",
        &report::markdown(&rows),
        &report::table(&rows),
        &report::plot(&rows),
    )?;
    Ok(())
}

/// Ways of sharing, from none to most.
fn ways() -> Vec<Option<Sharing>> {
    let way = |spacing_mm: f64, fine_levels: usize, coarse_mm: f64| {
        Some(Sharing { spacing_mm, fine_levels, coarse_mm })
    };
    vec![
        None,
        way(0.0, 3, 0.5),
        way(0.12, 9, 0.0),
        way(0.12, 3, 0.5),
        way(0.18, 9, 0.0),
        way(0.18, 4, 0.6),
        way(0.18, 3, 0.6),
        way(0.18, 3, 1.0),
        way(0.18, 2, 0.6),
        way(0.25, 9, 0.0),
        way(0.25, 4, 0.8),
        way(0.25, 3, 0.8),
        way(0.25, 2, 0.8),
        way(0.35, 9, 0.0),
        way(0.35, 3, 1.0),
        way(0.5, 9, 0.0),
        way(0.5, 3, 1.5),
    ]
}

/// A way of sharing in a table.
pub fn name(sharing: Option<Sharing>) -> String {
    let Some(s) = sharing else { return "network, nothing shared".into() };
    let spacing = match s.spacing_mm > 0.0 {
        true => format!("every {} mm", s.spacing_mm),
        false => "every point".into(),
    };
    match s.fine_levels {
        9 => format!("network, {spacing}"),
        fine => format!("network, {spacing}, {} levels every {} mm", 9 - fine, s.coarse_mm),
    }
}

fn network(
    trained: &Arc<TrainedNetwork>,
    precision: Precision,
    sharing: Option<Sharing>,
) -> Result<Network, Error> {
    Ok(Network::new(Arc::clone(trained), precision).with_sharing_where_possible(sharing)?)
}

fn on_held_out(
    volumes: &[Judged],
    trained: &Arc<TrainedNetwork>,
    precision: Precision,
    sharing: Option<Sharing>,
    control: &Control<'_>,
) -> Result<Row, Error> {
    let network = network(trained, precision, sharing)?;
    let mut score = pellucid::core::NoisyScore::default();
    for volume in volumes {
        let mut bound = network.bind(volume.object.clone())?;
        bound.update(&volume.labels, Changed::Unknown, control)?;
        let mut out = vec![0.0; volume.radiance.len()];
        bound.predict(&volume.points, DRAW, &mut out, control)?;
        volume.compare(&out, &mut score);
    }
    Ok(Row {
        object: objects::HELD_OUT.into(),
        predictor: name(sharing),
        microseconds: f64::NAN,
        rmse: score.rmse(),
        bias: score.bias(),
    })
}

fn on_object(
    object: &Judged,
    trained: &Arc<TrainedNetwork>,
    precision: Precision,
    sharing: Option<Sharing>,
    control: &Control<'_>,
) -> Result<Row, Error> {
    let mut bound = network(trained, precision, sharing)?.bind(object.object.clone())?;
    bound.update(&object.labels, Changed::Unknown, control)?;
    let mut out = vec![0.0; object.radiance.len()];
    bound.predict(&object.points, DRAW, &mut out, control)?;
    let mut score = pellucid::core::NoisyScore::default();
    object.compare(&out, &mut score);
    let near = object.near(TIMED_POINTS);
    let mut out = vec![0.0; near.len() * object.object.channels()];
    let (_, spent) = time(|| -> Result<_, Error> {
        // Nothing changed, but outputs that were kept are forgotten.
        bound.update(&object.labels, Changed::Tiles(&[]), control)?;
        Ok(bound.predict(&near, DRAW, &mut out, control)?)
    })?;
    Ok(Row {
        object: object.name.clone(),
        predictor: name(sharing),
        microseconds: 1e6 * spent / out.len() as f64,
        rmse: score.rmse(),
        bias: score.bias(),
    })
}

/// Plain and assisted paths on the same object.
fn traced(object: &Judged, rows: &mut Vec<Row>, control: &Control<'_>) -> Result<(), Error> {
    let volume = Volume::new(&object.labels, object.object.surface(), control)?;
    let boundary = Boundary::with_index(object.object.refractive_index())?;
    let near = object.near(TIMED_POINTS);
    let channels = object.object.channels();
    for spp in [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024] {
        let options = TraceOptions { spp, seed: 5, boundary, ..TraceOptions::default() };
        let tracer = Tracer::new(&volume, object.object.materials(), options)?;
        let mut out = vec![0.0; object.radiance.len()];
        tracer.radiance(&object.points, 7, &mut out, control)?;
        let mut score = pellucid::core::NoisyScore::default();
        object.compare(&out, &mut score);
        let some = &near[..near.len() / spp as usize];
        let mut out = vec![0.0; some.len() * channels];
        let (_, spent) = time(|| tracer.radiance(some, 7, &mut out, control))?;
        rows.push(Row {
            object: object.name.clone(),
            predictor: format!("paths, {spp}"),
            microseconds: 1e6 * spent / out.len() as f64,
            rmse: score.rmse(),
            bias: score.bias(),
        });
        if spp > 64 {
            continue;
        }
        let mut all = vec![0.0; near.len() * channels];
        let (_, spent) =
            time(|| tracer.radiance_assisted(&near, 7, &AssistOptions::default(), &mut all, control))?;
        let mut score = pellucid::core::NoisyScore::default();
        object.compare_within(&near, &all, &mut score);
        rows.push(Row {
            object: object.name.clone(),
            predictor: format!("assisted, {spp}"),
            microseconds: 1e6 * spent / all.len() as f64,
            rmse: score.rmse(),
            bias: score.bias(),
        });
    }
    Ok(())
}

/// The folder of the project's models.
fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models")
}
