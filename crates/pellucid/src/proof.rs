//! Soft-proof pictures: what each surface voxel will look like, seen from fixed directions.
//!
//! Pictures are flat: a pixel shows the radiance of the surface voxel behind it and nothing else, so
//! that colours can be read off. Views are orthographic.

use std::path::Path;

use glam::DVec3;
use pellucid_color::space::{srgb_decode, srgb_encode_u8};
use pellucid_voxel::{AIR, Control, LabelGrid, Surface, TILE, Tile, VoxelError};
use rayon::prelude::*;

/// Marks a pixel with no object behind it.
pub const BACKGROUND: u32 = u32::MAX;

/// Rays a pixel edge: each pixel averages `SUPERSAMPLE`² of them.
const SUPERSAMPLE: u32 = 2;

/// A direction to look from.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name used for EXR layers, such as `front`.
    pub name: String,
    /// Angle about the vertical print axis in degrees; 0 looks along +y (at glTF's front), 90 along -x.
    pub azimuth_deg: f64,
    /// Height of the eye above the horizon in degrees, -90 to 90.
    pub elevation_deg: f64,
}

impl View {
    /// Front and back, each from a little above.
    pub fn front_and_back() -> Vec<Self> {
        [("front", 25.0), ("back", 205.0)]
            .map(|(name, azimuth_deg)| Self { name: name.into(), azimuth_deg, elevation_deg: 20.0 })
            .to_vec()
    }

    /// The axes of the picture: right, up, and into the scene; orthonormal.
    fn axes(&self) -> [DVec3; 3] {
        let (sin_a, cos_a) = self.azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = self.elevation_deg.to_radians().sin_cos();
        let into = DVec3::new(-sin_a * cos_e, cos_a * cos_e, -sin_e);
        let right = DVec3::new(cos_a, sin_a, 0.0);
        [right, right.cross(into), into]
    }
}

/// Which surface voxel each ray of a picture sees.
#[derive(Clone, Debug)]
pub struct Visibility {
    width: u32,
    height: u32,
    rays: Vec<u32>,
}

/// A linear RGBA picture, rows from the top, 4 floats a pixel, not premultiplied.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// `[y][x][rgba]`, linear Rec.709 and coverage.
    pub rgba: Vec<f32>,
}

