//! `pellucid prepare`: the main job.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::ValueEnum;
use pellucid::color::spectrum::Illuminant;
use pellucid::core::files::read_text_bounded;
use pellucid::core::{InstructionSet, staging};
use pellucid::job::ProofFiles;
use pellucid::mesh::export::MeshFormat;
use pellucid::mesh::{ImportOptions, LengthUnit, Model, ReadAs, Scale, UpAxis, import::Format};
use pellucid::predict::NetworkDevice;
use pellucid::slice::Container;
use pellucid::stage::{Observer, Stage};
use pellucid::{
    GradientKind, ModelRecord, Monitor, NetworkWeights, PredictorKind, PrintJob, PrintSettings, Record,
    StrategyKind, Workspace,
};

use crate::progress::{Bars, peak_memory_bytes};
use crate::{Failure, arguments, summary, terminal};

/// Most bytes of a settings file or manifest.
const SETTINGS_LIMIT: u64 = 16 << 20;

/// Arguments of `pellucid prepare`.
#[derive(clap::Args)]
#[command(args_override_self = true)]
pub struct Args {
    /// A model: glTF 2.0 (.glb, .gltf), OBJ, 3MF, PLY or STL, with its files beside it
    model: PathBuf,
    /// Folder to create: slices, manifest.json, report.json, proof.html, proof.glb, proof.png, proof.exr, error.png
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is made: slices, or the model with a compensated texture, for printers that take textured models
    #[arg(long, value_enum, default_value = "slices")]
    output: Output,
    /// What that model is written as: glb, obj or 3mf; as the model's own file without it
    #[arg(long, value_name = "FORMAT", value_parser = arguments::mesh_format)]
    texture_format: Option<MeshFormat>,
    /// Settings of a JSON file, or those of an earlier print's manifest.json; other options go before it
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Length of one unit in the model's file: um, mm, cm, in, ft or m; the format's without it
    #[arg(long, value_name = "UNIT", value_parser = arguments::length_unit)]
    unit: Option<LengthUnit>,
    /// Axis that points up in the model's file, y or z; the format's without it
    #[arg(long, value_name = "AXIS", value_parser = arguments::up_axis)]
    up: Option<UpAxis>,
    /// Colour, rrggbb, of what has none in the model's file, such as all of an STL; white without it
    #[arg(long, value_name = "RRGGBB", value_parser = arguments::color)]
    color: Option<[f32; 3]>,
    /// Height of the print in mm; the model's own size without it
    #[arg(long, value_name = "MM", value_parser = arguments::size_mm, allow_hyphen_values = true)]
    height_mm: Option<f64>,
    /// Width of the print in mm, along x, instead of its height
    #[arg(long, value_name = "MM", value_parser = arguments::size_mm, allow_hyphen_values = true,
          conflicts_with = "height_mm")]
    width_mm: Option<f64>,
    /// Printer: j750, j750-high-quality-vivid and so on, or the file of a profile
    #[arg(long, value_name = "NAME|FILE")]
    printer: Option<String>,
    /// What the slices are written as: png (a folder of them), gcvf, nrrd or npy; png without it
    #[arg(long, value_name = "FORMAT", value_parser = arguments::format)]
    format: Option<Container>,
    /// Materials in a file; cyan, magenta, yellow, black and white without it
    #[arg(long, value_name = "FILE")]
    materials: Option<PathBuf>,
    /// Lights that the print should look right under, such as D65,A,LED, for materials of many bands: D65, D50, E, A, F11,
    /// LED. The first is the one it is judged under; D65 without it
    #[arg(long, value_name = "LIGHT,…", value_delimiter = ',', value_parser = arguments::illuminant)]
    illuminants: Vec<Illuminant>,
    /// Print what is see-through (alpha below one half) in the printer's clear resin; without it all is opaque
    #[arg(long)]
    clear_from_alpha: bool,
    /// Refractive index of the printed surface; 1.5 without it
    #[arg(long, value_name = "N", value_parser = arguments::refractive_index, allow_hyphen_values = true)]
    refractive_index: Option<f64>,
    /// Appearance predictor of the refinement; mc without it
    #[arg(long, value_enum)]
    predictor: Option<Predictor>,
    /// How materials are rearranged; descent without it
    #[arg(long, value_enum)]
    strategy: Option<Strategy>,
    /// Weights of the network, made by `pellucid train`; those the program carries without it
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Device that runs the network in candle: cpu, cuda or metal; own kernels on the processor without it
    #[arg(long, value_name = "DEVICE", value_parser = device)]
    device: Option<NetworkDevice>,
    /// Paths a surface point and channel in each iteration, where points are traced; 8 without it, 16 of surface-first
    #[arg(long, value_name = "N", value_parser = arguments::positive, allow_hyphen_values = true)]
    spp: Option<u32>,
    /// Refinement iterations at most; 40 without it, 10 of surface-first. 0 leaves the unrefined halftone
    #[arg(long, value_name = "N", value_parser = arguments::count, allow_hyphen_values = true)]
    iterations: Option<u32>,
    /// Seed of everything random; the same seed gives the same slices
    #[arg(long, value_name = "N", value_parser = arguments::seed, allow_hyphen_values = true)]
    seed: Option<u64>,
    /// Vector instructions: portable, avx2, avx512 or avx512bf16; the best there are without it
    #[arg(long, value_name = "SET", value_parser = instruction_set)]
    instruction_set: Option<InstructionSet>,
    /// Worker threads; all cores without it. Does not change the result
    #[arg(long, value_name = "N", value_parser = arguments::positive, allow_hyphen_values = true)]
    threads: Option<u32>,
    /// Aim at the texture's absolute colours instead of colours relative to the print's white
    #[arg(long)]
    absolute: bool,
    /// Go on with an interrupted job of the same settings and model
    #[arg(long)]
    resume: bool,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Output {
    /// Voxel slices, of which the printer makes every drop
    Slices,
    /// A textured model, whose colours the printer makes into inks by itself
    Texture,
}

