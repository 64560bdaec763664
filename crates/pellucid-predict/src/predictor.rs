//! The interface: settings that are shared, and one object under prediction.

use std::sync::Arc;

use pellucid_core::{Control, Team};
use pellucid_voxel::LabelGrid;

use crate::{Identity, Object, PredictError};

/// How appearance is predicted: settings only, shared between threads and jobs.
pub trait Predictor: Send + Sync {
    /// What a report records: name, settings, weights, instruction set.
    fn identity(&self) -> Identity;

    /// What can be asked about an object, before any work.
    ///
    /// # Errors
    /// [`PredictError`] naming what the predictor cannot do or was not made for.
    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError>;

    /// Takes up an object.
    ///
    /// # Errors
    /// As [`Predictor::supports`], or when the object's tables cannot be built.
    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError>;
}

/// One object under prediction; the only place with caches.
pub trait BoundPredictor: Send {
    /// Brings the labels up to date. The first call takes all of them, whatever `changed` says.
    ///
    /// # Errors
    /// [`PredictError`] when the labels lie in another frame, hold unknown labels, or `control` asks to stop. There
    /// are no labels then: nothing is predicted until an update succeeds, which takes all of them.
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError>;

    /// Writes the absolute radiance of `points` (positions in the object's surface) to `out`, laid out
    /// `[point][channel]`, values about 0 to 1.
    ///
    /// A function of object, labels, what was absorbed, point and draw alone: it may be repeated, cut into shards, and
    /// asked in any order, on any number of threads, with the same bytes. Predictors with random error draw other
    /// numbers for another draw, so that errors of successive passes average out.
    ///
    /// # Errors
    /// [`PredictError`] before the first update, when `out` has the wrong length, a point does not exist, or
    /// `control` asks to stop.
    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError>;

    /// Adds the derivative of `sum(d_radiance * radiance)` by the amount of each material in each voxel to `out`.
    /// `d_radiance` is `[point][channel]`. The amount is a volume fraction, and a mixture has the sums of its parts'
    /// coefficients; air gets nothing, as the shape stays.
    ///
    /// Linear in `d_radiance`: but for rounding, or on average over draws for a predictor with random error, where only
    /// a factor of plus or minus a power of two is exact. The same calls of [`MaterialGradient::add`] with the same bytes for any
    /// number of threads, and again when repeated.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`] by default; otherwise as [`BoundPredictor::predict`]. What was added before an
    /// error is part of the whole.
    fn pullback(
        &self,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let _ = (points, draw, d_radiance, out, control);
        Err(PredictError::unsupported("gradient", "this predictor has none"))
    }

    /// [`BoundPredictor::pullback`] as a member of a team, all of whom hold the same labels and ask for the same. Every member
    /// gets the calls of [`MaterialGradient::add`] that one alone would. By default each does all of the work.
    ///
    /// # Errors
    /// As [`BoundPredictor::pullback`]; [`PredictError::Cancelled`] also where another member was.
    fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let _ = team;
        self.pullback(points, draw, d_radiance, out, control)
    }

    /// Takes in what one pass learned, for the next. A pass is taken in once, however often it is handed over.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] when another predictor learned it.
    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        if learned.is_empty() {
            return Ok(());
        }
        Err(PredictError::invalid("learned values", "this predictor learns nothing"))
    }

    /// All that was absorbed so far, as one value: handed to [`BoundPredictor::absorb`] of a newly bound predictor it
    /// restores this one's memory.
    fn memory(&self) -> Learned {
        Learned::default()
    }
}

/// What changed since the last [`BoundPredictor::update`].
#[derive(Clone, Copy, Debug)]
pub enum Changed<'a> {
    /// Anything may have.
    Unknown,
    /// Nothing but these tiles: ascending positions in [`LabelGrid::tiles`].
    Tiles(&'a [u32]),
}

/// Which random numbers a prediction uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Draw {
    /// The job's seed.
    pub seed: u64,
    /// What the numbers are for.
    pub pass: Pass,
    /// How many times the samples that a predictor's settings name are drawn in a prediction or a gradient, at least 1: its
    /// variance falls in proportion. Predictors without random error take no notice.
    pub effort: u32,
}

impl Draw {
    /// Numbers of a seed and a pass, as many as settings name.
    pub const fn new(seed: u64, pass: Pass) -> Self {
        Self { seed, pass, effort: 1 }
    }

    /// The same with another effort; 0 is taken for 1.
    pub const fn with_effort(mut self, effort: u32) -> Self {
        self.effort = if effort == 0 { 1 } else { effort };
        self
    }
}

