//! What a suite is run on.

use std::sync::Arc;

use pellucid_voxel::{
    AIR, Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, TILE,
    TILE_VOXELS, Tile, VoxelError,
};

use crate::{Object, PredictError};

/// Neighbours among a case's points.
const RUN: usize = 8;

/// An object, its labels, and the points that most checks predict.
#[derive(Clone, Debug)]
pub struct Case {
    /// The object.
    pub object: Arc<Object>,
    /// Its labels.
    pub labels: LabelGrid,
    /// Points in ascending order; a few hundred are enough.
    pub points: Vec<u32>,
}

impl Case {
    /// A case of an object's labels, which predicts at about `points` of its surface voxels.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] when the labels lie in another frame, or the object has one material or fewer than 16
    /// surface voxels: there would be nothing to change or to cut in parts.
    pub fn new(object: Arc<Object>, labels: LabelGrid, points: usize) -> Result<Self, PredictError> {
        object.check_labels(&labels)?;
        let count = object.surface().len();
        if object.materials().len() < 2 || count < 16 {
            return Err(PredictError::invalid(
                "case",
                format!(
                    "{} materials and {count} surface voxels; 2 and 16 at least",
                    object.materials().len()
                ),
            ));
        }
        // Runs of neighbours, as predictors may share work among them.
        let one_in = count / points.clamp(16, count);
        let chosen = (0..count as u32).filter(|&p| (p as usize / RUN).is_multiple_of(one_in));
        Ok(Self { points: chosen.collect(), object, labels })
    }

    /// A block of five mixed materials with a notch and air around it, over several tiles, at the J750's pitch with
    /// refractive index 1.5. No two of its `channels` are alike.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`] past [`MaterialTable::MAX_CHANNELS`].
    pub fn planted(channels: usize) -> Result<Self, PredictError> {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [21, 22, 38])?;
        let labels = labelled(frame, |[x, y, z]| {
            let inside = (9..19).contains(&x) && (12..20).contains(&y) && (10..36).contains(&z);
            let notch = x > 15 && y > 16;
            if inside && !notch { 1 + ((x * 7 + y * 5 + z / 2 * 3) % 11 % 5) as u8 } else { AIR }
        });
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none())?;
        let object = Object::new(surface, materials(channels)?, 1.5)?;
        Self::new(Arc::new(object), labels, 120)
    }

    /// Labels of the same shape that differ in every third tile, from tile `first` on: every solid voxel's material is
    /// the next one. With the tiles that changed.
    pub(super) fn changed(&self, labels: &LabelGrid, first: u32) -> (LabelGrid, Vec<u32>) {
        let materials = self.object.materials().len() as u8;
        let next = |label: u8| if label == AIR { AIR } else { label % materials + 1 };
        let [nx, ny, _] = labels.tile_dims();
        let mut new = labels.clone();
        let tiles = new.update_tiles(|[x, y, z], tile| {
            let place = (z * ny + y) * nx + x;
            match tile {
                _ if place % 3 != first % 3 => None,
                Tile::Constant(AIR) => None,
                Tile::Constant(label) => Some(Tile::Constant(next(*label))),
                Tile::Dense(labels) => Some(Tile::Dense(Box::new(labels.map(next)))),
            }
        });
        (new, tiles)
    }
}

/// A grid from a label for every voxel.
fn labelled(frame: Frame, label: impl Fn([u32; 3]) -> u8 + Sync) -> LabelGrid {
    LabelGrid::from_tiles(frame, |tile| {
        let mut labels = Box::new([AIR; TILE_VOXELS]);
        for (i, value) in labels.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            *value = label(std::array::from_fn(|a| tile[a] * TILE as u32 + local[a] as u32));
        }
        Tile::Dense(labels)
    })
}

/// Five materials from dark to bright whose coefficients differ from channel to channel, 1/mm.
fn materials(channels: usize) -> Result<MaterialTable, VoxelError> {
    let material = |m: usize| {
        let along = |c: usize| (c + 1) as f64 / (channels + 1) as f64;
        let albedo: Vec<f64> =
            (0..channels).map(|c| 0.3 + 0.69 * (along(c) * (m as f64 + 1.3)).fract().sqrt()).collect();
        let extinction: Vec<f64> = (0..channels).map(|c| 4.0 + 2.0 * m as f64 + 3.0 * along(c)).collect();
        Material::from_albedo(&format!("material {m}"), &albedo, &extinction, 0.4)
    };
    MaterialTable::new((0..channels).map(|c| format!("band {c}")).collect(), (0..5).map(material).collect())
}
