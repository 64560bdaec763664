//! `pellucid prepare`: the main job.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::ValueEnum;
use pellucid::core::memory::{free_bytes, peak_bytes};
use pellucid::core::team::Alone;
use pellucid::core::{Bytes, Team, staging};
use pellucid::job::ProofFiles;
use pellucid::mesh::export::MeshFormat;
use pellucid::mesh::{ImportLimits, Model, SpectralImage};
use pellucid::predict::NetworkDevice;
use pellucid::slice::Container;
use pellucid::{
    GradientKind, Monitor, NetworkWeights, PredictorKind, PrintJob, PrintSettings, Record, StrategyKind,
    Workspace,
};

use crate::progress::Bars;
use crate::subject::Subject;
use crate::{Failure, arguments, summary, terminal};

/// Arguments of `pellucid prepare`.
#[derive(clap::Args, Clone)]
#[command(args_override_self = true)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Folder to create: slices, manifest.json, report.json, proof.html, proof.glb, proof.png, proof.exr, error.png
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is made: slices, or the model with a compensated texture, for printers that take textured models
    #[arg(long, value_enum, default_value = "slices")]
    output: Output,
    /// What that model is written as: glb, obj or 3mf; as the model's own file without it
    #[arg(long, value_name = "FORMAT", value_parser = arguments::mesh_format)]
    texture_format: Option<MeshFormat>,
    /// What the slices are written as: png (a folder of them), gcvf, nrrd or npy; png without it
    #[arg(long, value_name = "FORMAT", value_parser = arguments::format)]
    format: Option<Container>,
    /// OpenEXR file of reflectances by wavelength (channels T.550,000nm) on the texture's UV map, in place of the texture;
    /// for materials by band
    #[arg(long, value_name = "FILE")]
    spectral_texture: Option<PathBuf>,
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
    /// Paths a surface point and channel in each iteration, where points are traced; descent doubles them later; without it
    /// 4, 16 of surface-first
    #[arg(long, value_name = "N", value_parser = arguments::positive, allow_hyphen_values = true)]
    spp: Option<u32>,
    /// Refinement iterations at most; 34 without it, 10 of surface-first. 0 leaves the unrefined halftone
    #[arg(long, value_name = "N", value_parser = arguments::count, allow_hyphen_values = true)]
    iterations: Option<u32>,
    /// Refine in sections so many mm high: takes the memory of a section with what is around it instead of that of the
    /// print, and more time; as a whole without it
    #[arg(long, value_name = "MM", value_parser = arguments::size_mm, allow_hyphen_values = true)]
    section_mm: Option<f64>,
    /// Most memory that the job may take, such as 8GiB or 900MiB: one that would take more is refused before it starts.
    /// Without it, one that would take more than is free is warned of
    #[arg(long, value_name = "SIZE", value_parser = arguments::memory)]
    memory: Option<Bytes>,
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
    /// The trained appearance network, with paths that take its error out
    Rpnn,
    /// Whichever is ahead on the object at hand, by trial; mc for descent
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

impl Args {
    /// The same for another model and output folder.
    pub fn with_model(&self, model: PathBuf, out: PathBuf) -> Self {
        Self { subject: self.subject.clone().with_model(model), out, ..self.clone() }
    }

    /// The model's file.
    pub fn model(&self) -> &Path {
        self.subject.model()
    }

    /// The output folder.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Whether an interrupted job is gone on with.
    pub fn resume(&self) -> bool {
        self.resume
    }
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let alone: Arc<dyn Team> = Arc::new(Alone);
    prepare_as(args, &alone, cancel)
}

/// `pellucid prepare` as a member of a team, each of whom reads the model. The first one writes, and says what there is to
/// say.
///
/// # Errors
/// [`Failure`], as a message for the user.
pub fn run_in(args: &Args, team: &Arc<dyn Team>) -> Result<(), Failure> {
    prepare_as(args, team, &AtomicBool::new(false))
}

