//! What a print job is asked to do.

use pellucid_color::RenderingIntent;
use pellucid_color::spectrum::Illuminant;
use pellucid_core::InstructionSet;
use pellucid_mesh::Scale;
use pellucid_predict::{Correction, NetworkDevice, Sharing};
use pellucid_refine::{Descent, Effort, RefineSettings, Strategy, SurfaceColor, SurfaceFirst};
use pellucid_slice::{Container, PrintTarget};
use pellucid_voxel::{Channels, MaterialTable};
use serde::{Deserialize, Serialize};

use crate::PrintError;

/// Most paths of a point and channel, and most points.
const MOST: u32 = 1 << 20;

/// How appearance is predicted inside the refinement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum PredictorKind {
    /// Monte Carlo path tracing.
    #[default]
    #[serde(rename = "mc")]
    MonteCarlo,
    /// The radiance-predicting neural network with paths that take its error out: with the weights that the library
    /// carries (feature `weights`), or with [`PrintSettings::weights`] (feature `rpnn`). For [`StrategyKind::Descent`]
    /// paths of all points are averaged over iterations, and the network tells what changed in between
    /// ([`Averaged`](pellucid_predict::Averaged)); for the others paths of some points tell the error of their neighbours
    /// ([`Corrected`](pellucid_predict::Corrected)).
    #[serde(rename = "rpnn")]
    Rpnn,
    /// Whichever is ahead on the object at hand, by trial: [`PrintJob::choose`](crate::PrintJob::choose); paths for
    /// [`StrategyKind::Descent`]. A job's record names what was chosen.
    #[serde(rename = "auto")]
    Auto,
}

impl PredictorKind {
    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::MonteCarlo => "mc",
            Self::Rpnn => "rpnn",
            Self::Auto => "auto",
        }
    }

    /// What a strategy takes of it: [`PredictorKind::Auto`] is decided without a trial for [`StrategyKind::Descent`], since
    /// a pass says nothing of what passes come to together.
    pub fn of(self, strategy: StrategyKind) -> Self {
        match (self, strategy) {
            (Self::Auto, StrategyKind::Descent) => Self::MonteCarlo,
            _ => self,
        }
    }
}

/// How materials are rearranged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum StrategyKind {
    /// Correct each surface voxel's own column, from the surface down: the method's paper, section 5.2; a quarter of the
    /// time.
    #[serde(rename = "surface-first")]
    SurfaceFirst,
    /// Follow the derivatives of a perceptual loss by the materials of every voxel, after a few steps of the other.
    #[default]
    #[serde(rename = "descent")]
    Descent,
    /// Move the colour of each surface voxel alone, for printers that take a textured model and mix inks by themselves:
    /// [`Prepared::write_texture`](crate::Prepared::write_texture).
    #[serde(rename = "surface-color")]
    SurfaceColor,
}

/// Where [`StrategyKind::Descent`] takes derivatives from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum GradientKind {
    /// A few paths of each point, walked twice: without bias.
    #[default]
    #[serde(rename = "paths")]
    Paths,
    /// The network (feature `rpnn`): without noise.
    #[serde(rename = "network")]
    Network,
}

impl StrategyKind {
    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::SurfaceFirst => "surface-first",
            Self::Descent => "descent",
            Self::SurfaceColor => "surface-color",
        }
    }

    /// Paths a point and channel that its predictions need, [`PrintSettings::spp`]; descent doubles them once its steps are to
    /// be fine, and again where much of the loss is noise.
    pub fn spp(self) -> u32 {
        match self {
            Self::SurfaceFirst | Self::SurfaceColor => 16,
            Self::Descent => 4,
        }
    }
}