#[derive(Clone, Copy, ValueEnum)]
enum Predictor {
    /// Monte Carlo path tracing
    Mc,
    /// The trained appearance network, corrected by paths
    Rpnn,
    /// Whichever is ahead on the object at hand, by trial
    Auto,
}

#[derive(Clone, Copy, ValueEnum)]
enum Strategy {
    /// Correct each surface voxel's own column, from the surface down
    SurfaceFirst,
    /// Follow the derivatives of a perceptual loss by the materials of every voxel
    Descent,
    /// Move the colour of each surface voxel alone, as `--output texture` does
    SurfaceColor,
}

fn device(name: &str) -> Result<NetworkDevice, String> {
    NetworkDevice::from_name(name)
        .ok_or_else(|| format!("a device is {}", NetworkDevice::ALL.map(NetworkDevice::name).join(", ")))
}

fn instruction_set(name: &str) -> Result<InstructionSet, String> {
    name.parse().map_err(|e: pellucid::core::Fault| e.to_string())
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    arguments::use_threads(args.threads)?;
    let (settings, earlier) = settings(args)?;
    let job = PrintJob::new(settings)?;
    match args.output {
        Output::Slices => job.check_output(&args.out, args.force)?,
        // The model's own format is known later, and always there: what was read can be written.
        Output::Texture => {
            job.check_texture_output(&args.out, args.texture_format.unwrap_or(MeshFormat::Glb), args.force)?;
        }
    }
    let workspace = workspace(args)?;

    let bars = Bars::new();
    let model = import(args, job.settings().clear_from_alpha, earlier.as_ref(), &bars)?;
    if let Some(earlier) = earlier {
        warn_of_another(&model, &earlier);
    }
    let monitor = Monitor::new(&bars, cancel).with_peak_memory(peak_memory_bytes);
    let result = job.prepare(&model, &workspace, &monitor).and_then(|prepared| match args.output {
        Output::Slices => prepared.write_with(ProofFiles::built(), &args.out, args.force, &monitor),
        Output::Texture => {
            let own = model.read_as().map_or(MeshFormat::Glb, |read| MeshFormat::of(read.format));
            let format = args.texture_format.unwrap_or(own);
            prepared.write_texture(&args.out, &model, format, args.force, &monitor)
        }
    });
    let report = result.map_err(|error| match Failure::from(error) {
        Failure::Cancelled(_) => Failure::Cancelled(kept(&workspace, &args.out)),
        other => other,
    })?;
    workspace.finish()?;
    terminal::print(&summary::of(&report, &args.out))?;
    Ok(())
}

/// Settings of the file, where there is one, under those of the arguments.
fn settings(args: &Args) -> Result<(PrintSettings, Option<Record>), Failure> {
    let (mut settings, earlier) = match &args.settings {
        None => (PrintSettings::default(), None),
        Some(file) => {
            let text = read_text_bounded(file, SETTINGS_LIMIT)?;
            let named = |e| Failure::message(format!("{}: {}", file.display(), pellucid::core::chain(&e)));
            Record::settings_from_json(&text).map_err(named)?
        }
    };
    if let Some(mm) = args.height_mm {
        settings.scale = Scale::HeightMm(mm);
    }
    if let Some(mm) = args.width_mm {
        settings.scale = Scale::WidthMm(mm);
    }
    if let Some(printer) = &args.printer {
        settings.printer = arguments::printer(printer)?;
    }
    settings.format = args.format.unwrap_or(settings.format);
    if let Some(file) = &args.materials {
        settings.materials = arguments::materials(file)?;
    }
    if let Some((&first, further)) = args.illuminants.split_first() {
        settings.illuminant = first;
        settings.also_under = further.to_vec();
    }
    if let Some(predictor) = args.predictor {
        settings.predictor = match predictor {
            Predictor::Mc => PredictorKind::MonteCarlo,
            Predictor::Rpnn => PredictorKind::Rpnn,
            Predictor::Auto => PredictorKind::Auto,
        };
    }
    if let Some(strategy) = args.strategy {
        settings.strategy = match strategy {
            Strategy::SurfaceFirst => StrategyKind::SurfaceFirst,
            Strategy::Descent => StrategyKind::Descent,
            Strategy::SurfaceColor => StrategyKind::SurfaceColor,
        };
    }
    if args.output == Output::Texture {
        if args.strategy.is_some_and(|s| !matches!(s, Strategy::SurfaceColor)) {
            return Err(Failure::message(
                "--output texture moves surface colours only; leave --strategy out",
            ));
        }
        settings.strategy = StrategyKind::SurfaceColor;
    }
    if let Some(file) = &args.weights {
        if settings.predictor == PredictorKind::MonteCarlo && settings.gradient == GradientKind::Paths {
            return Err(Failure::message("--weights are the network's; add --predictor rpnn"));
        }
        settings.weights = Some(NetworkWeights::load(file)?);
    }
    if let Some(device) = args.device {
        if settings.predictor == PredictorKind::MonteCarlo {
            return Err(Failure::message("--device is the network's; add --predictor rpnn"));
        }
        settings.device = Some(device);
    }
    settings.clear_from_alpha |= args.clear_from_alpha;
    settings.refractive_index = args.refractive_index.unwrap_or(settings.refractive_index);
    settings.spp = args.spp.or(settings.spp);
    settings.refine.iterations = args.iterations.or(settings.refine.iterations);
    settings.seed = args.seed.unwrap_or(settings.seed);
    settings.instruction_set = args.instruction_set.or(settings.instruction_set);
    settings.absolute |= args.absolute;
    Ok((settings, earlier))
}

