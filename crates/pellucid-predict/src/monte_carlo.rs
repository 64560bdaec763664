//! Path tracing as a predictor.

use std::sync::Arc;

use pellucid_core::team::Alone;
use pellucid_core::{Control, InstructionSet, Team};
use pellucid_trace::{
    AdjointOptions, Boundary, Derivatives, TraceError, TraceOptions, Tracer, Tracking, Volume,
};
use pellucid_voxel::LabelGrid;

use crate::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, MaterialGradient, Object,
    PredictError, Predictor,
};

/// Predicts by unbiased path tracing, the same number of paths for every point and channel.
///
/// The draw's seed and pass choose the paths, so that errors of different passes are independent. Values are the same
/// on any processor.
///
/// ```
/// use std::sync::Arc;
/// use pellucid_predict::{Changed, Draw, MonteCarlo, Object, Pass, Predictor, predict_all};
/// use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
///
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [32, 16, 48]).unwrap();
/// let labels = LabelGrid::from_tiles(frame, |_| Tile::Constant(5)); // a block of white
/// let control = Control::none();
/// let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
/// let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap());
///
/// let mut bound = MonteCarlo::new(4).unwrap().bind(Arc::clone(&object)).unwrap();
/// bound.update(&labels, Changed::Unknown, &control).unwrap();
/// let (radiance, diagnostics) =
///     predict_all(&*bound, &object, Draw::new(7, Pass::Loop(0)), &control).unwrap();
/// assert_eq!(radiance.len(), object.surface().len() * 3);
/// assert_eq!(diagnostics.paths, radiance.len() as u64 * 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonteCarlo {
    /// Seed and boundary are filled in from the draw and the object.
    options: TraceOptions,
    adjoint: AdjointOptions,
    instruction_set: Option<InstructionSet>,
}

impl MonteCarlo {
    /// A predictor with `spp` paths a point and channel.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] for no paths.
    pub fn new(spp: u32) -> Result<Self, PredictError> {
        let options = TraceOptions { spp, ..TraceOptions::default() };
        Self { options, adjoint: AdjointOptions::default(), instruction_set: None }.checked()
    }

    /// The same with another weight, 0 to 1, below which paths play Russian roulette.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] outside that range.
    pub fn with_roulette(mut self, roulette: f32) -> Result<Self, PredictError> {
        self.options.roulette = roulette;
        self.checked()
    }

    /// The same with another way to sample free flights.
    pub fn with_tracking(mut self, tracking: Tracking) -> Self {
        self.options.tracking = tracking;
        self
    }

    /// The same with another number of neighbouring bands, 1 to 4, that share each path at most: see
    /// [`TraceOptions::shared_bands`].
    ///
    /// # Errors
    /// [`PredictError::Invalid`] outside that range.
    pub fn with_shared_bands(mut self, bands: u32) -> Result<Self, PredictError> {
        self.options.shared_bands = bands;
        self.checked()
    }

    /// The same with another mean number of paths a point and channel, above 0, that its gradient follows: by default
    /// 2, independent of those of the prediction. Points get as many as their weights deserve.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] outside 0 to 2^20.
    pub fn with_adjoint_paths(mut self, paths: f32) -> Result<Self, PredictError> {
        self.adjoint.paths = paths;
        self.checked()
    }

    /// The same with a gradient whose part by scattering is pooled over small boxes of voxels: less noise for the same
    /// paths, and no longer unbiased; see [`AdjointOptions::pooled`].
    pub fn with_pooled_adjoint(mut self) -> Self {
        self.adjoint.pooled = true;
        self
    }

    /// The same on other instructions than [`InstructionSet::chosen`]: no other values, another time.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`] where the processor lacks them.
    pub fn with_instruction_set(mut self, set: InstructionSet) -> Result<Self, PredictError> {
        self.instruction_set = Some(set.require().map_err(PredictError::Unsupported)?);
        self.checked()
    }

    /// Paths a point and channel.
    pub fn spp(&self) -> u32 {
        self.options.spp
    }

    /// What [`Tracer`] is given for an object and a seed; its iteration is [`Pass::number`](crate::Pass::number).
    ///
    /// # Errors
    /// None that [`Object::new`] lets through.
    pub fn trace_options(&self, object: &Object, seed: u64) -> Result<TraceOptions, PredictError> {
        let boundary = Boundary::with_index(object.refractive_index())?;
        Ok(TraceOptions { seed, boundary, instruction_set: Some(self.used()), ..self.options })
    }

    fn used(&self) -> InstructionSet {
        self.instruction_set.unwrap_or_else(InstructionSet::chosen)
    }

