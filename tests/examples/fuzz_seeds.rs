//! Writes the seeds of the fuzz targets that the project's own writers make; those of models and pictures stand beside them.
//!
//! `cargo run --release -p pellucid-tests --example fuzz_seeds`

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use pellucid::dataset::{Recipe, SetHeader, Shard, generate};
use pellucid::rpnn::{SHIPPED, Variant, train::TrainSettings, train::Trainer};
use pellucid::slice::{Container, ExportSettings, PrintTarget, export};
use pellucid::voxel::{Control, Frame, LabelGrid, MaterialTable};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_tests::readers::any_height;

type Result<T = ()> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result {
    slices()?;
    spectral()?;
    documents()?;
    refinements()?;
    states()
}

/// Writes a seed of a target.
fn seed(target: &str, name: &str, bytes: impl AsRef<[u8]>) -> Result {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(target);
    fs::create_dir_all(&folder)?;
    Ok(fs::write(folder.join(name), bytes)?)
}

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn grid(size: [u32; 3]) -> Result<LabelGrid> {
    let frame = Frame::new([0.0; 3], PrintTarget::j750().pitch(), size)?;
    Ok(LabelGrid::from_fn(frame, |[x, y, z]| ((x + 3 * y + z / 2) % 7).min(5) as u8))
}

fn slices() -> Result {
    let temp = tempfile::tempdir()?;
    // The first is the print whose slices lie beside a manifest under test.
    for (name, size) in [("small", [8, 4, 2]), ("larger", [40, 20, 5])] {
        let grid = if name == "small" {
            LabelGrid::from_fn(*grid(size)?.frame(), |[x, y, _]| x.min(y + 2) as u8)
        } else {
            grid(size)?
        };
        seed("grid", name, grid.encode())?;
        for format in Container::ALL {
            let vivid = PrintTarget::by_name("j750-high-mix-vivid")?;
            let target = if format == Container::Gcvf { vivid } else { any_height() };
            let out = temp.path().join(format!("{name}-{}", format.name()));
            let settings = ExportSettings { format, ..Default::default() };
            export(&grid, &MaterialTable::cmykw(), &target, &settings, &out, &Control::none())?;
            match format {
                Container::Png => {
                    seed("png_stack", name, fs::read(out.join("slices/slice_00000.png"))?)?;
                    seed("manifest", name, fs::read(out.join("manifest.json"))?)?;
                }
                other => seed(other.name(), name, fs::read(out.join(other.files()))?)?,
            }
        }
    }
    Ok(())
}

/// Spectral images of three bands beside a preview, as they are and compressed.
fn spectral() -> Result {
    for (name, encoding) in [("plain", Encoding::UNCOMPRESSED), ("zip", Encoding::SMALL_LOSSLESS)] {
        let plane = |k: usize| FlatSamples::F32((0..6).map(|i| ((i + k) % 5) as f32 / 4.0).collect());
        let names = ["T.400,000nm", "550nm", "700", "R", "G", "B"];
        let channels = names.iter().enumerate().map(|(k, &name)| AnyChannel::new(name, plane(k))).collect();
        let layer = Layer::new((3, 2), LayerAttributes::named(""), encoding, AnyChannels::sort(channels));
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes)?;
        seed("spectral", name, bytes.into_inner())?;
    }
    Ok(())
}

fn documents() -> Result {
    for (target, name, path) in [
        ("materials", "cmykw", "datasets/materials/cmykw.json"),
        ("materials", "spectral", "datasets/materials/cmykw-spectral.json"),
        ("printer", "j750", "datasets/printers/j750.json"),
        ("printer", "vivid", "datasets/printers/j750-high-mix-vivid.json"),
        ("recipe", "toy", "datasets/recipes/toy.json"),
        ("recipe", "default", "datasets/recipes/default.json"),
        ("cases", "radiance", "datasets/reference/radiance.json"),
        ("measurements", "lab", "datasets/calibration/measured.csv"),
    ] {
        seed(target, name, fs::read(repository(path))?)?;
    }
    let spectra = "patch;stack;400 nm;410 nm;420 nm\nA1;white 4 / black;0.5;0.6;0.7\nA2;cyan 0.1 / white 4 / black;0.1;0.2;0.3\n";
    seed("measurements", "spectra", spectra)?;
    let cgats = "CGATS.17\nNUMBER_OF_FIELDS 5\nBEGIN_DATA_FORMAT\nSAMPLE_ID stack XYZ_X XYZ_Y XYZ_Z\nEND_DATA_FORMAT\n\
        NUMBER_OF_SETS 1\nBEGIN_DATA\nA1 \"white 4 / black\" 60.1 62.3 50.4\nEND_DATA\n";
    seed("measurements", "cgats", cgats)
}

/// Interrupted jobs of every strategy, with settings, record and report.
fn refinements() -> Result {
    let temp = tempfile::tempdir()?;
    for strategy in [StrategyKind::SurfaceFirst, StrategyKind::Descent, StrategyKind::SurfaceColor] {
        let mut settings =
            PrintSettings { spp: Some(1), judge_point_spp: 8, strategy, ..PrintSettings::default() };
        settings.refine.iterations = Some(1);
        let name = strategy.name();
        seed("settings", name, serde_json::to_string(&settings)?)?;
        let job = PrintJob::new(settings)?;
        let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [8, 4, 12])?;
        let block = LabelGrid::from_fn(frame, |_| 1);
        let color = |[x, _, _]: [u32; 3]| if x < 6 { [0.8, 0.2, 0.1] } else { [0.9, 0.9, 0.8] };
        let out = temp.path().join(name);
        let monitor = Monitor::silent();
        let workspace = Workspace::create(&out)?;
        let prepared = job.prepare_volume("block", &block, color, &workspace, &monitor)?;
        let kept = Workspace::folder_of(&out);
        seed("refinement", name, fs::read(kept.join("refinement.bin"))?)?;
        seed("job_record", name, fs::read(kept.join("record.json"))?)?;
        prepared.write(&out, true, &monitor)?;
        seed("settings", &format!("{name}-manifest"), fs::read(out.join("manifest.json"))?)?;
    }
    Ok(())
}

fn states() -> Result {
    let temp = tempfile::tempdir()?;
    let recipe = Recipe::read(&repository("datasets/recipes/toy.json"))?;
    let header =
        SetHeader { recipe, split: "loops".into(), materials: MaterialTable::cmykw(), shard: Shard::WHOLE };
    seed("set", "loops", fs::read(generate(temp.path(), &header, &Control::none())?)?)?;
    seed("weights", "shipped", header_of(SHIPPED)?)?;
    let path = temp.path().join("run.safetensors");
    for variant in [Variant::SharedLevels, Variant::SharedLevelsAndOctants] {
        Trainer::new(TrainSettings { variant, ..TrainSettings::default() })?.save(&path)?;
        seed("run", variant.name(), header_of(&fs::read(&path)?)?)?;
    }
    Ok(())
}

/// The header of a safetensors file.
fn header_of(bytes: &[u8]) -> Result<&[u8]> {
    let (length, _) = bytes.split_first_chunk::<8>().ok_or("no header")?;
    let end = 8 + usize::try_from(u64::from_le_bytes(*length))?;
    Ok(bytes.get(..end).ok_or("no header")?)
}
