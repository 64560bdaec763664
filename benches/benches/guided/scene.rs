//! A print as dense arrays, for a walk in double precision.

use pellucid::voxel::{Control, LabelGrid, MaterialTable, NearestSurface, Surface, SurfaceOptions};

use super::Error;

/// Depth in mm beyond which light is as good as isotropic, and nothing guides.
const DEPTH_MM: f64 = 3.0;
/// Bins of depth: so many in each doubling of depth plus 0.1 mm.
const A_DOUBLING: f64 = 4.0;
const FIRST_MM: f64 = 0.1;

/// Labels, and where the surface lies from every voxel.
pub struct Scene {
    pub name: String,
    size: [i64; 3],
    mm: [f64; 3],
    /// `[z][y][x]`, as all that follows; 0 is air.
    labels: Vec<u8>,
    /// Bin of depth below the surface; [`Scene::BEYOND`] where deeper than [`DEPTH_MM`].
    bins: Vec<u8>,
    /// Nearest surface voxel of voxels that have a bin.
    nearest: Vec<u32>,
    voxels: Vec<[u32; 3]>,
    /// Outward unit normals of surface voxels.
    normals: Vec<[f64; 3]>,
}

impl Scene {
    /// The bin that is none.
    pub const BEYOND: u8 = u8::MAX;

    /// Of labels.
    pub fn new(name: &str, grid: &LabelGrid, control: &Control<'_>) -> Result<Self, Error> {
        let surface = Surface::extract(grid, &SurfaceOptions::default(), control)?;
        let near = NearestSurface::build(grid, &surface, DEPTH_MM, control)?;
        let [sx, sy, sz] = grid.size().map(|s| s as usize);
        let mut labels = vec![0; sx * sy * sz];
        for (z, layer) in labels.chunks_exact_mut(sx * sy).enumerate() {
            grid.copy_layer(z as u32, layer)?;
        }
        let (mut bins, mut nearest) = (vec![Self::BEYOND; labels.len()], vec![0; labels.len()]);
        for tile in 0..grid.tiles().len() {
            for (voxel, point, distance) in near.entries(tile).filter(|entry| entry.2 <= DEPTH_MM) {
                let [x, y, z] = voxel.map(|v| v as usize);
                let at = (z * sy + y) * sx + x;
                bins[at] = bin(distance);
                nearest[at] = point;
            }
        }
        Ok(Self {
            name: name.to_owned(),
            size: grid.size().map(i64::from),
            mm: grid.frame().pitch().mm(),
            labels,
            bins,
            nearest,
            voxels: surface.voxels().to_vec(),
            normals: surface.normals().iter().map(|n| n.map(f64::from)).collect(),
        })
    }

    /// Number of depth bins.
    pub fn bins() -> usize {
        usize::from(bin(DEPTH_MM)) + 1
    }

    /// The depth in the middle of a bin.
    pub fn depth_mm(bin: usize) -> f64 {
        FIRST_MM * (((bin as f64 + 0.5) / A_DOUBLING).exp2() - 1.0)
    }

    /// So many surface voxels, spread evenly.
    pub fn some(&self, count: usize) -> Vec<usize> {
        (0..self.voxels.len()).step_by((self.voxels.len() / count).max(1)).collect()
    }

    /// Where paths of a surface voxel start, and along what: its centre, into the object.
    pub fn start(&self, point: usize) -> (Place, [f64; 3]) {
        let voxel = self.voxels[point].map(i64::from);
        (Place { voxel, position: voxel.map(|v| v as f64 + 0.5) }, self.normals[point].map(|n| -n))
    }

    fn at(&self, voxel: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.size[a]).contains(&voxel[a]));
        inside.then(|| ((voxel[2] * self.size[1] + voxel[1]) * self.size[0] + voxel[0]) as usize)
    }

    /// Label of a voxel, 0 outside.
    pub fn label(&self, voxel: [i64; 3]) -> usize {
        self.at(voxel).map_or(0, |at| usize::from(self.labels[at]))
    }

    /// Depth bin of a voxel, and the outward normal of the surface nearest to it.
    pub fn outward(&self, voxel: [i64; 3]) -> Option<(usize, [f64; 3])> {
        let at = self.at(voxel)?;
        let bin = self.bins[at];
        (bin != Self::BEYOND).then(|| (usize::from(bin), self.normals[self.nearest[at] as usize]))
    }

    /// Flies for `t` mm at most. On meeting air it stays in the last voxel and returns the axis of the face.
    pub fn fly(&self, place: &mut Place, direction: [f64; 3], mut t: f64) -> Option<usize> {
        let rate: [f64; 3] = std::array::from_fn(|a| direction[a] / self.mm[a]);
        loop {
            let time: [f64; 3] = std::array::from_fn(|a| {
                if rate[a] == 0.0 {
                    return f64::INFINITY;
                }
                let face = place.voxel[a] as f64 + if rate[a] > 0.0 { 1.0 } else { 0.0 };
                ((face - place.position[a]) / rate[a]).max(0.0)
            });
            let axis = (1..3).fold(0, |least, a| if time[a] < time[least] { a } else { least });
            let step = time[axis].min(t);
            for a in 0..3 {
                place.position[a] += rate[a] * step;
            }
            if time[axis] >= t {
                return None;
            }
            t -= step;
            let up = rate[axis] > 0.0;
            place.position[axis] = place.voxel[axis] as f64 + if up { 1.0 } else { 0.0 };
            let mut next = place.voxel;
            next[axis] += if up { 1 } else { -1 };
            if self.label(next) == 0 {
                return Some(axis);
            }
            place.voxel = next;
        }
    }
}

/// A point in a voxel, which is kept beside it: points on faces belong to either.
#[derive(Clone, Copy)]
pub struct Place {
    pub voxel: [i64; 3],
    /// In voxels.
    pub position: [f64; 3],
}

/// The bin of a depth.
fn bin(depth_mm: f64) -> u8 {
    (A_DOUBLING * (1.0 + depth_mm / FIRST_MM).log2()) as u8
}

/// Scattering, absorption and mean cosine by label, and the majorant, of a channel.
pub struct Optics {
    pub sigma_s: Vec<f64>,
    pub sigma_a: Vec<f64>,
    pub g: Vec<f64>,
    pub majorant: f64,
}

impl Optics {
    pub fn of(table: &MaterialTable, channel: usize) -> Self {
        let of = |value: &dyn Fn(&pellucid::voxel::Material) -> f32| -> Vec<f64> {
            std::iter::once(0.0).chain(table.materials().iter().map(|m| f64::from(value(m)))).collect()
        };
        let sigma_s = of(&|m| m.sigma_s[channel]);
        let sigma_a = of(&|m| m.sigma_a[channel]);
        let majorant = sigma_s.iter().zip(&sigma_a).map(|(s, a)| s + a).fold(0.0, f64::max);
        Self { g: of(&|m| m.g.at(channel)), sigma_s, sigma_a, majorant }
    }
}