fn prepare_as(args: &Args, team: &Arc<dyn Team>, cancel: &AtomicBool) -> Result<(), Failure> {
    args.subject.use_threads()?;
    let (settings, earlier) = settings(args)?;
    let job = PrintJob::new(settings)?.with_team(Arc::clone(team))?;
    let first = team.rank() == 0;
    match args.output {
        _ if !first => {}
        Output::Slices => job.check_output(&args.out, args.force)?,
        // The model's own format is known later, and always there: what was read can be written.
        Output::Texture => {
            job.check_texture_output(&args.out, args.texture_format.unwrap_or(MeshFormat::Glb), args.force)?;
        }
    }
    let workspace = if first { workspace(args)? } else { Workspace::none() };
    let workspace = workspace.of_team(Arc::clone(team));

    let bars = Bars::new();
    let model = args.subject.import(job.settings().clear_from_alpha, earlier.as_ref(), &bars)?;
    tell_memory(args, &job, &model)?;
    let spectral = spectral_image(args, earlier.as_ref())?;
    let monitor = Monitor::new(&bars, cancel).with_peak_memory(peak_bytes);
    let prepared = match &spectral {
        Some(image) => job.prepare_spectral(&model, image, &workspace, &monitor),
        None => job.prepare(&model, &workspace, &monitor),
    };
    if !first {
        return Ok(prepared.map(drop)?);
    }
    let result = prepared.and_then(|prepared| match args.output {
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

/// Says what memory the job will take, and refuses it where that is too much.
fn tell_memory(args: &Args, job: &PrintJob, model: &Model) -> Result<(), Failure> {
    let need = match args.memory {
        Some(limit) => job.check_memory(model, limit)?,
        None => job.memory_need(model)?,
    };
    terminal::note(format!(
        "memory: about {}, for {} thousand surface voxels",
        need.bytes,
        need.surface_voxels.div_ceil(1000)
    ));
    if let Some(free) = free_bytes().map(Bytes).filter(|&free| args.memory.is_none() && need.bytes > free) {
        terminal::note(format!("warning: {free} are free; --memory with that much tells what would fit"));
    }
    Ok(())
}

/// The image of reflectances in place of the texture, if there is one.
fn spectral_image(args: &Args, earlier: Option<&Record>) -> Result<Option<SpectralImage>, Failure> {
    let read = |file: &PathBuf| SpectralImage::read_exr(file, &ImportLimits::default());
    let image = args.spectral_texture.as_ref().map(read).transpose()?;
    let digest = image.as_ref().map(|image| image.digest().hex());
    if earlier.is_some_and(|earlier| earlier.model.spectral_image != digest) {
        terminal::note(
            "warning: the settings were recorded with another spectral texture; the slices will differ",
        );
    }
    Ok(image)
}

/// Settings of the file, where there is one, under those of the arguments.
fn settings(args: &Args) -> Result<(PrintSettings, Option<Record>), Failure> {
    if args.spectral_texture.is_some() && args.output == Output::Texture {
        return Err(Failure::message(
            "--output texture moves a texture's colours; leave --spectral-texture out",
        ));
    }
    let (mut settings, earlier) = args.subject.settings()?;
    settings.format = args.format.unwrap_or(settings.format);
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
    settings.section_mm = args.section_mm.or(settings.section_mm);
    if args.output == Output::Texture {
        if args.strategy.is_some_and(|s| !matches!(s, Strategy::SurfaceColor)) {
            return Err(Failure::message(
                "--output texture moves surface colours only; leave --strategy out",
            ));
        }
        settings.strategy = StrategyKind::SurfaceColor;
    }
    let by_paths = settings.predictor.of(settings.strategy) == PredictorKind::MonteCarlo;
    if let Some(file) = &args.weights {
        if by_paths && settings.gradient == GradientKind::Paths {
            return Err(Failure::message("--weights are the network's; add --predictor rpnn"));
        }
        settings.weights = Some(NetworkWeights::load(file)?);
    }
    if let Some(device) = args.device {
        if by_paths {
            return Err(Failure::message("--device is the network's; add --predictor rpnn"));
        }
        settings.device = Some(device);
    }
    settings.spp = args.spp.or(settings.spp);
    settings.refine.iterations = args.iterations.or(settings.refine.iterations);
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

/// What a cancelled job leaves.
fn kept(workspace: &Workspace, out: &Path) -> String {
    let folder = Workspace::folder_of(out);
    match workspace.holds_checkpoint() {
        true => format!("{} holds what was done; go on with --resume", folder.display()),
        false => "nothing was written".to_owned(),
    }
}