/// The job's checkpoints: a new job's, or an interrupted one's with `--resume`.
fn workspace(args: &Args) -> Result<Workspace, Failure> {
    for partial in staging::remains(&args.out)? {
        terminal::note(format!(
            "warning: a run that was interrupted while it wrote left {}; nothing reads it, remove it",
            partial.display()
        ));
    }
    if !args.resume {
        return Ok(Workspace::create(&args.out)?);
    }
    let workspace = Workspace::resume(&args.out);
    if !workspace.has_checkpoint() {
        terminal::note("nothing to resume; starting anew");
    }
    Ok(workspace)
}

/// The model, read as the arguments say; without a word of theirs, and if it is the model of an earlier
/// print, as it was read then.
fn import(args: &Args, opacity: bool, earlier: Option<&Record>, bars: &Bars) -> Result<Model, Failure> {
    let options = ImportOptions { unit: args.unit, up: args.up, opacity, ..ImportOptions::default() };
    let options = ImportOptions { color: args.color.unwrap_or(options.color), ..options };
    bars.begin(Stage::Import);
    let imported = options.import_path(&args.model).map(|model| as_then(args, opacity, earlier, model));
    bars.end(Stage::Import);
    let model = imported?;
    // What an earlier print was made with needs no note.
    let known = |read_as: &ReadAs| earlier.and_then(|e| e.model.read_as) == Some(*read_as);
    let asked = args.unit.is_some() || args.up.is_some();
    if let Some(read_as) = model.read_as().filter(|r| !asked && is_silent(r) && !known(r)) {
        terminal::note(format!(
            "note: {} says nothing of units and axes: one unit is taken as 1 {}, {} as up (--unit, --up)",
            read_as.format.label(),
            read_as.unit.name(),
            read_as.up.name()
        ));
    }
    for note in model.notes() {
        terminal::note(format!("note: {}: {}", note.object, note.text));
    }
    Ok(model)
}

/// Whether files of a format do not say their unit and axes.
fn is_silent(read_as: &ReadAs) -> bool {
    !matches!(read_as.format, Format::Gltf | Format::ThreeMf)
}

/// The model read as an earlier print did, if that makes it the same model and no argument asks for
/// something else.
fn as_then(args: &Args, opacity: bool, earlier: Option<&Record>, model: Model) -> Model {
    let asked = args.unit.is_some() || args.up.is_some() || args.color.is_some();
    let Some((record, then)) = earlier.and_then(|e| Some((&e.model, e.model.read_as?))) else { return model };
    if asked || model.read_as() == Some(&then) {
        return model;
    }
    let options = ImportOptions {
        unit: Some(then.unit),
        up: Some(then.up),
        color: then.color,
        opacity,
        ..ImportOptions::default()
    };
    let again = options.import_path(&args.model).ok();
    again.filter(|again| ModelRecord::of(again).digest == record.digest).unwrap_or(model)
}

fn warn_of_another(model: &Model, earlier: &Record) {
    if ModelRecord::of(model).digest != earlier.model.digest {
        terminal::note(format!(
            "warning: the settings were recorded with another model, {:?}; the slices will differ",
            earlier.model.name
        ));
    }
    if env!("CARGO_PKG_VERSION") != earlier.version {
        terminal::note(format!("warning: the settings were recorded by version {}", earlier.version));
    }
}

/// What a cancelled job leaves.
fn kept(workspace: &Workspace, out: &Path) -> String {
    let folder = Workspace::folder_of(out);
    match workspace.holds_checkpoint() {
        true => format!("{} holds what was done; go on with --resume", folder.display()),
        false => "nothing was written".to_owned(),
    }
}
