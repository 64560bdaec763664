//! What a print job is asked to do.

use pellucid_mesh::voxelise::Scale;
use pellucid_refine::RefineSettings;
use pellucid_slice::PrintTarget;
use pellucid_trace::Boundary;
use pellucid_voxel::{MaterialTable, VoxelError};

/// How appearance is predicted inside the refinement loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PredictorKind {
    /// Monte Carlo path tracing.
    MonteCarlo,
    /// The radiance-predicting neural network, corrected by paths at some of the points: with the weights that the
    /// library carries (feature `weights`), or with `PrintSettings::weights` (feature `rpnn`).
    Rpnn,
}

impl PredictorKind {
    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::MonteCarlo => "mc",
            Self::Rpnn => "rpnn",
        }
    }
}

/// Settings of a [`PrintJob`](crate::PrintJob).
#[derive(Clone, Debug)]
pub struct PrintSettings {
    /// Print size; the model's own metres by default.
    pub scale: Scale,
    /// Printer: pitch, build space, palette.
    pub target: PrintTarget,
    /// Print materials; one is named `white`.
    pub materials: MaterialTable,
    /// Optical boundary of the printed surface.
    pub boundary: Boundary,
    /// Predictor of the loop: the network where the library carries its weights.
    pub predictor: PredictorKind,
    /// Weights for [`PredictorKind::Rpnn`] and what they were trained for; the library's own without them.
    #[cfg(feature = "rpnn")]
    pub weights: Option<std::sync::Arc<pellucid_rpnn::TrainedNetwork>>,
    /// Paths a point and channel in each iteration of the loop: of every point with
    /// [`PredictorKind::MonteCarlo`], of those that correct the network with [`PredictorKind::Rpnn`].
    pub spp: u32,
    /// Refinement: iterations, coloured depth and so on. Its seed is overridden by `seed`.
    pub refine: RefineSettings,
    /// Aim at absolute colours instead of colours relative to the print's white.
    pub absolute: bool,
    /// Seed of everything random.
    pub seed: u64,
    /// Surface voxels drawn for the error report.
    pub evaluation_points: u32,
    /// Paths a point and channel in the error report, even.
    pub evaluation_spp: u32,
    /// Paths a point and channel in the proof.
    pub proof_spp: u32,
    /// Longer edge of a proof picture in pixels.
    pub proof_edge: u32,
}

impl Default for PrintSettings {
    fn default() -> Self {
        Self {
            scale: Scale::Native,
            target: PrintTarget::j750(),
            materials: MaterialTable::cmykw(),
            boundary: Boundary::default(),
            predictor: match cfg!(feature = "weights") {
                true => PredictorKind::Rpnn,
                false => PredictorKind::MonteCarlo,
            },
            #[cfg(feature = "rpnn")]
            weights: None,
            spp: 16,
            refine: RefineSettings::default(),
            absolute: false,
            seed: 0,
            evaluation_points: 5_000,
            evaluation_spp: 2048,
            proof_spp: 64,
            proof_edge: 480,
        }
    }
}

impl PrintSettings {
    pub(crate) fn check(&self) -> Result<u8, VoxelError> {
        let counts = [
            ("spp", self.spp),
            ("evaluation points", self.evaluation_points),
            ("evaluation spp", self.evaluation_spp),
            ("proof spp", self.proof_spp),
        ];
        for (field, value) in counts {
            if !(1..=1 << 20).contains(&value) {
                return Err(VoxelError::invalid(field, format!("{value}; 1 to {} are possible", 1 << 20)));
            }
        }
        if self.evaluation_spp < 2 {
            return Err(VoxelError::invalid(
                "evaluation spp",
                "at least 2 are needed to estimate their noise",
            ));
        }
        if self.materials.channels() != 3 {
            return Err(VoxelError::unsupported(
                "materials",
                format!("{} channels; a print job needs linear R, G, B", self.materials.channels()),
            ));
        }
        self.materials.label_of("white").ok_or_else(|| {
            VoxelError::invalid("materials", "none is named \"white\", which fills the inside")
        })
    }
}
