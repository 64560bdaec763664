//! From a solid and an arrangement to voxels.
//!
//! | module | owns |
//! | --- | --- |
//! | [`shape`] | the solids, as signed distances |
//! | [`texture`] | material arrangements: patterns, mixtures, halftone |
//! | [`noise`] | the noise they are made of |

pub mod noise;
pub mod shape;
pub mod texture;

use pellucid_voxel::{AIR, Frame, LabelGrid, Pitch, TILE, TILE_VOXELS, Tile, VoxelError};

use shape::Shape;
use texture::{BlueNoise, Texture};

/// Fills a solid with an arrangement; one voxel of air on every side.
///
/// # Errors
/// [`VoxelError`] when the solid needs more voxels than a frame holds.
pub fn fill(
    shape: &Shape,
    texture: &Texture,
    pitch: Pitch,
    blue: &BlueNoise,
) -> Result<LabelGrid, VoxelError> {
    let mm = pitch.mm();
    let half: [u32; 3] = {
        let reach = shape.reach();
        std::array::from_fn(|a| (reach[a] / mm[a]).ceil() as u32 + 1)
    };
    let origin = std::array::from_fn(|a| -f64::from(half[a]) * mm[a]);
    let frame = Frame::new(origin, pitch, half.map(|h| 2 * h))?;
    // No voxel of a tile is farther from the tile's centre than this.
    let radius = 0.5 * TILE as f64 * (mm[0] * mm[0] + mm[1] * mm[1] + mm[2] * mm[2]).sqrt();
    let core = texture.constant_core();
    Ok(LabelGrid::from_tiles(frame, |t| {
        let base = t.map(|v| i64::from(v) * TILE as i64);
        let centre: [f64; 3] =
            std::array::from_fn(|a| origin[a] + (base[a] as f64 + 0.5 * TILE as f64) * mm[a]);
        let middle = shape.distance(centre);
        if middle > radius {
            return Tile::Constant(AIR);
        }
        if let Some((label, depth)) = core
            && -middle - radius > depth
        {
            return Tile::Constant(label);
        }
        let mut painter = texture.painter(blue, &frame, base);
        let mut labels = Box::new([AIR; TILE_VOXELS]);
        for (i, label) in labels.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            let distance =
                shape.distance(frame.centre_mm(std::array::from_fn(|a| base[a] + local[a] as i64)));
            if distance < 0.0 {
                *label = painter.label(local, -distance);
            }
        }
        Tile::Dense(labels)
    }))
}

#[cfg(test)]
mod tests {
    use super::texture::{Dither, Pattern};
    use super::*;

    #[test]
    fn a_coated_ball_has_the_right_volumes() {
        let texture = Texture {
            seed: 1,
            pattern: Pattern::Constant,
            scale_mm: 1.0,
            octaves: 1,
            palette: vec![vec![0.0, 1.0, 0.0]],
            depth_mm: 0.5,
            relief: 0.0,
            fade: false,
            core: vec![0.0, 0.0, 1.0],
            dither: Dither::White,
        };
        let grid = fill(
            &Shape::Sphere { diameter: 4.0 },
            &texture,
            Pitch::j750(),
            &BlueNoise::new(crate::Halftone::Ranked, Pitch::j750()),
        )
        .unwrap();
        let counts = grid.histogram();
        let volume = |n: u64| n as f64 * Pitch::j750().volume_mm3();
        let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        assert_eq!(counts[1], 0);
        assert!((volume(counts[3]) / ball(1.5) - 1.0).abs() < 0.01, "{}", volume(counts[3]));
        assert!((volume(counts[2]) / (ball(2.0) - ball(1.5)) - 1.0).abs() < 0.01);
        let size = grid.size();
        let faces = (0..size[1]).flat_map(|y| (0..size[2]).map(move |z| [0, y, z]));
        assert!(faces.into_iter().all(|v| grid.get(v) == 0));
    }
}
