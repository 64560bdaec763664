//! Which surface voxel each ray of a picture sees.

use std::ops::RangeInclusive;
use std::sync::atomic::AtomicU64;

use glam::DVec3;
use pellucid_core::Control;
use pellucid_voxel::{AIR, LabelGrid, Surface, TILE, Tile};
use rayon::prelude::*;

use crate::{Picture, ProofError, View};

/// Possible lengths of a picture's longer edge in pixels.
pub const EDGE_RANGE: RangeInclusive<u32> = 16..=4096;

/// Marks a ray with no object behind it.
const BACKGROUND: u32 = u32::MAX;

/// Rays a pixel edge: each pixel averages `SUPERSAMPLE`² of them.
const SUPERSAMPLE: u32 = 2;

/// Which surface voxel each ray of a picture sees.
///
/// Holds 16 bytes a pixel, 268 MB at the largest edge.
#[derive(Clone, Debug)]
pub struct Visibility {
    width: u32,
    height: u32,
    /// `[y][x]` over rays, rows from the top: index of a surface voxel, or [`BACKGROUND`].
    rays: Vec<u32>,
}

impl Visibility {
    /// Casts the rays of a picture whose longer edge is `edge` pixels ([`EDGE_RANGE`]). Progress is in rows of rays.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for an edge out of range, [`ProofError::Cancelled`].
    pub fn trace(
        grid: &LabelGrid,
        surface: &Surface,
        view: &View,
        edge: u32,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        if !EDGE_RANGE.contains(&edge) {
            let (least, most) = EDGE_RANGE.into_inner();
            return Err(ProofError::invalid(
                "picture edge",
                format!("{edge} pixels; {least} to {most} are possible"),
            ));
        }
        let frame = grid.frame();
        let pitch = DVec3::from(frame.pitch().mm());
        let extent = pitch * DVec3::from(frame.size().map(f64::from));
        let centre = DVec3::from(frame.origin_mm()) + 0.5 * extent;
        let [right, up, into] = view.axes();
        let reach = |axis: DVec3| 0.5 * axis.abs().dot(extent);
        let (half_w, half_h, depth) = (reach(right), reach(up), reach(into));
        let mm_per_pixel = 2.0 * half_w.max(half_h) / f64::from(edge);
        let pixels = |half: f64| ((2.0 * half / mm_per_pixel).round() as u32).clamp(1, edge);
        let (width, height) = (pixels(half_w), pixels(half_h));
        let step = mm_per_pixel / f64::from(SUPERSAMPLE);
        let columns = width * SUPERSAMPLE;
        let rows = height * SUPERSAMPLE;
        let mut rays = vec![BACKGROUND; columns as usize * rows as usize];
        let done = AtomicU64::new(0);
        rays.par_chunks_mut(columns as usize).enumerate().try_for_each(|(row, pixels)| {
            control.check()?;
            let v = half_h - (row as f64 + 0.5) * step;
            for (column, hit) in pixels.iter_mut().enumerate() {
                let u = (column as f64 + 0.5) * step - half_w;
                let start = centre + right * u + up * v - into * (depth + pitch.max_element());
                *hit = first_hit(grid, surface, start, into);
            }
            control.advance(&done, 1, u64::from(rows));
            Ok::<(), ProofError>(())
        })?;
        Ok(Self { width, height, rays })
    }

    /// Pixels across and down.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Surface indices that at least one ray sees, ascending.
    pub fn visible_points(&self) -> Vec<u32> {
        let mut points: Vec<u32> = self.rays.iter().copied().filter(|&p| p != BACKGROUND).collect();
        points.par_sort_unstable();
        points.dedup();
        points
    }

