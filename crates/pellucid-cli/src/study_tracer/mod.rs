//! `pellucid study tracer`: error against run time of every estimator of the path tracer.

mod output;
mod rates;
mod scenes;

use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::trace::{AssistOptions, ErrorTarget, TraceOptions, Tracer};
use pellucid::voxel::{Control, LabelGrid, MaterialTable};

use crate::Failure;
use crate::files::write_files;
use crate::stopwatch::time;
use scenes::{Scene, ball, scene, solid};

/// Error against run time of the path tracer's estimators, and its speed beside Mitsuba's
#[derive(clap::Args)]
pub struct Args {
    /// Folder for tracer.md, tracer.csv and tracer.svg
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
    /// Paths per point and channel of the reference
    #[arg(long, default_value_t = 16_384)]
    reference_spp: u32,
    /// Script that measures Mitsuba, run when Python has it
    #[arg(long, default_value = "benches/peers/mitsuba_cube.py")]
    peer: PathBuf,
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
    reference_spp: u32,
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
    tracer(reference_spp)?.radiance_with_error(
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
    for exponent in 0..=10 {
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
        if exponent <= 8 {
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
    for std_error in [0.08f32, 0.04, 0.02, 0.01] {
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

/// Runs the study on one thread and writes its results.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let control = Control::none().with_cancel(cancel);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let result = pool
        .map_err(|e| e.to_string())
        .and_then(|pool| pool.install(|| study(args, &control)).map_err(|e| e.to_string()));
    match result {
        Ok(()) => Ok(()),
        Err(_) if control.cancelled() => Err(Failure::Cancelled),
        Err(message) => Err(Failure::Error(message)),
    }
}

fn study(args: &Args, control: &Control<'_>) -> Result<(), Box<dyn Error + Send + Sync>> {
    let text = |e: Box<dyn Error>| e.to_string();
    let mut rates = rates::cube(control).map_err(text)?;
    rates.extend(rates::mitsuba(&args.peer).unwrap_or_default());
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
    for (name, what, make) in makers {
        let scene = scene(name, what, &make(), control).map_err(text)?;
        println!("{name}: {} points in the patch, {} judged", scene.patch.len(), scene.judged.len());
        measure(&scene, args.reference_spp, &mut rows, control).map_err(text)?;
        names.push((scene.name, scene.what));
    }
    write_files(
        &args.out,
        &[
            ("tracer.csv", output::csv(&rows)),
            ("tracer.md", output::markdown(&names, &rows, &rates, args.reference_spp)),
            ("tracer.svg", output::svg(&names, &rows)),
        ],
    )?;
    Ok(())
}
