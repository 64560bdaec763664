//! Objects of the tracer's study.

use std::error::Error;

use pellucid::trace::Volume;
use pellucid::voxel::{Control, LabelGrid, Surface, SurfaceOptions};

/// An object and the points at which it is judged.
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) what: &'static str,
    pub(super) volume: Volume,
    /// A connected part of the surface, for estimators that share between points.
    pub(super) patch: Vec<u32>,
    /// Every so manieth point of the patch, at which errors are taken.
    pub(super) judged: Vec<usize>,
}

pub(super) fn scene(
    name: &'static str,
    what: &'static str,
    grid: &LabelGrid,
    control: &Control<'_>,
) -> Result<Scene, Box<dyn Error>> {
    let surface = Surface::extract(grid, &SurfaceOptions::default(), control)?;
    let volume = Volume::new(grid, &surface, control)?;
    // A cap of 2 mm radius about the point farthest along (1, 0.5, 2).
    let frame = grid.frame();
    let position = |i: usize| frame.centre_mm(surface.voxels()[i].map(i64::from));
    let along = |i: usize| {
        let p = position(i);
        let n = surface.normals()[i];
        p[2] * 2.0 + p[0] + 0.5 * p[1] + f64::from(n[2])
    };
    let flat = frame.size()[2] < 100;
    let top = if flat {
        let s = frame.size();
        let top = (0..s[2]).rev().find_map(|z| surface.index_of([s[0] / 2, s[1] / 2, z]));
        top.ok_or("no surface in the middle")? as usize
    } else {
        (0..surface.len()).max_by(|&a, &b| along(a).total_cmp(&along(b))).ok_or("no surface")?
    };
    let centre = position(top);
    let patch: Vec<u32> = (0..surface.len())
        .filter(|&i| {
            let p = position(i);
            (0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>() < 4.0
        })
        .map(|i| i as u32)
        .collect();
    let stride = (patch.len() / 500).max(1);
    let judged = (0..patch.len()).step_by(stride).collect();
    Ok(Scene { name, what, volume, patch, judged })
}
