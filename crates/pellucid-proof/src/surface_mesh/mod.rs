//! A mesh over the surface voxels, as fine as a number of vertices allows.

mod cells;
mod clusters;

use pellucid_core::Control;
use pellucid_voxel::{LabelGrid, Surface};
use rayon::prelude::*;

use crate::ProofError;
use cells::Cells;
use clusters::Clusters;

/// Each further try takes cells by so much larger.
const COARSER: f64 = 1.1;

/// A mesh of the surface voxels for viewers: quads between vertices that each stand for the surface voxels about them.
///
/// Voxels are taken together in cells of whole voxels that are about as high as wide and deep, just large enough for the
/// number of vertices that is allowed. A quad stands where a cell with material meets one without; its corners move
/// to the mean of the surface nearby (surface nets, Gibson 1998), and take the mean of its values.
///
/// ```
/// use pellucid_proof::SurfaceMesh;
/// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 36])?;
/// let grid = LabelGrid::from_fn(frame, |_| 5);
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none())?;
/// let mesh = SurfaceMesh::build(&grid, &surface, 2000, &Control::none())?;
/// assert!(mesh.positions_mm().len() <= 2000);
/// let means = mesh.means(&vec![[0.5]; surface.len()])?;
/// assert!(means.iter().all(|v| (v[0] - 0.5).abs() < 1e-6));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SurfaceMesh {
    cell_voxels: [u32; 3],
    cell_mm: [f64; 3],
    positions_mm: Vec<[f32; 3]>,
    quads: Vec<[u32; 4]>,
    clusters: Clusters,
    points: usize,
}

impl SurfaceMesh {
    /// Builds the finest mesh of at most `most_vertices` (8 or more) vertices. `labels` and `surface` belong together.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for fewer vertices than a cube has, [`ProofError::Unsupported`] for more surface than a cell
    /// of the whole object would need, [`ProofError::Cancelled`].
    pub fn build(
        labels: &LabelGrid,
        surface: &Surface,
        most_vertices: usize,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        if most_vertices < 8 {
            return Err(ProofError::invalid("vertices", format!("{most_vertices}; a cube has 8")));
        }
        let pitch = labels.frame().pitch().mm();
        let most_mm = (0..3).map(|a| pitch[a] * f64::from(labels.size()[a])).fold(0.0, f64::max);
        // About as many vertices as quads, each as large as a side of a cell.
        let mut edge_mm = (area_mm2(labels, surface) / most_vertices as f64).sqrt();
        loop {
            control.check()?;
            let cell_voxels = pitch.map(|mm| ((edge_mm / mm).round() as u32).max(1));
            let cells = Cells::find(labels, surface, cell_voxels, control)?;
            if cells.corners.len() <= most_vertices {
                return Self::of_cells(&cells, surface, control);
            }
            if edge_mm > most_mm {
                let reason = format!("no cells are large enough for {most_vertices} vertices");
                return Err(ProofError::unsupported("surface", reason));
            }
            edge_mm = COARSER * edge_mm.max(pitch[0].min(pitch[1]).min(pitch[2]));
        }
    }

    fn of_cells(cells: &Cells, surface: &Surface, control: &Control<'_>) -> Result<Self, ProofError> {
        let clusters = Clusters::gather(cells, surface, control)?;
        let pitch = surface.frame().pitch().mm();
        let placed = |i: usize| {
            let mut sum = [0.0f64; 3];
            let points = clusters.of(i);
            for &point in points {
                let place = surface_place(surface, point, pitch);
                (0..3).for_each(|a| sum[a] += place[a]);
            }
            sum.map(|v| (v / points.len().max(1) as f64) as f32)
        };
        let positions_mm = (0..cells.corners.len()).into_par_iter().map(placed).collect();
        Ok(Self {
            cell_voxels: cells.voxels,
            cell_mm: std::array::from_fn(|a| f64::from(cells.voxels[a]) * pitch[a]),
            positions_mm,
            quads: cells.quads.clone(),
            clusters,
            points: surface.len(),
        })
    }

    /// Voxels along `[x, y, z]` that a cell takes together.
    pub fn cell_voxels(&self) -> [u32; 3] {
        self.cell_voxels
    }

    /// Edges `[x, y, z]` of a cell in mm.
    pub fn cell_mm(&self) -> [f64; 3] {
        self.cell_mm
    }

    /// Vertices in mm, in the labels' frame.
    pub fn positions_mm(&self) -> &[[f32; 3]] {
        &self.positions_mm
    }

    /// Quads by their vertices, counter-clockwise seen from outside.
    pub fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }

    /// Means at the vertices of what each surface voxel has: linear colours, thickness and so on.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for another number of values than surface voxels.
    pub fn means<const N: usize>(&self, values: &[[f32; N]]) -> Result<Vec<[f32; N]>, ProofError> {
        if values.len() != self.points {
            let reason = format!("{} values for {} surface voxels", values.len(), self.points);
            return Err(ProofError::invalid("surface values", reason));
        }
        let mean = |i: usize| {
            let points = self.clusters.of(i);
            let mut sum = [0.0f64; N];
            for &point in points {
                (0..N).for_each(|c| sum[c] += f64::from(values[point as usize][c]));
            }
            sum.map(|v| (v / points.len().max(1) as f64) as f32)
        };
        Ok((0..self.positions_mm.len()).into_par_iter().map(mean).collect())
    }
}

/// Where the surface lies about a surface voxel: from its centre along its normal to its side.
fn surface_place(surface: &Surface, point: u32, pitch: [f64; 3]) -> [f64; 3] {
    let (centre, normal) = (surface.position_mm(point), surface.normals()[point as usize]);
    let half = (0..3).map(|a| 0.5 * pitch[a] * f64::from(normal[a].abs())).fold(0.0, f64::max);
    std::array::from_fn(|a| centre[a] + half * f64::from(normal[a]))
}

/// Area of the voxels' faces that air touches.
fn area_mm2(labels: &LabelGrid, surface: &Surface) -> f64 {
    let [x, y, z] = labels.frame().pitch().mm();
    let face = [y * z, x * z, x * y];
    let exposed = |voxel: &[u32; 3]| {
        let mut faces = [0u64; 3];
        for (axis, faces) in faces.iter_mut().enumerate() {
            for step in [-1, 1] {
                let mut beside = voxel.map(i64::from);
                beside[axis] += step;
                *faces += u64::from(labels.at(beside) == pellucid_voxel::AIR);
            }
        }
        faces
    };
    let add = |a: [u64; 3], b: [u64; 3]| std::array::from_fn(|i| a[i] + b[i]);
    let faces = surface.voxels().par_iter().map(exposed).reduce(|| [0; 3], add);
    (0..3).map(|a| faces[a] as f64 * face[a]).sum()
}

#[cfg(test)]
mod tests;
