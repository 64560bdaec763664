//! Values of arguments: ranges that say what is allowed, printers and materials by name or file.

use std::path::Path;

use pellucid::color::RenderingIntent;
use pellucid::color::space::srgb_decode;
use pellucid::color::spectrum::Illuminant;
use pellucid::core::{Bytes, Fault};
use pellucid::mesh::export::MeshFormat;
use pellucid::mesh::{LengthUnit, UpAxis};
use pellucid::slice::{Container, ExportSettings, PrintTarget};
use pellucid::voxel::MaterialTable;

use crate::Failure;

/// Heights and widths in mm that anybody prints.
const SIZE_MM: std::ops::RangeInclusive<f64> = 0.05..=10_000.0;

/// What commands that write slices of their own take.
#[derive(clap::Args)]
pub struct Slices {
    /// Printer: j750, j750-high-quality-vivid and so on, or the file of a profile
    #[arg(long, value_name = "NAME|FILE", default_value = "j750")]
    printer: String,
    /// What the slices are written as: png (a folder of them), gcvf, nrrd or npy
    #[arg(long, value_name = "FORMAT", value_parser = format, default_value = "png")]
    format: Container,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

impl Slices {
    /// The printer's profile.
    pub fn printer(&self) -> Result<PrintTarget, Failure> {
        printer(&self.printer)
    }

    /// How slices are written.
    pub fn export(&self) -> ExportSettings {
        ExportSettings {
            force: self.force,
            format: self.format,
            generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
            ..ExportSettings::default()
        }
    }
}

/// A height or width in mm.
pub fn size_mm(text: &str) -> Result<f64, String> {
    let allowed = format!("it is {} to {} mm", SIZE_MM.start(), SIZE_MM.end());
    let value: f64 = text.parse().map_err(|_| format!("not a number; {allowed}"))?;
    if SIZE_MM.contains(&value) { Ok(value) } else { Err(allowed) }
}

/// A refractive index.
pub fn refractive_index(text: &str) -> Result<f64, String> {
    let allowed = "a refractive index is 1 (index-matched) to 3";
    let value: f64 = text.parse().map_err(|_| format!("not a number; {allowed}"))?;
    if (1.0..=3.0).contains(&value) { Ok(value) } else { Err(allowed.to_owned()) }
}

/// A whole number from 0 to 2^64 - 1.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("a seed is a whole number from 0 to {}", u64::MAX))
}

/// A whole number from 1 on.
pub fn positive(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(value) if value > 0 => Ok(value),
        _ => Err(format!("a whole number from 1 to {} is needed", u32::MAX)),
    }
}

/// A whole number from 0 on.
pub fn count(text: &str) -> Result<u32, String> {
    text.parse().map_err(|_| format!("a whole number from 0 to {} is needed", u32::MAX))
}

/// An amount of memory.
pub fn memory(text: &str) -> Result<Bytes, String> {
    text.parse().map_err(|fault: Fault| fault.remedy)
}

/// What slices are written as.
pub fn format(name: &str) -> Result<Container, String> {
    let known = Container::ALL.map(Container::name).join(", ");
    let found = Container::ALL.into_iter().find(|format| format.name() == name);
    found.ok_or_else(|| format!("a format is one of {known}"))
}

/// What a textured model is written as.
pub fn mesh_format(name: &str) -> Result<MeshFormat, String> {
    let known = MeshFormat::ALL.map(MeshFormat::name).join(", ");
    let found = MeshFormat::ALL.into_iter().find(|format| format.name() == name);
    found.ok_or_else(|| format!("a format is one of {known}"))
}

/// A light by its name.
pub fn illuminant(name: &str) -> Result<Illuminant, String> {
    let known = || Illuminant::ALL.map(Illuminant::name).join(", ");
    Illuminant::from_name(name).ok_or_else(|| format!("a light is one of {}", known()))
}

/// What proof pictures show as white.
pub fn intent(name: &str) -> Result<RenderingIntent, String> {
    match name {
        "relative" => Ok(RenderingIntent::RelativeColorimetric),
        "absolute" => Ok(RenderingIntent::AbsoluteColorimetric),
        _ => Err("an intent is relative or absolute".to_owned()),
    }
}

/// A length unit by its symbol.
pub fn length_unit(name: &str) -> Result<LengthUnit, String> {
    let all = || LengthUnit::ALL.map(LengthUnit::name).join(", ");
    LengthUnit::from_name(name).ok_or_else(|| format!("a unit is one of {}", all()))
}

/// An axis that points up.
pub fn up_axis(name: &str) -> Result<UpAxis, String> {
    match name {
        "y" => Ok(UpAxis::Y),
        "z" => Ok(UpAxis::Z),
        _ => Err("the axis that points up is y or z".to_owned()),
    }
}

/// A colour `#rrggbb` of a display, as linear light.
pub fn color(text: &str) -> Result<[f32; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let value = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6 && digits.is_ascii());
    let [_, rgb @ ..] = value.ok_or("a colour is six hexadecimal digits, rrggbb")?.to_be_bytes();
    Ok(rgb.map(|byte| srgb_decode(f64::from(byte) / 255.0) as f32))
}

/// A printer by its name, or its profile's file.
pub fn printer(name_or_file: &str) -> Result<PrintTarget, Failure> {
    Ok(PrintTarget::by_name_or_file(name_or_file)?)
}

/// Materials of a file.
pub fn materials(file: &Path) -> Result<MaterialTable, Failure> {
    Ok(MaterialTable::load(file)?)
}

/// Confines the work to so many threads.
pub fn use_threads(threads: Option<u32>) -> Result<(), Failure> {
    let Some(threads) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads as usize)
        .build_global()
        .map_err(|e| Failure::message(format!("--threads {threads}: {e}")))
}
