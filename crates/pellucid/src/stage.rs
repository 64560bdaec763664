//! The stages of a print job and their observer.

/// A step of the main job, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Stage {
    /// Reading the model.
    Import,
    /// Deciding which voxels are solid.
    Voxelise,
    /// Surface voxels and their normals.
    Surface,
    /// How thick the solid is below each surface voxel.
    Thickness,
    /// The nearest surface voxel of each voxel within the coloured depth.
    Nearest,
    /// Colours of the surface from the texture.
    Texture,
    /// Mixture and gamut tables, and the targets within their reach.
    Color,
    /// Materials for the colours, before any refinement.
    Halftone,
    /// Trying which predictor is ahead.
    Choose,
    /// The refinement: all its iterations.
    Refine,
    /// Judging the labels before and after by fresh paths.
    Judge,
    /// Predicting what given labels look like.
    Predict,
    /// Drawing the proof.
    Proof,
    /// Writing slices.
    Slices,
}

impl Stage {
    /// The stage's name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Import => "import",
            Stage::Voxelise => "voxelise",
            Stage::Surface => "surface",
            Stage::Thickness => "thickness",
            Stage::Nearest => "nearest surface",
            Stage::Texture => "texture",
            Stage::Color => "colour tables",
            Stage::Halftone => "halftone",
            Stage::Choose => "choice of predictor",
            Stage::Refine => "refine",
            Stage::Judge => "judge",
            Stage::Predict => "appearance",
            Stage::Proof => "proof",
            Stage::Slices => "slices",
        }
    }
}

/// Told what a job is doing. Methods may be called from worker threads; each does nothing unless it is written.
pub trait Observer: Sync {
    /// A stage begins.
    fn begin(&self, stage: Stage) {
        let _ = stage;
    }
    /// `done` of `total` units of the stage are finished; `done` may arrive out of order.
    fn progress(&self, stage: Stage, done: u64, total: u64) {
        let _ = (stage, done, total);
    }
    /// A stage ended.
    fn end(&self, stage: Stage) {
        let _ = stage;
    }
    /// Something the user should know, such as a hole in the mesh.
    fn warn(&self, message: &str) {
        let _ = message;
    }
}

/// An observer that ignores everything.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {}