/// Settings of a [`PrintJob`](crate::PrintJob). All of them are recorded in a print's manifest and report, and can be
/// read back from there; what is left to the strategy is recorded as it was used.
///
/// End a literal with `..PrintSettings::default()`: fields will be added. No cargo feature adds or changes one.
///
/// ```
/// use pellucid::PrintSettings;
/// let settings: PrintSettings = serde_json::from_str(r#"{ "scale": { "height_mm": 40.0 }, "seed": 7 }"#)?;
/// assert_eq!(settings.seed, 7);
/// assert_eq!(settings.spp, PrintSettings::default().spp);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PrintSettings {
    /// Print size; the model's own metres by default.
    pub scale: Scale,
    /// Printer: pitch, build space, palette.
    pub printer: PrintTarget,
    /// What slices are written as; those but PNG need the cargo feature of their name.
    #[serde(skip_serializing_if = "is_png")]
    pub format: Container,
    /// Print materials, over any channels; one is named `white`.
    pub materials: MaterialTable,
    /// Print what is see-through in clear resin: where the model's alpha lies below one half (or a glTF's `alphaCutoff`).
    /// Bodies that are see-through throughout become clear, and others 5 mm deep below their see-through places. It takes
    /// a model imported with [`ImportOptions::opacity`](pellucid_mesh::ImportOptions::opacity), and a printer with a
    /// material `clear`, which is added to the material table where that has none. Colours are those of the opaque
    /// voxels, seen as through air.
    #[serde(skip_serializing_if = "is_false")]
    pub clear_from_alpha: bool,
    /// Refractive index of the printed surface; 1 is index-matched.
    pub refractive_index: f64,
    /// The light that a print of many bands is looked at; R, G, B need none.
    pub illuminant: Illuminant,
    /// Further lights under which a print of many bands should look right too. What a colour should look like there
    /// follows from a smooth reflectance that has it under [`PrintSettings::illuminant`]; only
    /// [`StrategyKind::Descent`] heeds them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub also_under: Vec<Illuminant>,
    /// Aim at absolute colours instead of colours relative to the print's white.
    pub absolute: bool,
    /// Predictor of the refinement.
    pub predictor: PredictorKind,
    /// Weights for [`PredictorKind::Rpnn`]; the library's own without them. A record names them by their digest.
    #[serde(skip)]
    pub weights: Option<crate::NetworkWeights>,
    /// Paths a point and channel in each iteration: of every point, or of those that correct the network.
    /// [`StrategyKind::spp`] where `None`, which also says when descent takes more.
    pub spp: Option<u32>,
    /// How paths at some of the points correct the network.
    pub correction: Correction,
    /// Least share of the newest iteration in the mean of those whose paths take the network's error out at every point
    /// by itself, above 0 to 1.
    pub newest: f64,
    /// What neighbouring points share of the network's work; null for nothing.
    pub sharing: Option<Sharing>,
    /// Device that runs the network in candle (features `candle`, `cuda`, `metal`); this library's own kernels run it
    /// without one. Values differ in the last digits.
    pub device: Option<NetworkDevice>,
    /// Vector instructions; the best that the processor has without it. The path tracer's values do not depend on
    /// them, the network's do in the last digits.
    pub instruction_set: Option<InstructionSet>,
    /// Refinement: iterations, coloured depth and so on. Its seed is [`PrintSettings::seed`].
    pub refine: RefineSettings,
    /// Refine in sections along z, each so high in mm, at least [`PrintSettings::LEAST_SECTION_MM`], with what is around it:
    /// takes the memory of a section instead of that of the print, and more time, since what is around a section is
    /// predicted again. The result is about as good, and another one. As a whole without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub section_mm: Option<f64>,
    /// How materials are rearranged.
    pub strategy: StrategyKind,
    /// Settings of [`StrategyKind::SurfaceFirst`].
    pub surface_first: SurfaceFirst,
    /// Settings of [`StrategyKind::SurfaceColor`].
    pub surface_color: SurfaceColor,
    /// Settings of [`StrategyKind::Descent`].
    pub descent: Descent,
    /// Where it takes derivatives from.
    pub gradient: GradientKind,
    /// Mean number of paths a point and channel of [`GradientKind::Paths`] in each iteration, above 0, of three channels;
    /// more channels share as many paths in all. Doubled once steps are to be fine.
    pub gradient_spp: f32,
    /// Seed of everything random.
    pub seed: u64,
    /// What the judge traces.
    pub judge: Effort,
    /// Paths a point and channel in one of the judge's passes over every surface voxel.
    pub judge_spp: u32,
    /// Paths a point and channel in one of its passes over the points of per-voxel errors.
    pub judge_point_spp: u32,
    /// Longer edge of a proof picture in pixels.
    pub proof_edge: u32,
    /// What proof pictures show as white: the print's white, or a perfect one, beside which the print's own white is
    /// seen. Does not change the print.
    #[serde(skip_serializing_if = "is_relative")]
    pub proof_intent: RenderingIntent,
}

