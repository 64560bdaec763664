//! An object made ready for tracing.

use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Surface};
use rayon::prelude::*;

use crate::bricks::{BRICK, Bricks, MARGIN, SHARED};
use crate::clearance::Clearance;
use crate::{TraceError, march};

/// Where the smooth normals of surface voxels are: per brick with surface voxels, which voxels
/// have one and where the first is.
pub(crate) struct Normals {
    mask: Vec<u64>,
    first: Vec<u32>,
    normals: Vec<[f32; 3]>,
}

/// Where a surface point's paths start: a position in voxels, margin included, and a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Start {
    pub(crate) position: [f32; 3],
    pub(crate) direction: [f32; 3],
    /// Byte of the voxel at the position.
    pub(crate) byte: u8,
}

/// A label grid with its surface, arranged for the tracer's look-ups.
///
/// Building costs some tens of nanoseconds a solid voxel near the surface or of mixed material;
/// [`Volume::set_labels`] is cheaper, for a grid whose materials changed but not its shape.
pub struct Volume {
    frame: Frame,
    clearance: Clearance,
    bricks: Bricks,
    normals: Normals,
    voxels: Vec<[u32; 3]>,
    outward: Vec<[f32; 3]>,
}

impl Volume {
    /// Prepares a grid and its surface. Where the surface is of some layers alone, paths leave the others by the voxels'
    /// faces.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] when the surface lies in another frame or its voxels are not those
    /// of the grid's surface; [`TraceError::Unsupported`] past 15 materials in use or 2^29 bricks of 64 voxels;
    /// [`TraceError::Cancelled`].
    pub fn new(grid: &LabelGrid, surface: &Surface, control: &Control<'_>) -> Result<Self, TraceError> {
        if surface.frame() != grid.frame() {
            return Err(TraceError::invalid(
                "surface",
                "lies in another frame than the grid; extract it from this grid",
            ));
        }
        if let Some(v) = surface.voxels().iter().find(|v| grid.at(v.map(i64::from)) == 0) {
            return Err(stale(format!("voxel {v:?} is air in the grid")));
        }
        control.check()?;
        let clearance = Clearance::build(grid);
        control.check()?;
        let bricks = Bricks::build(grid, &clearance)?;
        control.check()?;
        let normals = Normals::build(&bricks, surface);
        check_surface(&bricks, &normals, surface)?;
        control.check()?;
        Ok(Self {
            frame: *grid.frame(),
            clearance,
            bricks,
            normals,
            voxels: surface.voxels().to_vec(),
            outward: surface.normals().to_vec(),
        })
    }

    /// Takes over new materials from a grid whose solid voxels are those this volume was built of.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] when the grid lies in another frame or its solid voxels differ,
    /// otherwise as [`Volume::new`]. The volume is unchanged after an error.
    pub fn set_labels(&mut self, grid: &LabelGrid, control: &Control<'_>) -> Result<(), TraceError> {
        if *grid.frame() != self.frame {
            return Err(TraceError::invalid("label grid", "lies in another frame; build a new volume"));
        }
        control.check()?;
        let bricks = Bricks::build(grid, &self.clearance)?;
        if !bricks.same_shape(&self.bricks) {
            return Err(TraceError::invalid("label grid", "its solid voxels differ; build a new volume"));
        }
        self.bricks = bricks;
        Ok(())
    }

    /// Where the volume lies.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Number of surface points.
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// True when there is no surface point.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// Bytes held by bricks, table and surface.
    pub fn memory_bytes(&self) -> usize {
        self.bricks.table.len() * 4
            + self.bricks.pool.len() * 64
            + self.voxels.len() * 36
            + self.normals.mask.len() * 12
    }

    /// Labels in use, by position in the palette; position 0 is air.
    pub(crate) fn palette(&self) -> &[u8] {
        &self.bricks.palette.labels
    }

    /// Edges of a voxel in mm.
    #[inline(always)]
    pub(crate) fn mm(&self) -> [f64; 3] {
        self.frame.pitch().mm()
    }

    pub(crate) fn bricks(&self) -> &Bricks {
        &self.bricks
    }

    /// Distance in mm that is free of air about a voxel, by clearance class.
    pub(crate) fn radii_mm(&self) -> &[f32; 16] {
        &self.clearance.radii_mm
    }

    /// Smooth outward normal of a voxel at a position that counts the margin.
    #[inline(always)]
    pub(crate) fn normal(&self, v: [u32; 3]) -> Option<[f32; 3]> {
        let (brick, local) = self.bricks.locate(v);
        self.normals.get(brick.wrapping_sub(SHARED), local)
    }

    /// Where paths of a surface point start: where the ray from the voxel's centre along the
    /// normal leaves the object, so that voxels add no depth.
    pub(crate) fn start(&self, point: u32) -> Start {
        let v = self.voxels[point as usize].map(|c| c + MARGIN);
        let n = self.outward[point as usize];
        let position = march::surface_position(&self.bricks, self.mm(), v, n);
        Start { position, direction: n.map(|c| -c), byte: self.bricks.byte(march::voxel(position)) }
    }

