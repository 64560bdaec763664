//! `pellucid prepare`: the main job.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::ValueEnum;
use pellucid::mesh::voxelise::Scale;
use pellucid::mesh::{ImportLimits, import_path};
use pellucid::slice::PrintTarget;
use pellucid::stage::{Observer, Stage};
use pellucid::{PredictorKind, PrintJob, PrintSettings, Report};

use crate::Failure;
use crate::progress::Bars;

/// Arguments of `pellucid prepare`.
#[derive(clap::Args)]
pub struct Args {
    /// A glTF 2.0 model: .glb, or .gltf with its files beside it
    model: PathBuf,
    /// Folder to create: slices/, manifest.json, report.json, proof.png, proof.exr
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Height of the print in mm; the model's own size (metres) without it
    #[arg(long, value_name = "MM")]
    height_mm: Option<f64>,
    /// Printer to prepare for
    #[arg(long, value_enum, default_value_t = Printer::J750)]
    printer: Printer,
    /// Appearance predictor of the refinement loop
    #[arg(long, value_enum, default_value_t = Predictor::Rpnn)]
    predictor: Predictor,
    /// Weights of the network, made by `pellucid train`; those the program carries without it
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Paths a surface point and channel in each iteration, where points are traced
    #[arg(long, value_name = "N")]
    spp: Option<u32>,
    /// Refinement iterations; 0 leaves the unrefined halftone
    #[arg(long, value_name = "N")]
    iterations: Option<u32>,
    /// Seed of everything random; the same seed gives the same slices
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Worker threads; all cores without it. Does not change the result
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Aim at the texture's absolute colours instead of colours relative to the print's white
    #[arg(long)]
    absolute: bool,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Printer {
    /// Stratasys J750 class: 600 x 300 DPI, 27 µm layers
    J750,
}

#[derive(Clone, Copy, ValueEnum)]
enum Predictor {
    /// Monte Carlo path tracing
    Mc,
    /// The trained appearance network
    Rpnn,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    if let Some(threads) = args.threads {
        if threads == 0 {
            return Err(Failure::Error("--threads must be at least 1".into()));
        }
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .map_err(|e| Failure::Error(format!("--threads {threads}: {e}").into()))?;
    }
    let mut settings = PrintSettings { seed: args.seed, absolute: args.absolute, ..PrintSettings::default() };
    settings.target = match args.printer {
        Printer::J750 => PrintTarget::j750(),
    };
    settings.predictor = match args.predictor {
        Predictor::Mc => PredictorKind::MonteCarlo,
        Predictor::Rpnn => PredictorKind::Rpnn,
    };
    if let Some(path) = &args.weights {
        if matches!(args.predictor, Predictor::Mc) {
            return Err(Failure::Error("--weights are the network's; leave --predictor mc out".into()));
        }
        let read = pellucid::rpnn::file::load(path).map_err(|e| Failure::Error(e.into()))?;
        settings.weights = Some(Arc::new(read));
    }
    settings.scale = args.height_mm.map_or(Scale::Native, Scale::HeightMm);
    settings.spp = args.spp.unwrap_or(settings.spp);
    settings.refine.iterations = args.iterations.unwrap_or(settings.refine.iterations);
    let job = PrintJob::new(settings)?;
    job.check_output(&args.out, args.force)?;

    let bars = Bars::new();
    bars.begin(Stage::Import);
    let imported = import_path(&args.model, &ImportLimits::default());
    bars.end(Stage::Import);
    let model = imported.map_err(|e| Failure::Error(e.into()))?;
    let prepared = job.prepare(&model, &bars, cancel)?;
    let report = prepared.write(&args.out, args.force, &bars, cancel)?;
    summary(&report, args);
    Ok(())
}

/// The few figures a user looks for first.
fn summary(report: &Report, args: &Args) {
    let [x, y, z] = report.extent_mm;
    println!(
        "{x:.1} x {y:.1} x {z:.1} mm, {} layers, {} surface voxels",
        report.layers, report.surface_voxels
    );
    let e = &report.evaluation;
    println!(
        "colour error (mean dE2000 to the printable target): {:.2} unrefined, {:.2} refined ({:.0} % less)",
        e.unrefined.mapped.mean,
        e.refined.mapped.mean,
        100.0 * e.reduction()
    );
    println!(
        "refined: median {:.2}, 95 % below {:.2}; {:.0} % of the surface has a colour out of the printer's reach",
        e.refined.mapped.median,
        e.refined.mapped.p95,
        100.0 * report.refinement.out_of_gamut
    );
    println!("wrote {}", args.out.display());
}