/// Records say nothing of what is the rule.
fn is_relative(intent: &RenderingIntent) -> bool {
    *intent == RenderingIntent::RelativeColorimetric
}

/// Records of PNG stacks do not say so, as before there were others.
fn is_png(format: &Container) -> bool {
    *format == Container::Png
}

/// Records of prints without clear parts do not say so, as before there were any.
fn is_false(value: &bool) -> bool {
    !value
}

impl Default for PrintSettings {
    fn default() -> Self {
        Self {
            scale: Scale::Native,
            printer: PrintTarget::j750(),
            format: Container::Png,
            materials: MaterialTable::cmykw(),
            clear_from_alpha: false,
            refractive_index: 1.5,
            illuminant: Illuminant::default(),
            also_under: Vec::new(),
            absolute: false,
            predictor: PredictorKind::default(),
            weights: None,
            spp: None,
            correction: Correction::default(),
            newest: 0.1,
            sharing: Some(Sharing::default()),
            device: None,
            instruction_set: None,
            refine: RefineSettings::default(),
            section_mm: None,
            strategy: StrategyKind::default(),
            surface_first: SurfaceFirst::default(),
            surface_color: SurfaceColor::default(),
            descent: Descent::default(),
            gradient: GradientKind::default(),
            gradient_spp: 2.0,
            seed: 0,
            judge: Effort::default(),
            judge_spp: 3,
            judge_point_spp: 1024,
            proof_edge: 480,
            proof_intent: RenderingIntent::default(),
        }
    }
}

impl PrintSettings {
    /// The least height of a section in mm.
    pub const LEAST_SECTION_MM: f64 = 1.0;

    /// Checks what does not need other crates' tables, and finds the label of white.
    pub(crate) fn check(&self) -> Result<u8, PrintError> {
        let spp = self.spp.unwrap_or(self.strategy.spp());
        for (field, value) in
            [("spp", spp), ("judge_spp", self.judge_spp), ("judge_point_spp", self.judge_point_spp)]
        {
            if !(1..=MOST).contains(&value) {
                return Err(PrintError::invalid(field, format!("{value}; 1 to {MOST} are possible")));
            }
        }
        if let (Some(device), PredictorKind::Rpnn | PredictorKind::Auto) = (self.device, self.predictor) {
            device.check()?;
        }
        if !(1.0..=3.0).contains(&self.refractive_index) {
            return Err(PrintError::invalid(
                "refractive_index",
                format!("{}; 1 (index-matched) to 3 are possible", self.refractive_index),
            ));
        }
        if let Some(set) = self.instruction_set {
            set.require().map_err(PrintError::Unsupported)?;
        }
        if !self.also_under.is_empty() {
            let bands = matches!(self.materials.spectrum(), Channels::Bands { count: 4.., .. });
            if !bands || self.strategy != StrategyKind::Descent {
                return Err(PrintError::invalid(
                    "also_under",
                    "further lights need materials of 4 or more bands, and the strategy descent",
                ));
            }
        }
        if self.clear_from_alpha && self.strategy == StrategyKind::SurfaceColor {
            return Err(PrintError::invalid(
                "clear_from_alpha",
                "a compensated texture has no clear parts; write slices, with another strategy",
            ));
        }
        if let Some(mm) = self.section_mm.filter(|mm| !(*mm >= Self::LEAST_SECTION_MM && mm.is_finite())) {
            let reason = format!("{mm} mm; at least {} are needed", Self::LEAST_SECTION_MM);
            return Err(PrintError::invalid("section_mm", reason));
        }
        self.refine.check()?;
        self.surface_first.check()?;
        self.surface_color.check()?;
        self.descent.check()?;
        self.judge.check()?;
        self.materials.label_of("white").ok_or_else(|| {
            PrintError::invalid("materials", "none is named \"white\", which fills the inside")
        })
    }
}