    /// Shows `colors`, one linear RGB a surface voxel; those of voxels that no ray sees are not read. Progress is in
    /// rows of pixels.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] when a visible voxel has no colour, [`ProofError::Cancelled`].
    pub fn shade(&self, colors: &[[f32; 3]], control: &Control<'_>) -> Result<Picture, ProofError> {
        let (width, samples) = (self.width as usize, SUPERSAMPLE as usize);
        let columns = width * samples;
        let mut rgba = vec![0.0; width * self.height as usize * 4];
        let done = AtomicU64::new(0);
        rgba.par_chunks_mut(width * 4).enumerate().try_for_each(|(y, row)| {
            control.check()?;
            for (x, pixel) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let mut sum = [0.0f32; 3];
                let mut hits = 0;
                for dy in 0..samples {
                    let from = (y * samples + dy) * columns + x * samples;
                    for &point in &self.rays[from..from + samples] {
                        if point == BACKGROUND {
                            continue;
                        }
                        let color = colors.get(point as usize).ok_or_else(|| {
                            ProofError::invalid(
                                "colours",
                                format!("{} given; surface voxel {point} is visible", colors.len()),
                            )
                        })?;
                        (0..3).for_each(|c| sum[c] += color[c]);
                        hits += 1;
                    }
                }
                let scale = 1.0 / hits.max(1) as f32;
                let [r, g, b] = sum.map(|s| s * scale);
                *pixel = [r, g, b, hits as f32 / (samples * samples) as f32];
            }
            control.advance(&done, 1, u64::from(self.height));
            Ok::<(), ProofError>(())
        })?;
        Picture::new(self.width, self.height, rgba)
    }
}

/// The first surface voxel on a ray, or [`BACKGROUND`].
fn first_hit(grid: &LabelGrid, surface: &Surface, start: DVec3, into: DVec3) -> u32 {
    let frame = grid.frame();
    let pitch = DVec3::from(frame.pitch().mm());
    // In voxel units the grid is the box [0, size].
    let origin = (start - DVec3::from(frame.origin_mm())) / pitch;
    let direction = into / pitch;
    let size = frame.size().map(f64::from);
    let Some((mut t, end)) = clip(origin, direction, [0.0; 3], size) else {
        return BACKGROUND;
    };
    // Far below a voxel, far above the rounding of coordinates up to a million.
    let nudge = 1e-7 * pitch.min_element();
    while t < end {
        let p = origin + direction * (t + nudge);
        let voxel = p.to_array().map(|v| v.floor() as i64);
        let Some(voxel) = frame.checked(voxel) else {
            t += nudge;
            continue;
        };
        let tile = voxel.map(|v| v / TILE as u32);
        let skip = if let Tile::Constant(AIR) = grid.tile(tile) {
            let low = tile.map(|v| f64::from(v) * TILE as f64);
            (low, low.map(|v| v + TILE as f64))
        } else {
            if grid.get(voxel) != AIR
                && let Some(point) = surface.index_of(voxel)
            {
                return point;
            }
            let low = voxel.map(f64::from);
            (low, low.map(|v| v + 1.0))
        };
        t = clip(origin, direction, skip.0, skip.1).map_or(t, |(_, exit)| exit).max(t) + nudge;
    }
    BACKGROUND
}