    /// Centre of a surface point's voxel in mm from the frame's origin.
    pub(crate) fn point_mm(&self, point: u32) -> [f64; 3] {
        let mm = self.mm();
        let v = self.voxels[point as usize];
        std::array::from_fn(|a| (f64::from(v[a]) + 0.5) * mm[a])
    }

    /// Checks that every label in use has a material.
    pub(crate) fn check_materials(&self, materials: &MaterialTable) -> Result<(), TraceError> {
        match self.palette()[1..].iter().find(|&&l| materials.get(l).is_none()) {
            Some(label) => Err(TraceError::invalid(
                "label grid",
                format!("label {label} has no material among the table's {}", materials.len()),
            )),
            None => Ok(()),
        }
    }
}

/// A surface that is not the grid's: without a normal paths could not leave where they should.
fn stale(what: String) -> TraceError {
    TraceError::invalid("surface", format!("{what}; it is stale: extract it anew from this grid"))
}

/// Tells whether the solid voxels with air on one of their six sides are those that have normals, in the layers that the
/// surface lists.
fn check_surface(bricks: &Bricks, normals: &Normals, surface: &Surface) -> Result<(), TraceError> {
    let exposed = |v: [u32; 3]| {
        (0..6).any(|side| {
            let mut beside = v;
            beside[side / 2] = if side % 2 == 0 { v[side / 2] - 1 } else { v[side / 2] + 1 };
            bricks.byte(beside) == 0
        })
    };
    // Outside these there may be others, and where a section cuts the solid there are others.
    let listed = surface.listed_layers();
    let listed = listed.start + MARGIN..listed.end + MARGIN;
    let [nx, ny, _] = bricks.dims.map(|d| d as usize);
    // Voxels with air beside them are of clearance class 0, and their bricks in the surface's part of the pool.
    let (count, missing) = bricks
        .table
        .par_iter()
        .enumerate()
        .filter(|(_, brick)| (SHARED..SHARED + bricks.surface).contains(brick))
        .map(|(i, &brick)| {
            let corner = [i % nx, i / nx % ny, i / nx / ny].map(|c| (c * BRICK) as u32);
            let (mut count, mut missing) = (0, None);
            for local in 0..64u32 {
                let byte = bricks.pool[brick as usize].0[(local / 4) as usize] >> (8 * (local % 4)) & 0xff;
                let v = [corner[0] + local % 4, corner[1] + local / 4 % 4, corner[2] + local / 16];
                if byte == 0 || byte >> 4 != 0 || !listed.contains(&v[2]) || !exposed(v) {
                    continue;
                }
                count += 1;
                if missing.is_none() && normals.get(brick - SHARED, local).is_none() {
                    missing = Some([v[2], v[1], v[0]]);
                }
            }
            (count, missing)
        })
        .reduce(|| (0, None), |a: (usize, _), b| (a.0 + b.0, a.1.into_iter().chain(b.1).min()));
    if let Some(v) = missing {
        let voxel = [v[2], v[1], v[0]].map(|c| c - MARGIN);
        return Err(stale(format!("voxel {voxel:?} has air beside it and is not listed")));
    }
    if count == surface.len() {
        return Ok(());
    }
    let inner = surface.voxels().iter().find(|v| !exposed(v.map(|c| c + MARGIN)));
    Err(stale(format!("voxel {:?} has no air beside it", inner.copied().unwrap_or_default())))
}

impl Normals {
    fn build(bricks: &Bricks, surface: &Surface) -> Self {
        let count = bricks.surface as usize;
        let place = |v: &[u32; 3]| {
            let (brick, local) = bricks.locate(v.map(|c| c + MARGIN));
            (brick.wrapping_sub(SHARED) as usize, local)
        };
        let mut mask = vec![0u64; count];
        for v in surface.voxels() {
            let (brick, local) = place(v);
            if let Some(m) = mask.get_mut(brick) {
                *m |= 1 << local;
            }
        }
        let mut first = Vec::with_capacity(count);
        let mut total = 0;
        for m in &mask {
            first.push(total);
            total += m.count_ones();
        }
        let mut normals = vec![[0.0; 3]; total as usize];
        for (v, n) in surface.voxels().iter().zip(surface.normals()) {
            let (brick, local) = place(v);
            if let Some(m) = mask.get(brick) {
                normals[(first[brick] + (m & ((1 << local) - 1)).count_ones()) as usize] = *n;
            }
        }
        Self { mask, first, normals }
    }

    #[inline(always)]
    fn get(&self, brick: u32, local: u32) -> Option<[f32; 3]> {
        let mask = *self.mask.get(brick as usize)?;
        let bit = 1u64 << local;
        if mask & bit == 0 {
            return None;
        }
        let at = self.first[brick as usize] + (mask & (bit - 1)).count_ones();
        Some(self.normals[at as usize])
    }
}
