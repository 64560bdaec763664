//! The stages of a print job and their observer.

/// A step of the main job, in order. Refinement visits [`Stage::Refine`] once an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Stage {
    /// Reading the model.
    Import,
    /// Deciding which voxels are solid.
    Voxelise,
    /// Surface voxels and their normals.
    Surface,
    /// The nearest surface voxel of each voxel within the coloured depth.
    Nearest,
    /// Target colours from the texture.
    Target,
    /// Mixture and gamut tables.
    Color,
    /// One iteration of the refinement loop.
    Refine,
    /// Re-prediction of the error report and of the proof's colours.
    Evaluate,
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
            Stage::Nearest => "nearest surface",
            Stage::Target => "target colours",
            Stage::Color => "colour tables",
            Stage::Refine => "refine",
            Stage::Evaluate => "evaluate",
            Stage::Proof => "proof",
            Stage::Slices => "slices",
        }
    }
}

/// Told what a job is doing. Methods may be called from worker threads.
pub trait Observer: Sync {
    /// A stage begins.
    fn begin(&self, stage: Stage);
    /// `done` of `total` units of the stage are finished; `done` may arrive out of order.
    fn progress(&self, stage: Stage, done: u64, total: u64);
    /// A stage ended.
    fn end(&self, stage: Stage);
    /// Something the user should know, such as a hole in the mesh.
    fn warn(&self, message: &str);
}

/// An observer that ignores everything.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn begin(&self, _: Stage) {}
    fn progress(&self, _: Stage, _: u64, _: u64) {}
    fn end(&self, _: Stage) {}
    fn warn(&self, _: &str) {}
}