/// Passes that never share random numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Pass {
    /// An iteration of a refinement, 0 for the unrefined halftone; below 2^30.
    Loop(u32),
    /// One of the judge's independent parts; below 2^16.
    Judge(u32),
    /// A proof's pictures.
    Proof,
    /// The comparison that predictors are tried against.
    Trial,
    /// Derivatives in an iteration of a refinement; below 2^30.
    Gradient(u32),
    /// What an iteration of a refinement predicted, once more, to tell its noise; below 2^30.
    Repeat(u32),
}

impl Pass {
    /// The pass as a number; different passes have different ones.
    pub fn number(self) -> u32 {
        match self {
            Self::Loop(iteration) => iteration & 0x3fff_ffff,
            Self::Judge(part) => 0x4000_0000 | (part & 0xffff),
            Self::Proof => 0x4001_0000,
            Self::Trial => 0x4001_0001,
            Self::Gradient(iteration) => 0x8000_0000 | (iteration & 0x3fff_ffff),
            Self::Repeat(iteration) => 0xc000_0000 | (iteration & 0x3fff_ffff),
        }
    }
}

/// What a predictor can do for an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Capabilities {
    /// Values have random error, which differs from draw to draw.
    pub random: bool,
    /// [`BoundPredictor::pullback`] works.
    pub gradient: bool,
}

impl Capabilities {
    /// Of a predictor with or without random error, and without gradient.
    pub fn new(random: bool) -> Self {
        Self { random, gradient: false }
    }

    /// The same with a gradient.
    pub fn with_gradient(mut self) -> Self {
        self.gradient = true;
        self
    }
}

/// What is known of one prediction besides its values.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Diagnostics {
    /// Values (points times channels) around which coefficients lie outside what a network was trained for.
    pub outside_training: u64,
    /// Paths that this call traced.
    pub paths: u64,
    /// What the pass learned for the next.
    pub learned: Learned,
}

/// What a predictor learns from pass to pass, as plain numbers that can be saved with a job. Every shard of a pass
/// learns the same, so any one of them will do.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Learned {
    /// Who learned it: [`Identity::name`]; empty where there is nothing.
    pub predictor: String,
    /// The passes that it holds, by [`Pass::number`], ascending.
    pub passes: Vec<u32>,
    /// The numbers, laid out as the predictor likes.
    pub values: Vec<f64>,
    /// Further ones, of which there may be several a point, and single precision is enough.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub singles: Vec<f32>,
}

impl Learned {
    /// True where nothing was learned.
    pub fn is_empty(&self) -> bool {
        self.predictor.is_empty()
    }
}

/// Receives derivatives by the amount of a material in a voxel.
pub trait MaterialGradient {
    /// Adds to the derivative by the amount (volume fraction, 0 to 1) of `label` in `voxel`.
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32);

    /// Adds to the derivatives by every material in some voxels, none twice: `derivatives` is `[voxel][material]`, labels
    /// 1 and up. Unless overridden it calls [`MaterialGradient::add`] for each. A predictor may call either.
    fn add_rows(&mut self, voxels: &[[u32; 3]], derivatives: &[f32]) {
        let Some(materials) = derivatives.len().checked_div(voxels.len()) else { return };
        for (voxel, row) in voxels.iter().zip(derivatives.chunks_exact(materials.max(1))) {
            (1..=u8::MAX).zip(row).for_each(|(label, &derivative)| self.add(*voxel, label, derivative));
        }
    }

    /// The voxels that derivatives are wanted for, from the first `[x, y, z]` to before the last; the whole grid where
    /// `None`. No others are added.
    fn region(&self) -> Option<[[u32; 3]; 2]> {
        None
    }

    /// Whether derivatives are wanted for any voxel of a small box, from `first` to before `end`. A predictor may leave
    /// out work and memory for those that are not, or add to them all the same. The same answer every time.
    fn wants(&self, first: [u32; 3], end: [u32; 3]) -> bool {
        let _ = (first, end);
        true
    }
}

/// The radiance of every surface point, `[point][channel]`.
///
/// # Errors
/// As [`BoundPredictor::predict`].
pub fn predict_all(
    bound: &dyn BoundPredictor,
    object: &Object,
    draw: Draw,
    control: &Control<'_>,
) -> Result<(Vec<f32>, Diagnostics), PredictError> {
    let points = object.points();
    let mut out = vec![0.0; points.len() * object.channels()];
    let diagnostics = bound.predict(&points, draw, &mut out, control)?;
    Ok((out, diagnostics))
}

macro_rules! forward {
    ($($owner:ty),*) => {$(
        impl<P: Predictor + ?Sized> Predictor for $owner {
            fn identity(&self) -> Identity {
                (**self).identity()
            }

            fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
                (**self).supports(object)
            }

            fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
                (**self).bind(object)
            }
        }
    )*};
}

forward!(&P, Box<P>, Arc<P>);
