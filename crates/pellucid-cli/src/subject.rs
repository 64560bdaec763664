//! What commands that start from a model take: the model, how it is read, its size, printer and materials.

use std::path::{Path, PathBuf};

use pellucid::color::RenderingIntent;
use pellucid::color::spectrum::Illuminant;
use pellucid::core::InstructionSet;
use pellucid::core::files::read_text_bounded;
use pellucid::mesh::import::{Format, IccProfile};
use pellucid::mesh::{ImportOptions, LengthUnit, Model, ReadAs, Scale, UpAxis};
use pellucid::stage::{Observer, Stage};
use pellucid::{ModelRecord, PrintSettings, Record};

use crate::progress::Bars;
use crate::{Failure, arguments, terminal};

/// Most bytes of a settings file or manifest.
const SETTINGS_LIMIT: u64 = 16 << 20;

/// A model and what it is to be printed with.
#[derive(clap::Args, Clone)]
pub struct Subject {
    /// A model: glTF 2.0 (.glb, .gltf), OBJ, 3MF, PLY or STL, with its files beside it
    model: PathBuf,
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
    /// ICC profile of the model's textures where they embed none; sRGB without it. Not for glTF, whose textures are sRGB
    #[arg(long, value_name = "FILE")]
    icc: Option<PathBuf>,
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
    /// What pictures and page show as white: relative, the print's white, or absolute, a perfect one beside which the
    /// print's is seen; relative without it
    #[arg(long, value_name = "INTENT", value_parser = arguments::intent)]
    intent: Option<RenderingIntent>,
}

impl Subject {
    /// Another model under the same arguments.
    pub fn with_model(self, model: PathBuf) -> Self {
        Self { model, ..self }
    }

    /// The model's file.
    pub fn model(&self) -> &Path {
        &self.model
    }

    /// Confines the work to the threads that were asked for.
    pub fn use_threads(&self) -> Result<(), Failure> {
        arguments::use_threads(self.threads)
    }

    /// Settings of the file, where there is one, under those of the arguments; and the record of the earlier print whose
    /// settings they are.
    pub fn settings(&self) -> Result<(PrintSettings, Option<Record>), Failure> {
        let (mut settings, earlier) = match &self.settings {
            None => (PrintSettings::default(), None),
            Some(file) => {
                let text = read_text_bounded(file, SETTINGS_LIMIT)?;
                let named =
                    |e| Failure::message(format!("{}: {}", file.display(), pellucid::core::chain(&e)));
                Record::settings_from_json(&text).map_err(named)?
            }
        };
        if let Some(mm) = self.height_mm {
            settings.scale = Scale::HeightMm(mm);
        }
        if let Some(mm) = self.width_mm {
            settings.scale = Scale::WidthMm(mm);
        }
        if let Some(printer) = &self.printer {
            settings.printer = arguments::printer(printer)?;
        }
        if let Some(file) = &self.materials {
            settings.materials = arguments::materials(file)?;
        }
        if let Some((&first, further)) = self.illuminants.split_first() {
            settings.illuminant = first;
            settings.also_under = further.to_vec();
        }
        settings.clear_from_alpha |= self.clear_from_alpha;
        settings.refractive_index = self.refractive_index.unwrap_or(settings.refractive_index);
        settings.seed = self.seed.unwrap_or(settings.seed);
        settings.instruction_set = self.instruction_set.or(settings.instruction_set);
        settings.absolute |= self.absolute;
        settings.proof_intent = self.intent.unwrap_or(settings.proof_intent);
        Ok((settings, earlier))
    }

    /// The model, read as the arguments say; without a word of theirs, and if it is the model of an earlier
    /// print, as it was read then; how opaque it is where `opacity` asks for it.
    pub fn import(&self, opacity: bool, earlier: Option<&Record>, bars: &Bars) -> Result<Model, Failure> {
        let icc = self.icc.as_ref().map(IccProfile::load).transpose()?;
        let options =
            ImportOptions { unit: self.unit, up: self.up, opacity, icc, ..ImportOptions::default() };
        let options = ImportOptions { color: self.color.unwrap_or(options.color), ..options };
        bars.begin(Stage::Import);
        let imported = options.import_path(&self.model).map(|model| self.as_then(earlier, model, &options));
        bars.end(Stage::Import);
        let model = imported?;
        // What an earlier print was made with needs no note.
        let known = |read_as: &ReadAs| earlier.and_then(|e| e.model.read_as) == Some(*read_as);
        let asked = self.unit.is_some() || self.up.is_some();
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
        if let Some(earlier) = earlier {
            warn_of_another(&model, earlier);
        }
        Ok(model)
    }

    /// The model read as an earlier print did, if that makes it the same model and no argument asks for
    /// something else.
    fn as_then(&self, earlier: Option<&Record>, model: Model, options: &ImportOptions) -> Model {
        let asked = self.unit.is_some() || self.up.is_some() || self.color.is_some();
        let Some((record, then)) = earlier.and_then(|e| Some((&e.model, e.model.read_as?))) else {
            return model;
        };
        if asked || model.read_as() == Some(&then) {
            return model;
        }
        let options =
            ImportOptions { unit: Some(then.unit), up: Some(then.up), color: then.color, ..options.clone() };
        let again = options.import_path(&self.model).ok();
        again.filter(|again| ModelRecord::of(again).digest == record.digest).unwrap_or(model)
    }
}

/// Whether files of a format do not say their unit and axes.
fn is_silent(read_as: &ReadAs) -> bool {
    !matches!(read_as.format, Format::Gltf | Format::ThreeMf)
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

fn instruction_set(name: &str) -> Result<InstructionSet, String> {
    name.parse().map_err(|e: pellucid::core::Fault| e.to_string())
}
