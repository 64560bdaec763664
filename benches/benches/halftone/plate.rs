//! White plates in any direction with a skin of one mixture on the upper face.

use pellucid::voxel::{Frame, LabelGrid, Pitch, Surface};
use pellucid_benches::appearance::Error;

/// Label of white.
pub const WHITE: u8 = 5;
/// Half the thickness, and half the edge, in mm.
const HALF_MM: [f64; 2] = [0.8, 2.2];
/// Depth of the skin in mm.
const SKIN_MM: f64 = 0.5;
/// Half the edge in mm of what is looked at, and of what is predicted for that.
const SEEN_MM: f64 = 1.2;
const PREDICTED_MM: f64 = 1.8;

/// A plate.
pub struct Plate {
    pub name: &'static str,
    pub frame: Frame,
    /// Unit vectors: along the plate, and its normal.
    axes: [[f64; 3]; 3],
}

impl Plate {
    /// Plates that look along z, x, y, and between.
    pub fn all() -> Result<Vec<Self>, Error> {
        let between = 1.0 / 3f64.sqrt();
        [
            ("layers' face", [0.0, 0.0, 1.0]),
            ("side along y", [1.0, 0.0, 0.0]),
            ("side along x", [0.0, 1.0, 0.0]),
            ("15 degrees off the layers", [0.2588, 0.0, 0.9659]),
            ("oblique", [between; 3]),
        ]
        .into_iter()
        .map(|(name, normal)| Self::new(name, normal))
        .collect()
    }

    fn new(name: &'static str, normal: [f64; 3]) -> Result<Self, Error> {
        let helper = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let u = unit(cross(normal, helper));
        let axes = [u, cross(normal, u), normal];
        let half: [f64; 3] = std::array::from_fn(|a| {
            HALF_MM[1] * (axes[0][a].abs() + axes[1][a].abs()) + HALF_MM[0] * axes[2][a].abs()
        });
        let pitch = Pitch::j750();
        let size = std::array::from_fn(|a| (2.0 * half[a] / pitch.mm()[a]).ceil() as u32 + 2);
        let origin = std::array::from_fn(|a| -half[a] - pitch.mm()[a]);
        Ok(Self { name, frame: Frame::new(origin, pitch, size)?, axes })
    }

    /// Coordinates of a voxel along the axes, in mm.
    fn along(&self, voxel: [u32; 3]) -> [f64; 3] {
        let p = self.frame.centre_mm(voxel.map(i64::from));
        self.axes.map(|axis| (0..3).map(|a| axis[a] * p[a]).sum())
    }

    fn solid(&self, voxel: [u32; 3]) -> bool {
        let [u, v, n] = self.along(voxel);
        n.abs() < HALF_MM[0] && u.abs() < HALF_MM[1] && v.abs() < HALF_MM[1]
    }

    /// Tells whether a voxel belongs to the skin.
    pub fn in_skin(&self, voxel: [u32; 3]) -> bool {
        self.solid(voxel) && HALF_MM[0] - self.along(voxel)[2] < SKIN_MM
    }

    /// The plate, its skin's labels as told.
    pub fn labels(&self, skin: impl Fn([u32; 3]) -> u8 + Sync) -> LabelGrid {
        LabelGrid::from_fn(self.frame, |voxel| match self.solid(voxel) {
            false => 0,
            true if self.in_skin(voxel) => skin(voxel),
            true => WHITE,
        })
    }

    /// Voxels of the skin.
    pub fn skin_voxels(&self) -> usize {
        let [sx, sy, sz] = self.frame.size();
        let all = (0..sz).flat_map(|z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])));
        all.filter(|&voxel| self.in_skin(voxel)).count()
    }

    /// Surface voxels of the upper face that are predicted, and whether each is looked at.
    pub fn upper(&self, surface: &Surface) -> Vec<(u32, bool)> {
        let up =
            |normal: &[f32; 3]| (0..3).map(|a| f64::from(normal[a]) * self.axes[2][a]).sum::<f64>() > 0.7;
        let points = (0..).zip(surface.voxels().iter().zip(surface.normals()));
        let upper = points.filter(|(_, (_, normal))| up(normal)).filter_map(|(point, (&voxel, _))| {
            let [u, v, n] = self.along(voxel);
            let edge = u.abs().max(v.abs());
            (n > 0.0 && edge < PREDICTED_MM).then_some((point, edge < SEEN_MM))
        });
        upper.collect()
    }

    /// Where a voxel is seen from above, in mm along the plate.
    pub fn seen_at(&self, voxel: [u32; 3]) -> [f64; 2] {
        let [u, v, _] = self.along(voxel);
        [u, v]
    }

    /// Half the edge in mm of what is looked at.
    pub fn half_seen_mm() -> f64 {
        SEEN_MM
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let norm = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / norm)
}
