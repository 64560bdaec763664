//! What a refinement asks of an appearance predictor.

use pellucid_voxel::{Control, LabelGrid, MaterialTable, Surface};

use crate::PredictError;

/// A print as a predictor sees it.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// One material label a voxel.
    pub grid: &'a LabelGrid,
    /// The grid's surface voxels and their outward normals.
    pub surface: &'a Surface,
    /// The coefficients of the labels.
    pub materials: &'a MaterialTable,
}

/// Predicts the diffuse appearance of a print at its surface points: a path tracer, a network, or
/// a mock in a test. One call predicts one state of the labels.
pub trait AppearancePredictor {
    /// A short name for reports, such as `mc` or `rpnn`.
    fn name(&self) -> &str;

    /// Writes the absolute radiance of `points` (indices into `scene.surface`) to `out`, laid out
    /// `[point][channel]` with `scene.materials.channels()` channels, values about 0..1.
    ///
    /// A predictor with random error draws fresh numbers for each `iteration` (0 is the unrefined
    /// halftone), so that errors of successive calls are independent and average out; the same
    /// iteration gives the same values.
    ///
    /// # Errors
    /// [`PredictError`] when the scene is not one the predictor handles, when `out` has the wrong
    /// length, or when `control` asks to stop.
    fn predict(
        &mut self,
        scene: &Scene<'_>,
        points: &[u32],
        iteration: u32,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), PredictError>;

    /// Told before [`AppearancePredictor::predict`] which tiles of the grid changed since the last
    /// prediction (ascending positions in [`LabelGrid::tiles`]), so that tables over the grid may
    /// be rebuilt in part. Not called before the first prediction. Does nothing by default.
    fn tiles_changed(&mut self, tiles: &[u32]) {
        let _ = tiles;
    }
}
