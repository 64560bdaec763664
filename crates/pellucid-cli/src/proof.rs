//! `pellucid proof`: what slices will look like, whatever made them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use pellucid::color::RenderingIntent;
use pellucid::core::Control;
use pellucid::core::files::read_text_bounded;
use pellucid::core::memory::peak_bytes;
use pellucid::job::{ProofFiles, SlicesProof, SlicesReport};
use pellucid::slice::{ExportSettings, ImageStack, Manifest, check, list_images, read_images, read_stack};
use pellucid::voxel::{LabelGrid, Pitch};
use pellucid::{GradientKind, Monitor, PredictorKind, PrintJob, PrintSettings, Record, StrategyKind};

use crate::progress::Bars;
use crate::{Failure, arguments, terminal};

/// Most bytes of a palette.
const PALETTE_LIMIT: u64 = 1 << 20;

/// Arguments of `pellucid proof`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder of slices: of a print with its manifest.json, or images of any tool
    print: PathBuf,
    /// Folder to create: proof.html, proof.glb, proof.png, proof.exr, report.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Materials in a file; those that the print was made with, or cyan, magenta, yellow, black and white without it
    #[arg(long, value_name = "FILE")]
    materials: Option<PathBuf>,
    /// Refractive index of the printed surface; the print's, or 1.5 without it
    #[arg(long, value_name = "N", value_parser = arguments::refractive_index, allow_hyphen_values = true)]
    refractive_index: Option<f64>,
    /// Paths a surface point and channel in each of two passes; the print's judge's, or 3 without it
    #[arg(long, value_name = "N", value_parser = arguments::positive, allow_hyphen_values = true)]
    spp: Option<u32>,
    /// Printer whose voxels and colours images without a manifest have
    #[arg(long, value_name = "NAME|FILE", default_value = "j750")]
    printer: String,
    /// Names of images without a manifest, the bottom layer first; * stands for anything
    #[arg(long, value_name = "PATTERN", default_value = "*.png")]
    pattern: String,
    /// Voxel edges X,Y,Z in mm of images without a manifest; the printer's without it
    #[arg(long, value_name = "X,Y,Z", value_parser = pitch)]
    pitch_mm: Option<Pitch>,
    /// Colours of materials in images without a manifest, a file { "white": [255, 255, 255, 255], … }; the printer's
    /// without it
    #[arg(long, value_name = "FILE")]
    palette: Option<PathBuf>,
    /// What pictures and page show as white: relative, the print's white, or absolute, a perfect one beside which the
    /// print's is seen; relative without it
    #[arg(long, value_name = "INTENT", value_parser = arguments::intent)]
    intent: Option<RenderingIntent>,
    /// Worker threads; all cores without it. Does not change the result
    #[arg(long, value_name = "N", value_parser = arguments::positive, allow_hyphen_values = true)]
    threads: Option<u32>,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

fn pitch(text: &str) -> Result<Pitch, String> {
    let edges: Vec<f64> = text.split(',').filter_map(|edge| edge.trim().parse().ok()).collect();
    let edges: [f64; 3] = edges.try_into().map_err(|_| "three lengths in mm, such as 0.042,0.085,0.027")?;
    Pitch::new(edges).map_err(|e| e.to_string())
}

/// Slices as a job takes them.
struct Slices {
    labels: LabelGrid,
    manifest: Manifest,
    settings: PrintSettings,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    arguments::use_threads(args.threads)?;
    SlicesProof::check_output(&args.out, args.force)?;
    let control = Control::none().with_cancel(cancel);
    let Slices { labels, manifest, settings } = match args.print.join("manifest.json").exists() {
        true => own_slices(args, &control)?,
        false => foreign_slices(args, &control)?,
    };
    let job = PrintJob::new(settings)?;
    let bars = Bars::new();
    let monitor = Monitor::new(&bars, cancel).with_peak_memory(peak_bytes);
    let proof = job.prove(&name_of(&args.print), labels, manifest, &monitor)?;
    let report = proof.write(ProofFiles::built(), &args.out, args.force, &monitor)?;
    terminal::print(&summary(&report, &args.out))?;
    Ok(())
}