    fn checked(self) -> Result<Self, PredictError> {
        self.options.check()?;
        self.adjoint.check()?;
        Ok(self)
    }
}

impl Predictor for MonteCarlo {
    fn identity(&self) -> Identity {
        Identity::new("mc", self.used(), true)
            .with("spp", self.options.spp)
            .with("roulette", self.options.roulette)
            .with("shared-bands", self.options.shared_bands)
            .with("adjoint-paths", self.adjoint.paths)
            .with("adjoint-pooled", self.adjoint.pooled)
            .with("tracking", format!("{:?}", self.options.tracking).to_lowercase())
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        self.trace_options(object, 0)?;
        Ok(Capabilities::new(true).with_gradient())
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        self.supports(&object)?;
        Ok(Box::new(BoundMonteCarlo { settings: *self, object, volume: None, current: false }))
    }
}

struct BoundMonteCarlo {
    settings: MonteCarlo,
    object: Arc<Object>,
    /// Built of the first labels; later ones are set.
    volume: Option<Volume>,
    /// The volume holds the labels of the last update.
    current: bool,
}

impl BoundPredictor for BoundMonteCarlo {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let same = std::mem::take(&mut self.current) && matches!(changed, Changed::Tiles([]));
        self.object.check_labels(labels)?;
        control.check()?;
        if !same {
            let silent = control.silent();
            // Another shape than before is for a new volume to refuse: it names the voxel.
            let set = self.volume.as_mut().map(|volume| volume.set_labels(labels, &silent));
            match set {
                Some(Err(TraceError::Invalid(_))) | None => {
                    self.volume = Some(Volume::new(labels, self.object.surface(), &silent)?);
                }
                Some(set) => set?,
            }
        }
        if let Some(volume) = &self.volume {
            // Refuses labels without a material.
            Tracer::new(volume, self.object.materials(), self.settings.trace_options(&self.object, 0)?)?;
        }
        self.current = true;
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let spp = self.settings.options.spp.saturating_mul(draw.effort.max(1));
        let tracer = self.tracer(points, draw, spp, out.len(), control)?;
        tracer.radiance(points, draw.pass.number(), out, control)?;
        let paths = out.len() as u64 * u64::from(spp);
        Ok(Diagnostics { paths, ..Diagnostics::default() })
    }

    /// Unbiased unless pooled, by paths that are independent of the prediction's with the same draw.
    fn pullback(
        &self,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.pullback_in(&Alone, points, draw, d_radiance, out, control)
    }

    /// Each member follows some of the paths.
    fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let spp = self.settings.options.spp;
        let tracer = self.tracer(points, draw, spp, d_radiance.len(), control)?;
        let mut adjoint = self.settings.adjoint;
        adjoint.paths *= draw.effort.max(1) as f32;
        let pass = draw.pass.number();
        tracer.pullback_in(team, points, pass, d_radiance, &adjoint, &mut Handed(out), control)?;
        Ok(())
    }
}

impl BoundMonteCarlo {
    /// The tracer of a draw, with so many paths a point and channel, once what it is asked for was checked.
    fn tracer(
        &self,
        points: &[u32],
        draw: Draw,
        spp: u32,
        values: usize,
        control: &Control<'_>,
    ) -> Result<Tracer<'_>, PredictError> {
        let volume = self.volume.as_ref().filter(|_| self.current).ok_or_else(PredictError::before_update)?;
        self.object.check_points(points, values)?;
        control.check()?;
        let options = TraceOptions { spp, ..self.settings.trace_options(&self.object, draw.seed)? };
        Ok(Tracer::new(volume, self.object.materials(), options)?)
    }
}

/// Hands the tracer's derivatives on.
struct Handed<'a>(&'a mut dyn MaterialGradient);

impl Derivatives for Handed<'_> {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.0.add(voxel, label, derivative);
    }

    fn add_rows(&mut self, voxels: &[[u32; 3]], derivatives: &[f32]) {
        self.0.add_rows(voxels, derivatives);
    }

    fn region(&self) -> Option<[[u32; 3]; 2]> {
        self.0.region()
    }

    fn wants(&self, first: [u32; 3], end: [u32; 3]) -> bool {
        self.0.wants(first, end)
    }
}

impl From<TraceError> for PredictError {
    fn from(error: TraceError) -> Self {
        match error {
            TraceError::Cancelled => Self::Cancelled,
            TraceError::Invalid(fault) => Self::Invalid(fault),
            TraceError::Unsupported(fault) => Self::Unsupported(fault),
            other => Self::failed("mc", other),
        }
    }
}
