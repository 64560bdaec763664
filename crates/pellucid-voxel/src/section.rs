//! Layers of a grid as a grid of their own.

use std::ops::Range;

use crate::{Frame, LabelGrid, Surface, TILE, VoxelError};

impl Frame {
    /// The layers `z` of this frame. They begin between two tiles, and end there or at the frame's end.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] for other layers, or none.
    pub fn section(&self, z: Range<u32>) -> Result<Frame, VoxelError> {
        let [sx, sy, sz] = self.size();
        let between_tiles = |z: u32| z.is_multiple_of(TILE as u32);
        if z.start >= z.end || z.end > sz || !between_tiles(z.start) || !(between_tiles(z.end) || z.end == sz)
        {
            return Err(VoxelError::invalid(
                "section",
                format!("layers {z:?} of {sz}; take whole tiles of {TILE} of them"),
            ));
        }
        let mut origin_mm = self.origin_mm();
        origin_mm[2] += f64::from(z.start) * self.pitch().mm()[2];
        Frame::new(origin_mm, self.pitch(), [sx, sy, z.end - z.start])
    }
}

impl LabelGrid {
    /// The labels of the layers `z`; what lies above and below them is outside.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 20, 70])?;
    /// let grid = LabelGrid::from_fn(frame, |[_, _, z]| z as u8);
    /// let section = grid.section(32..64)?;
    /// assert_eq!(section.size(), [20, 20, 32]);
    /// assert_eq!(section.get([3, 4, 5]), 37);
    /// assert_eq!(grid.section(64..70)?.get([0, 0, 5]), 69);
    /// assert!(grid.section(30..64).is_err());
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Frame::section`].
    pub fn section(&self, z: Range<u32>) -> Result<LabelGrid, VoxelError> {
        let first = z.start / TILE as u32;
        let frame = self.frame().section(z)?;
        Ok(LabelGrid::from_tiles(frame, |[x, y, z]| self.tile([x, y, z + first]).clone()))
    }
}

impl Surface {
    /// Positions of the surface voxels in the layers `z`.
    pub fn points_in(&self, z: Range<u32>) -> Range<u32> {
        let before = |layer: u32| self.voxels().partition_point(|v| v[2] < layer) as u32;
        let start = before(z.start);
        start..before(z.end).max(start)
    }

    /// The surface voxels of the layers `listed`, with their normals, in the frame of the layers `z`, which hold them.
    /// Where `z` cuts the solid there is no surface.
    ///
    /// # Errors
    /// As [`Frame::section`]; [`VoxelError::Invalid`] when `listed` are not among `z`.
    pub fn section(&self, z: Range<u32>, listed: Range<u32>) -> Result<Surface, VoxelError> {
        let frame = self.frame().section(z.clone())?;
        if listed.start > listed.end || listed.start < z.start || listed.end > z.end {
            let reason = format!("layers {listed:?} are listed of {z:?}");
            return Err(VoxelError::invalid("section's surface", reason));
        }
        let points = self.points_in(listed.clone());
        let points = points.start as usize..points.end as usize;
        let voxels = self.voxels()[points.clone()].iter().map(|v| [v[0], v[1], v[2] - z.start]).collect();
        let mut section = Surface::from_parts(frame, voxels, self.normals()[points].to_vec())?;
        section.listed = listed.start - z.start..listed.end - z.start;
        Ok(section)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AIR, Control, NearestSurface, Pitch, SurfaceOptions};

    /// A ball with a hole.
    fn ball() -> LabelGrid {
        let frame = Frame::new([1.0, 2.0, 3.0], Pitch::j750(), [60, 34, 90]).unwrap();
        let mm = frame.pitch().mm();
        let from = |v: [u32; 3], at: [f64; 3]| -> f64 {
            (0..3).map(|a| ((f64::from(v[a]) + 0.5) * mm[a] - at[a]).powi(2)).sum::<f64>().sqrt()
        };
        LabelGrid::from_fn(frame, |v| {
            let solid = from(v, [1.25, 1.4, 1.2]) < 1.15 && from(v, [1.6, 1.4, 1.3]) > 0.4;
            if solid { 1 + (v[2] % 3) as u8 } else { AIR }
        })
    }

    #[test]
    fn a_section_is_the_grid_there() {
        let grid = ball();
        for z in [0..16, 16..64, 32..90, 0..90] {
            let section = grid.section(z.clone()).unwrap();
            let centre = |frame: &Frame, z: u32| frame.centre_mm([3, 4, i64::from(z)]);
            for (a, b) in centre(section.frame(), 0).into_iter().zip(centre(grid.frame(), z.start)) {
                assert!((a - b).abs() < 1e-12);
            }
            let expected = LabelGrid::from_fn(*section.frame(), |v| grid.get([v[0], v[1], v[2] + z.start]));
            assert!(section == expected);
        }
        for wrong in [0..17, 8..32, 16..16, 80..96, Range { start: 32, end: 16 }] {
            assert!(matches!(grid.section(wrong), Err(VoxelError::Invalid { .. })));
        }
    }

    #[test]
    fn surface_and_nearest_of_a_section_are_the_whole_ones_there() {
        let (grid, control) = (ball(), Control::none());
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let depth = 0.3;
        let whole = NearestSurface::build(&grid, &surface, depth, &control).unwrap();
        let z = 16..80;
        let all = surface.points_in(z.clone());
        // 11 layers are the depth: voxels follow the wanted ones up to so far off, and none follows one outside instead.
        let (points, entries) = (surface.points_in(28..70), surface.points_in(40..58));
        assert!(all.start < points.start && points.start < entries.start && points.end < all.end);
        let section = grid.section(z.clone()).unwrap();
        let nearest =
            NearestSurface::build(&section, &surface.section(z.clone(), z.clone()).unwrap(), depth, &control);
        let own = surface.section(z.clone(), 28..70).unwrap();
        assert_eq!((own.listed_layers(), surface.listed_layers()), (12..54, 0..90));
        assert_eq!(own.len(), points.len());
        let local = |range: &Range<u32>| range.start - all.start..range.end - all.start;
        let nearest = nearest.unwrap().of_part(&own, local(&points), local(&entries)).unwrap();
        let mut found = 0;
        for voxel in (0..64).flat_map(|z| (0..34).flat_map(move |y| (0..60).map(move |x| [x, y, z]))) {
            let expected = whole.nearest([voxel[0], voxel[1], voxel[2] + z.start]);
            let expected = expected.filter(|p| entries.contains(p)).map(|p| p - points.start);
            assert_eq!(nearest.nearest(voxel), expected, "{voxel:?}");
            if let Some(point) = expected {
                found += 1;
                let global = surface.voxels()[(point + points.start) as usize];
                assert_eq!(own.voxels()[point as usize], [global[0], global[1], global[2] - z.start]);
                assert_eq!(own.normals()[point as usize], surface.normals()[(point + points.start) as usize]);
            }
        }
        assert!(found > 1000);
        assert!(surface.section(32..80, 28..70).is_err(), "starts below");
    }
}