impl Visibility {
    /// Casts the rays of a picture whose longer edge is `edge` pixels (16 to 4096).
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] for an edge out of range, [`VoxelError::Cancelled`].
    pub fn trace(
        grid: &LabelGrid,
        surface: &Surface,
        view: &View,
        edge: u32,
        control: &Control<'_>,
    ) -> Result<Self, VoxelError> {
        if !(16..=4096).contains(&edge) {
            return Err(VoxelError::invalid(
                "picture edge",
                format!("{edge} pixels; 16 to 4096 are possible"),
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
        let mut rays = vec![BACKGROUND; (columns * height * SUPERSAMPLE) as usize];
        rays.par_chunks_mut(columns as usize).enumerate().try_for_each(|(row, pixels)| {
            control.check()?;
            let v = half_h - (row as f64 + 0.5) * step;
            for (column, hit) in pixels.iter_mut().enumerate() {
                let u = (column as f64 + 0.5) * step - half_w;
                let start = centre + right * u + up * v - into * (depth + pitch.max_element());
                *hit = first_hit(grid, surface, start, into);
            }
            Ok::<(), VoxelError>(())
        })?;
        Ok(Self { width, height, rays })
    }

    /// Surface indices that at least one ray sees, ascending.
    pub fn visible_points(&self) -> Vec<u32> {
        let mut points: Vec<u32> = self.rays.iter().copied().filter(|&p| p != BACKGROUND).collect();
        points.par_sort_unstable();
        points.dedup();
        points
    }

    /// Shows `colors`, one linear RGB a surface voxel.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when a visible voxel has no colour.
    pub fn shade(&self, colors: &[[f32; 3]]) -> Result<Picture, VoxelError> {
        let columns = (self.width * SUPERSAMPLE) as usize;
        let samples = SUPERSAMPLE as usize;
        let mut rgba = Vec::with_capacity((self.width * self.height * 4) as usize);
        for y in 0..self.height as usize {
            for x in 0..self.width as usize {
                let mut sum = [0.0f32; 3];
                let mut hits = 0;
                for dy in 0..samples {
                    for dx in 0..samples {
                        let point = self.rays[(y * samples + dy) * columns + x * samples + dx];
                        if point == BACKGROUND {
                            continue;
                        }
                        let color = colors.get(point as usize).ok_or_else(|| {
                            VoxelError::invalid(
                                "colours",
                                format!("{} given; voxel {point} is visible", colors.len()),
                            )
                        })?;
                        (0..3).for_each(|c| sum[c] += color[c]);
                        hits += 1;
                    }
                }
                let scale = 1.0 / hits.max(1) as f32;
                rgba.extend(sum.map(|s| s * scale));
                rgba.push(hits as f32 / (samples * samples) as f32);
            }
        }
        Ok(Picture { width: self.width, height: self.height, rgba })
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

/// Pictures side by side in columns and views below each other, as sRGB on mid grey.
///
/// `rows` holds one row of pictures a view. Linear values are clipped to 0..=1.
pub fn contact_sheet(rows: &[Vec<Picture>]) -> image::RgbaImage {
    const GAP: u32 = 8;
    const GREY: u8 = 128;
    let row_width = |row: &[Picture]| row.iter().map(|p| p.width + GAP).sum::<u32>() + GAP;
    let row_height = |row: &[Picture]| row.iter().map(|p| p.height).max().unwrap_or(0) + GAP;
    let width = rows.iter().map(|r| row_width(r)).max().unwrap_or(1);
    let height = rows.iter().map(|r| row_height(r)).sum::<u32>() + GAP;
    let mut sheet = image::RgbaImage::from_pixel(width, height, image::Rgba([GREY, GREY, GREY, 255]));
    let background = srgb_decode(f64::from(GREY) / 255.0) as f32;
    let mut y0 = GAP;
    for row in rows {
        let mut x0 = GAP;
        for picture in row {
            for y in 0..picture.height {
                for x in 0..picture.width {
                    let i = ((y * picture.width + x) * 4) as usize;
                    let a = picture.rgba[i + 3];
                    let pixel = std::array::from_fn(|c| match c {
                        3 => 255,
                        _ => srgb_encode_u8(f64::from(picture.rgba[i + c] * a + background * (1.0 - a))),
                    });
                    sheet.put_pixel(x0 + x, y0 + y, image::Rgba(pixel));
                }
            }
            x0 += picture.width + GAP;
        }
        y0 += row_height(row);
    }
    sheet
}

/// Writes named linear pictures as the layers of one EXR file, 32-bit float R, G, B, A.
///
/// # Errors
/// [`exr::error::Error`] when the file cannot be written.
pub fn write_exr(path: &Path, pictures: &[(String, &Picture)]) -> Result<(), exr::error::Error> {
    use exr::prelude::*;
    let mut layers = SmallVec::<[Layer<AnyChannels<FlatSamples>>; 2]>::new();
    for (name, picture) in pictures {
        let plane = |c: usize| FlatSamples::F32(picture.rgba.iter().skip(c).step_by(4).copied().collect());
        let channels =
            ["R", "G", "B", "A"].iter().enumerate().map(|(c, &n)| AnyChannel::new(n, plane(c))).collect();
        layers.push(Layer::new(
            (picture.width as usize, picture.height as usize),
            LayerAttributes::named(name.as_str()),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(channels),
        ));
    }
    let bounds = layers.iter().fold(Vec2(1, 1), |b, l| Vec2(b.0.max(l.size.0), b.1.max(l.size.1)));
    let window = IntegerBounds::from_dimensions(bounds);
    Image::from_layers(ImageAttributes::new(window), layers).write().to_file(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, Pitch, SurfaceOptions};

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
        let view = View { name: "front".into(), azimuth_deg: 0.0, elevation_deg: 0.0 };
        let seen = Visibility::trace(&grid, &surface, &view, 80, &Control::none()).unwrap();
        let points = seen.visible_points();
        let near = surface.voxels().iter().map(|v| v[1]).min().unwrap();
        assert!(!points.is_empty());
        assert!(points.iter().all(|&p| surface.voxels()[p as usize][1] == near));
        assert_eq!(points.len(), 30 * 60);

        let colors: Vec<[f32; 3]> = surface
            .voxels()
            .iter()
            .map(|v| if v[0] >= 20 { [1.0, 0.0, 0.0] } else { [0.0, 0.5, 0.0] })
            .collect();
        let picture = seen.shade(&colors).unwrap();
        let pixel = |x: u32, y: u32| &picture.rgba[((y * picture.width + x) * 4) as usize..][..4];
        let (w, h) = (picture.width, picture.height);
        assert_eq!(pixel(w / 2 + 5, h / 2), [1.0, 0.0, 0.0, 1.0], "right is +x");
        assert_eq!(pixel(w / 2 - 5, h / 2), [0.0, 0.5, 0.0, 1.0]);
        assert_eq!(pixel(0, 0)[3], 0.0);
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
    fn exr_layers_keep_linear_values() {
        let picture = Picture { width: 2, height: 1, rgba: vec![0.25, 1.5, -0.125, 1.0, 0.0, 0.0, 3.0, 0.5] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &[("target.front".into(), &picture), ("refined.front".into(), &picture)]).unwrap();
        let image = exr::prelude::read_all_flat_layers_from_file(&path).unwrap();
        let names: Vec<String> =
            image.layer_data.iter().map(|l| l.attributes.layer_name.as_ref().unwrap().to_string()).collect();
        assert_eq!(names, ["target.front", "refined.front"]);
        let green = image.layer_data[0].channel_data.list.iter().find(|c| c.name.to_string() == "G").unwrap();
        assert_eq!(green.sample_data.values_as_f32().collect::<Vec<_>>(), [1.5, 0.0]);
    }

    #[test]
    fn contact_sheet_encodes_srgb_over_grey() {
        let picture = Picture { width: 1, height: 2, rgba: vec![1.0, 0.0, 0.5, 1.0, 0.9, 0.9, 0.9, 0.0] };
        let sheet = contact_sheet(&[vec![picture.clone(), picture]]);
        assert_eq!(sheet.get_pixel(8, 8).0, [255, 0, 188, 255]);
        assert_eq!(sheet.get_pixel(8, 9).0, [128, 128, 128, 255]);
        assert_eq!(sheet.get_pixel(17, 8).0, [255, 0, 188, 255]);
    }
}
