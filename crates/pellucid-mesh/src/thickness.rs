//! Where a print is thin: light passes through, and the colour behind shows.

use pellucid_voxel::{Control, LabelGrid, Pitch, Surface, local_thickness_mm};

use crate::MeshError;
use crate::geometry::{Bounds, Vec3};

/// Largest number of regions that are listed one by one.
const LISTED: usize = 32;

/// A connected part of the surface that is thinner than the limit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ThinRegion {
    /// Share of the whole surface, 0 to 1.
    pub share: f64,
    /// The least thickness in it, in mm.
    pub least_mm: f64,
    /// Lower corner of its box in print space, in mm.
    pub low_mm: [f64; 3],
    /// Upper corner of its box in print space, in mm.
    pub high_mm: [f64; 3],
}

/// Which parts of a print are thinner than a limit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ThicknessReport {
    /// The limit in mm.
    pub limit_mm: f64,
    /// Share of the surface that is thinner, 0 to 1.
    pub thin_share: f64,
    /// The least thickness anywhere in mm; the limit when nothing is thinner.
    pub least_mm: f64,
    /// Number of connected regions that are thinner.
    pub region_count: u64,
    /// The largest regions, largest first, 32 at most.
    pub regions: Vec<ThinRegion>,
}

impl ThicknessReport {
    /// Measures the solid's thickness along the normal at every surface voxel and joins thin
    /// voxels that touch, be it at a corner, into regions. The two sides of a plate are two regions
    /// unless they meet at a thin rim. Thickness is exact to about a voxel.
    ///
    /// # Errors
    /// [`MeshError::Voxel`] when the surface is not of this grid or the limit is not finite and
    /// above 0, [`MeshError::Cancelled`].
    pub fn measure(
        grid: &LabelGrid,
        surface: &Surface,
        limit_mm: f64,
        control: &Control,
    ) -> Result<Self, MeshError> {
        let thickness = local_thickness_mm(grid, surface, limit_mm, control)?;
        let area: Vec<f64> =
            surface.normals().iter().map(|n| patch_area_mm2(surface.frame().pitch(), *n)).collect();
        let total: f64 = area.iter().sum();
        let thin: Vec<bool> = thickness.iter().map(|&t| f64::from(t) < limit_mm).collect();
        let mut seen = vec![false; surface.len()];
        let mut regions = Vec::new();
        let mut members = Vec::new();
        for seed in 0..surface.len() {
            if seen[seed] || !thin[seed] {
                continue;
            }
            control.check()?;
            members.clear();
            members.push(seed);
            seen[seed] = true;
            let mut head = 0;
            while head < members.len() {
                let i = members[head];
                head += 1;
                for j in neighbours(surface, i) {
                    if thin[j] && !seen[j] {
                        seen[j] = true;
                        members.push(j);
                    }
                }
            }
            let bounds = Bounds::of(members.iter().map(|&i| surface.position_mm(i as u32)));
            regions.push(ThinRegion {
                share: members.iter().map(|&i| area[i]).sum::<f64>() / total,
                least_mm: members.iter().map(|&i| f64::from(thickness[i])).fold(limit_mm, f64::min),
                low_mm: bounds.min,
                high_mm: bounds.max,
            });
        }
        // The sort is stable: equal regions stay in the order of their first voxel.
        regions.sort_by(|a, b| b.share.total_cmp(&a.share));
        let report = Self {
            limit_mm,
            thin_share: regions.iter().fold(0.0, |sum, r| sum + r.share),
            least_mm: regions.iter().map(|r| r.least_mm).fold(limit_mm, f64::min),
            region_count: regions.len() as u64,
            regions: {
                regions.truncate(LISTED);
                regions
            },
        };
        Ok(report)
    }
}

/// Surface voxels among the 26 around one, by index.
fn neighbours(surface: &Surface, i: usize) -> impl Iterator<Item = usize> + use<'_> {
    let v = surface.voxels()[i].map(i64::from);
    (0..27)
        .filter_map(move |k| {
            surface.frame().checked([v[0] + k % 3 - 1, v[1] + k / 3 % 3 - 1, v[2] + k / 9 - 1])
        })
        .filter_map(|v| surface.index_of(v))
        .map(|i| i as usize)
}

/// Area in mm² of a surface with this unit normal for each voxel that it passes through along the
/// axis it faces most evenly: voxel volume over the voxel's extent along the normal.
pub(crate) fn patch_area_mm2(pitch: Pitch, normal: [f32; 3]) -> f64 {
    let mm: Vec3 = pitch.mm();
    let extent: f64 = (0..3).map(|a| mm[a] * f64::from(normal[a]).abs()).sum();
    if extent > 0.0 { pitch.volume_mm3() / extent } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::voxelise::{VoxeliseOptions, voxelise};
    use pellucid_voxel::SurfaceOptions;

    #[test]
    fn finds_the_thin_plates_of_a_body() {
        // Two plates, 0.5 and 0.3 mm thick, on opposite sides of a cube of 4 mm.
        let body = Shape::cuboid([0.0; 3], [4.0; 3])
            .and(&Shape::cuboid([3.9, 0.5, 1.0], [8.0, 3.5, 1.5]))
            .and(&Shape::cuboid([-3.0, 0.5, 2.0], [0.1, 3.5, 2.3]));
        let control = Control::none();
        let v = voxelise(&body.model(), &VoxeliseOptions::default(), &control).unwrap();
        let surface = Surface::extract(&v.grid, &SurfaceOptions::default(), &control).unwrap();
        let report = ThicknessReport::measure(&v.grid, &surface, 1.0, &control).unwrap();
        // Both sides of each.
        assert_eq!(report.region_count, 4, "{report:?}");
        for thick in &report.regions[..2] {
            assert!(thick.low_mm[0] > 6.8 && (thick.least_mm - 0.5).abs() < 0.06, "{report:?}");
        }
        for thin in &report.regions[2..] {
            assert!(thin.high_mm[0] < 3.2 && (thin.least_mm - 0.3).abs() < 0.06, "{report:?}");
        }
        assert!((report.least_mm - 0.3).abs() < 0.06, "{report:?}");
        let plates = 2.0 * (4.0 * 3.0 + 3.0 * 3.0);
        let rest = 6.0 * 16.0 - 3.0 * 0.8 + (2.0 * 4.0 + 3.0) * 0.5 + (2.0 * 3.0 + 3.0) * 0.3;
        let expected = plates / (plates + rest);
        assert!((report.thin_share - expected).abs() < 0.04, "{} for {expected}", report.thin_share);
    }

    #[test]
    fn a_thick_body_has_no_thin_region() {
        let control = Control::none();
        let ball = Shape::sphere([0.0; 3], 2.0, 5).model();
        let v = voxelise(&ball, &VoxeliseOptions::default(), &control).unwrap();
        let surface = Surface::extract(&v.grid, &SurfaceOptions::default(), &control).unwrap();
        let report = ThicknessReport::measure(&v.grid, &surface, 1.0, &control).unwrap();
        assert_eq!((report.region_count, report.thin_share, report.least_mm), (0, 0.0, 1.0));
    }
}