/// Entry and exit of a line through a box, from t = 0 on.
fn clip(origin: DVec3, direction: DVec3, low: [f64; 3], high: [f64; 3]) -> Option<(f64, f64)> {
    let (mut near, mut far) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        if direction[a].abs() < 1e-12 {
            if origin[a] < low[a] || origin[a] > high[a] {
                return None;
            }
            continue;
        }
        let t0 = (low[a] - origin[a]) / direction[a];
        let t1 = (high[a] - origin[a]) / direction[a];
        near = near.max(t0.min(t1));
        far = far.min(t0.max(t1));
    }
    (near < far).then_some((near, far))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, Pitch, SurfaceOptions};
    use std::sync::atomic::{AtomicBool, Ordering};

    /// A 3 mm cube, red (index by x) on one half.
    fn cube() -> (LabelGrid, Surface) {
        let frame = Frame::new([-2.0; 3], Pitch::new([0.1, 0.2, 0.05]).unwrap(), [40, 20, 80]).unwrap();
        let mut grid = LabelGrid::new(frame);
        for z in 0..80 {
            for y in 0..20 {
                for x in 0..40 {
                    let c = frame.centre_mm([x, y, z].map(i64::from));
                    if c.iter().all(|v| v.abs() < 1.5) {
                        grid.set([x, y, z], 1);
                    }
                }
            }
        }
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        (grid, surface)
    }

    #[test]
    fn front_view_of_a_cube_is_its_near_face() {
        let (grid, surface) = cube();
        let none = Control::none();
        let view = View::new("front", 0.0, 0.0).unwrap();
        let seen = Visibility::trace(&grid, &surface, &view, 80, &none).unwrap();
        let points = seen.visible_points();
        let near = surface.voxels().iter().map(|v| v[1]).min().unwrap();
        assert!(!points.is_empty());
        assert!(points.iter().all(|&p| surface.voxels()[p as usize][1] == near));
        assert_eq!(points.len(), 30 * 60);

        let colors: Vec<[f32; 3]> = surface
            .voxels()
            .iter()
            .map(|v| if v[0] >= 20 { [1.0, 0.25, 0.0] } else { [0.0, 0.5, 0.75] })
            .collect();
        let picture = seen.shade(&colors, &none).unwrap();
        let [w, h] = seen.size();
        assert_eq!([picture.width(), picture.height()], [w, h]);
        assert_eq!(picture.pixel(w / 2 + 5, h / 2), Some([1.0, 0.25, 0.0, 1.0]), "right is +x");
        assert_eq!(picture.pixel(w / 2 - 5, h / 2), Some([0.0, 0.5, 0.75, 1.0]));
        assert_eq!(picture.pixel(0, 0).unwrap()[3], 0.0);
    }

    #[test]
    fn a_pixel_across_an_edge_averages_what_its_rays_see() {
        let seen =
            Visibility { width: 2, height: 1, rays: vec![0, 1, BACKGROUND, 2, 1, 1, BACKGROUND, BACKGROUND] };
        let colors = [[0.8, 0.0, 0.4], [0.0, 0.4, 0.8], [0.1, 0.2, 0.3]];
        let picture = seen.shade(&colors, &Control::none()).unwrap();
        let [r, g, b, a] = picture.pixel(0, 0).unwrap();
        assert!((r - 0.2).abs() < 1e-6 && (g - 0.3).abs() < 1e-6 && (b - 0.7).abs() < 1e-6 && a == 1.0);
        assert_eq!(picture.pixel(1, 0), Some([0.1, 0.2, 0.3, 0.25]), "not darkened by the background");
        assert!(matches!(seen.shade(&colors[..2], &Control::none()), Err(ProofError::Invalid(_))));
    }

    #[test]
    fn opposite_views_see_different_voxels() {
        let (grid, surface) = cube();
        let sets: Vec<Vec<u32>> = View::front_and_back()
            .iter()
            .map(|v| Visibility::trace(&grid, &surface, v, 64, &Control::none()).unwrap().visible_points())
            .collect();
        let normals_agree = |points: &[u32], y: f32| {
            points.iter().filter(|&&p| surface.normals()[p as usize][1] * y > 0.9).count()
        };
        assert!(normals_agree(&sets[0], -1.0) > 100 && normals_agree(&sets[0], 1.0) == 0);
        assert!(normals_agree(&sets[1], 1.0) > 100 && normals_agree(&sets[1], -1.0) == 0);
    }

    #[test]
    fn progress_reaches_the_end_and_cancel_stops_in_between() {
        let (grid, surface) = cube();
        let view = View::new("a", 30.0, 40.0).unwrap();
        let stop = AtomicBool::new(false);
        let most = AtomicU64::new(0);
        let watch = |done: u64, total: u64| {
            most.fetch_max(1000 * done / total, Ordering::Relaxed);
        };
        let control = Control::none().with_progress(&watch).with_cancel(&stop);
        let seen = Visibility::trace(&grid, &surface, &view, 64, &control).unwrap();
        assert_eq!(most.load(Ordering::Relaxed), 1000);

        let cut = |done: u64, _: u64| stop.store(done >= 3, Ordering::Relaxed);
        let control = Control::none().with_progress(&cut).with_cancel(&stop);
        let error = Visibility::trace(&grid, &surface, &view, 1024, &control).unwrap_err();
        assert!(matches!(error, ProofError::Cancelled));
        stop.store(true, Ordering::Relaxed);
        let error = seen.shade(&vec![[0.5; 3]; surface.len()], &control).unwrap_err();
        assert!(matches!(error, ProofError::Cancelled));
    }

    #[test]
    fn an_edge_out_of_range_is_refused() {
        let (grid, surface) = cube();
        let view = View::new("a", 0.0, 0.0).unwrap();
        for edge in [0, 15, 4097] {
            let error = Visibility::trace(&grid, &surface, &view, edge, &Control::none()).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!("invalid picture edge: {edge} pixels; 16 to 4096 are possible")
            );
        }
    }
}
