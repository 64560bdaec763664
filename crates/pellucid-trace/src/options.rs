//! What a caller chooses about an estimate.

use pellucid_core::InstructionSet;

use crate::TraceError;

/// How light passes the object's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Boundary {
    /// Index-matched: every path that reaches the surface leaves.
    Matched,
    /// A smooth dielectric surface: internal Fresnel reflection at the exit, no factor at entry.
    Dielectric(RefractiveIndex),
}

impl Boundary {
    /// A dielectric boundary; an index of exactly 1 is [`Boundary::Matched`].
    ///
    /// # Errors
    /// As [`RefractiveIndex::new`].
    pub fn with_index(index: f64) -> Result<Self, TraceError> {
        let index = RefractiveIndex::new(index)?;
        Ok(if index.get() == 1.0 { Self::Matched } else { Self::Dielectric(index) })
    }

    /// The refractive index inside the object over that outside.
    pub fn index(self) -> f64 {
        match self {
            Self::Matched => 1.0,
            Self::Dielectric(index) => index.get(),
        }
    }
}

impl Default for Boundary {
    /// A dielectric of index 1.5, which the measured materials imply.
    fn default() -> Self {
        Self::Dielectric(RefractiveIndex(1.5))
    }
}

/// Refractive index of the object over that of its surroundings, within 1..=4.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct RefractiveIndex(f64);

impl RefractiveIndex {
    /// Checks and wraps an index.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] outside 1..=4.
    pub fn new(index: f64) -> Result<Self, TraceError> {
        if (1.0..=4.0).contains(&index) {
            Ok(Self(index))
        } else {
            Err(TraceError::invalid("refractive index", format!("{index} must lie within 1 to 4")))
        }
    }

    /// The index.
    pub fn get(self) -> f64 {
        self.0
    }
}

/// How radiance is estimated.
///
/// ```
/// use pellucid_trace::{Boundary, TraceOptions};
/// let options = TraceOptions { spp: 16, seed: 7, ..TraceOptions::default() };
/// assert_eq!(options.boundary.index(), 1.5);
/// assert!(Boundary::with_index(0.5).is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceOptions {
    /// Paths per surface point and channel, at least 1.
    pub spp: u32,
    /// Seed of every random number.
    pub seed: u64,
    /// The object's surface.
    pub boundary: Boundary,
    /// Instruction set, or `None` for [`InstructionSet::chosen`]. All give the same bits.
    pub instruction_set: Option<InstructionSet>,
    /// Weight below which a path plays Russian roulette for weight 1, within 0..=1. Any value is
    /// unbiased; it trades variance for time.
    pub roulette: f32,
    /// Collision estimator in media of strong contrast.
    pub tracking: Tracking,
    /// Most neighbouring bands that share each path, 1 to 4; at most half of `spp`. Every band still has `spp` paths that
    /// count for it, for a fraction of the time; where bands differ much a path counts little for its neighbours.
    /// Channels that are no bands share none, nor do more than 256 paths.
    pub shared_bands: u32,
}

impl Default for TraceOptions {
    fn default() -> Self {
        Self {
            spp: 64,
            seed: 0,
            boundary: Boundary::default(),
            instruction_set: None,
            roulette: 0.6,
            tracking: Tracking::Auto,
            shared_bands: 4,
        }
    }
}

impl TraceOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for zero paths, a roulette threshold outside 0..=1, or shared bands outside 1..=4,
    /// [`TraceError::Unsupported`] for an instruction set that this processor lacks.
    pub fn check(&self) -> Result<(), TraceError> {
        if self.spp == 0 {
            return Err(TraceError::invalid("spp", "0 paths; ask for at least 1"));
        }
        if !(0.0..=1.0).contains(&self.roulette) {
            return Err(TraceError::invalid("roulette", format!("{} must lie within 0 to 1", self.roulette)));
        }
        if !(1..=4).contains(&self.shared_bands) {
            return Err(TraceError::invalid("shared_bands", format!("{} must be 1 to 4", self.shared_bands)));
        }
        if let Some(set) = self.instruction_set {
            set.require().map_err(TraceError::Unsupported)?;
        }
        Ok(())
    }
}

/// How free flights are sampled. Both are unbiased.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    /// Delta tracking, or regular tracking for a channel whose largest extinction is more than
    /// 16 times the smallest among the materials in use.
    Auto,
    /// Delta (Woodcock) tracking with one majorant a channel.
    Delta,
    /// Voxel by voxel with each voxel's own extinction: no null collisions, cost by the voxel.
    Regular,
}
