//! Error against run time of every estimator of the path tracer.
//!
//! `cargo bench -p pellucid-benches --bench tracer_error`: two scenes in about two minutes; `-- --full` for all of
//! `docs/results/tracer_error`.

mod rates;
mod report;
mod scenes;

use std::error::Error;
use std::path::PathBuf;

use clap::Parser;
use pellucid::trace::{AssistOptions, ErrorTarget, TraceOptions, Tracer};
use pellucid::voxel::{Control, LabelGrid, MaterialTable};
use pellucid_benches::solids::{ball, solid};
use pellucid_benches::study::stopwatch::time;
use pellucid_benches::study::{Record, Study, StudySettings};
use scenes::{Scene, scene};

/// Error against run time of the path tracer's estimators, and its speed beside Mitsuba's
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Paths per point and channel of the reference; 16384 in full, else 4096
    #[arg(long)]
    reference_spp: Option<u32>,
    /// Script that measures Mitsuba, run in full when Python has it
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/mitsuba_cube.py"))]
    peer: PathBuf,
}

/// How much is measured.
struct Effort {
    scenes: usize,
    reference_spp: u32,
    /// Powers of two up to which paths are doubled.
    plain: u32,
    assisted: u32,
    /// Standard errors that the adaptive estimator aims at.
    adaptive: &'static [f32],
}

impl Effort {
    fn of(args: &Args) -> Self {
        let reference_spp = |otherwise| args.reference_spp.unwrap_or(otherwise);
        match args.study.full {
            true => Self {
                scenes: usize::MAX,
                reference_spp: reference_spp(16_384),
                plain: 10,
                assisted: 8,
                adaptive: &[0.08, 0.04, 0.02, 0.01],
            },
            false => Self {
                scenes: 2,
                reference_spp: reference_spp(4096),
                plain: 8,
                assisted: 6,
                adaptive: &[0.08, 0.04, 0.02],
            },
        }
    }
}

/// One measurement.
struct Row {
    scene: &'static str,
    estimator: &'static str,
    spp: f64,
    microseconds: f64,
    rmse: f64,
    bias: f64,
}

/// Runs every estimator on a scene.
fn measure(
    scene: &Scene,
    effort: &Effort,
    rows: &mut Vec<Row>,
    control: &Control<'_>,
) -> Result<(), Box<dyn Error>> {
    let materials = MaterialTable::cmykw();
    let n = materials.channels();
    let tracer =
        |spp| Tracer::new(&scene.volume, &materials, TraceOptions { spp, ..TraceOptions::default() });
    let judged: Vec<u32> = scene.judged.iter().map(|&i| scene.patch[i]).collect();
    let count = judged.len() * n;
    let mut reference = vec![0.0; count];
    let mut reference_error = vec![0.0; count];
    tracer(effort.reference_spp)?.radiance_with_error(
        &judged,
        1000,
        &mut reference,
        &mut reference_error,
        control,
    )?;
    let noise = reference_error.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count as f64;
    let errors = |l: &[f32]| {
        let d: Vec<f64> = l.iter().zip(&reference).map(|(a, b)| f64::from(a - b)).collect();
        let square = d.iter().map(|d| d * d).sum::<f64>() / count as f64;
        // The reference's own variance is known and does not belong to the estimator.
        ((square - noise).max(0.0).sqrt(), d.iter().sum::<f64>() / count as f64)
    };
    for exponent in 0..=effort.plain {
        let spp = 1 << exponent;
        let tracer = tracer(spp)?;
        let mut l = vec![0.0; count];
        let (_, spent) = time(|| tracer.radiance(&judged, 0, &mut l, control))?;
        let microseconds = spent * 1e6 / count as f64;
        let (rmse, bias) = errors(&l);
        rows.push(Row {
            scene: scene.name,
            estimator: "plain",
            spp: f64::from(spp),
            microseconds,
            rmse,
            bias,
        });
        if exponent <= effort.assisted {
            let mut all = vec![0.0; scene.patch.len() * n];
            let options = AssistOptions::default();
            let (_, spent) = time(|| tracer.radiance_assisted(&scene.patch, 0, &options, &mut all, control))?;
            let microseconds = spent * 1e6 / all.len() as f64;
            let some: Vec<f32> =
                scene.judged.iter().flat_map(|&i| all[i * n..(i + 1) * n].iter().copied()).collect();
            let (rmse, bias) = errors(&some);
            rows.push(Row {
                scene: scene.name,
                estimator: "assisted",
                spp: f64::from(spp),
                microseconds,
                rmse,
                bias,
            });
        }
    }
    for &std_error in effort.adaptive {
        let (mut l, mut e) = (vec![0.0; count], vec![0.0; count]);
        let target = ErrorTarget { std_error, max_spp: 1 << 16 };
        let tracer = tracer(1)?;
        let (paths, spent) = time(|| tracer.radiance_to(&judged, 0, target, &mut l, &mut e, control))?;
        let microseconds = spent * 1e6 / count as f64;
        let (rmse, bias) = errors(&l);
        let spp = paths as f64 / count as f64;
        rows.push(Row { scene: scene.name, estimator: "adaptive", spp, microseconds, rmse, bias });
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| study(&args).map_err(|e| e.to_string()))?;
    Ok(())
}

fn study(args: &Args) -> Result<(), Box<dyn Error>> {
    let control = Control::none();
    let effort = Effort::of(args);
    let mut record = Record::now("tracer_error", 1);
    record.add("reference", format!("{} paths a point and channel", effort.reference_spp));
    let study = Study::new("tracer_error", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;

    let mut rates = rates::cube(&control)?;
    if args.study.full {
        rates.extend(rates::mitsuba(&args.peer).unwrap_or_default());
    }
    for (name, rate) in &rates {
        println!("{name}: {rate:.0} paths/s");
    }
    type Maker = fn() -> LabelGrid;
    let makers: [(&str, &str, Maker); 5] = [
        ("p10", "slab 1 mm thick, 12 x 12 mm, halftone throughout", || {
            solid([6.0, 6.0, 0.5], 1.0, |p| (6.0 - p[0].abs()).min(6.0 - p[1].abs()).min(0.5 - p[2].abs()))
        }),
        ("s10", "ball of 10 mm, 1 mm halftone skin over white", || ball(10.0, 1.0)),
        ("s20", "ball of 20 mm, 1 mm halftone skin over white", || ball(20.0, 1.0)),
        ("s40", "ball of 40 mm, 1 mm halftone skin over white", || ball(40.0, 1.0)),
        ("w20", "ball of 20 mm, all white", || ball(20.0, 0.0)),
    ];
    let mut rows = Vec::new();
    let mut names = Vec::new();
    for (name, what, make) in makers.into_iter().take(effort.scenes) {
        let scene = scene(name, what, &make(), &control)?;
        println!("{name}: {} points in the patch, {} judged", scene.patch.len(), scene.judged.len());
        measure(&scene, &effort, &mut rows, &control)?;
        names.push((scene.name, scene.what));
    }
    let text = report::markdown(&names, &rows, &rates);
    study.write(
        "Path tracer: error against run time",
        &text,
        &report::table(&rows),
        &report::plot(&names, &rows),
    )?;
    Ok(())
}