/// The folder's own name.
fn name_of(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Only what concerns the look of given labels: nothing is refined.
fn of_the_look(settings: PrintSettings, args: &Args) -> Result<PrintSettings, Failure> {
    let mut settings = PrintSettings {
        predictor: PredictorKind::MonteCarlo,
        strategy: StrategyKind::SurfaceFirst,
        gradient: GradientKind::Paths,
        device: None,
        ..settings
    };
    if let Some(file) = &args.materials {
        settings.materials = arguments::materials(file)?;
    }
    settings.refractive_index = args.refractive_index.unwrap_or(settings.refractive_index);
    settings.proof_intent = args.intent.unwrap_or(settings.proof_intent);
    settings.judge_spp = args.spp.unwrap_or(settings.judge_spp);
    Ok(settings)
}

/// Slices with a manifest, and the settings that they were made with, where it has them.
fn own_slices(args: &Args, control: &Control<'_>) -> Result<Slices, Failure> {
    let (labels, manifest) = read_stack(&args.print, control)?;
    let settings = match manifest.settings.read::<Record>() {
        Ok(record) => record.settings,
        Err(_) => PrintSettings { printer: arguments::printer(&args.printer)?, ..PrintSettings::default() },
    };
    let settings = of_the_look(settings, args)?;
    for material in &manifest.materials {
        let known = settings.materials.get(material.label).map(|m| m.name.as_str());
        if known != Some(material.name.as_str()) {
            return Err(Failure::message(format!(
                "{}: label {} is {:?}, but {:?} in the materials; give the file of its materials (--materials)",
                args.print.join("manifest.json").display(),
                material.label,
                material.name,
                known.unwrap_or("nothing")
            )));
        }
    }
    Ok(Slices { labels, manifest, settings })
}

/// Images of another tool, by palette and pitch.
fn foreign_slices(args: &Args, control: &Control<'_>) -> Result<Slices, Failure> {
    let mut printer = arguments::printer(&args.printer)?;
    if let Some(pitch) = args.pitch_mm {
        printer = printer.with_pitch(pitch);
    }
    if let Some(file) = &args.palette {
        let text = read_text_bounded(file, PALETTE_LIMIT)?;
        let palette: BTreeMap<String, [u8; 4]> = serde_json::from_str(&text).map_err(|e| {
            Failure::message(format!("{}: {}", file.display(), pellucid::core::json::plain(&e)))
        })?;
        printer = printer.with_palette(palette)?;
    }
    let settings = of_the_look(PrintSettings { printer, ..PrintSettings::default() }, args)?;
    let stack = ImageStack::for_target(&settings.printer, &settings.materials)?;
    let labels = read_images(&list_images(&args.print, &args.pattern)?, &stack, control)?;
    let export = ExportSettings { generator: "another tool".into(), ..ExportSettings::default() };
    let manifest = check(&labels, &settings.materials, &settings.printer, &export)?;
    let manifest =
        Manifest { layers: labels.size()[2], padding_layers: 0, files: args.pattern.clone(), ..manifest };
    Ok(Slices { labels, manifest, settings })
}

/// What a user looks for first.
fn summary(report: &SlicesReport, out: &Path) -> String {
    let [x, y, z] = report.extent_mm;
    format!(
        "{x:.1} x {y:.1} x {z:.1} mm, {} surface voxels; {:.2} cm3 of resin, {:.2} g\n\
         appearance off by {:.3} (root mean square in linear light, at {} surface voxels)\nwrote {}\n",
        report.surface_voxels,
        report.resins.volume_cm3,
        report.resins.grams,
        report.picture.rmse,
        report.picture.points,
        out.display()
    )
}
