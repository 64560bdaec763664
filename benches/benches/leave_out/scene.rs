//! The object that most shortcuts are measured on.

use std::sync::Arc;

use pellucid::predict::Object;
use pellucid::voxel::{
    Channels, Control, LabelGrid, Material, MaterialTable, Surface, SurfaceOptions, Tile, near_order,
};
use pellucid_benches::appearance::Error;
use pellucid_benches::solids::ball;

/// A ball with a halftoned skin.
pub struct Scene {
    /// Diameter in mm.
    pub mm: f64,
    /// Its labels.
    pub labels: LabelGrid,
    /// The same after a small step of a refinement: some voxels of every hundredth mixed tile.
    pub moved: LabelGrid,
    /// Which tiles changed, ascending.
    pub changed: Vec<u32>,
    /// Surface and materials.
    pub object: Arc<Object>,
    /// All points, neighbours after one another.
    pub near: Vec<u32>,
}

impl Scene {
    /// A ball of so many mm.
    pub fn new(mm: f64, control: &Control<'_>) -> Result<Self, Error> {
        let labels = ball(mm, 0.5);
        let mut moved = labels.clone();
        let [dx, dy, _] = labels.tile_dims();
        let changed = moved.update_tiles(|t, tile| match tile {
            Tile::Dense(labels) if (t[2] * dy * dx + t[1] * dx + t[0]) % 100 == 7 => {
                Some(Tile::Dense(Box::new(labels.map(|l| if l == 1 { 2 } else { l }))))
            }
            _ => None,
        });
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
        let near = near_order(surface.voxels());
        let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5)?);
        Ok(Self { mm, labels, moved, changed, object, near })
    }

    /// Its name.
    pub fn name(&self) -> String {
        format!("ball of {} mm", self.mm)
    }

    /// The default inks with `channels` channels that are all like the second, green.
    pub fn gray(channels: usize) -> Result<MaterialTable, Error> {
        let repeated = |m: &Material| Material {
            sigma_s: vec![m.sigma_s[1]; channels],
            sigma_a: vec![m.sigma_a[1]; channels],
            ..m.clone()
        };
        let materials = MaterialTable::cmykw().materials().iter().map(repeated).collect();
        let spectrum = match channels {
            3 => Channels::Rgb,
            count => Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: count as u32 },
        };
        Ok(MaterialTable::over(spectrum, materials)?)
    }
}
