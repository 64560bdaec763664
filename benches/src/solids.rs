//! Halftoned solids given by their depth.

use pellucid_voxel::{Frame, LabelGrid, Pitch, TILE, TILE_VOXELS, Tile};

use crate::volumes::WHITE;

fn hash(v: [i64; 3]) -> u64 {
    v.iter().fold(0x9E37_79B9_7F4A_7C15, |h: u64, &c| {
        let h = (h ^ c as u64).wrapping_mul(0xFF51_AFD7_ED55_8CCD);
        h ^ (h >> 32)
    })
}

/// A halftoned material: white mixed with a second ink, pale, mid and dark by turns.
fn halftone(p: [f64; 3], v: [i64; 3]) -> u8 {
    let wave =
        |k: f64| 0.5 * ((k * p[0]).sin() * (1.1 * k * p[1] + 1.0).sin() + (0.9 * k * p[2] + 2.0).sin());
    let white = 0.55 + 0.45 * wave(2.1) + 0.2 * wave(9.8);
    let h = hash(v);
    if (h % 1000) as f64 <= 1000.0 * white {
        WHITE
    } else {
        1 + ((h / 1024 + u64::from(wave(1.3) > 0.0) + 2 * u64::from(wave(0.9) > 0.2)) % 4) as u8
    }
}

/// Labels from a depth below the surface (negative outside), 1-Lipschitz, and a skin.
pub fn solid(half: [f64; 3], skin: f64, depth: impl Fn([f64; 3]) -> f64 + Sync) -> LabelGrid {
    let pitch = Pitch::j750();
    let mm = pitch.mm();
    let size = std::array::from_fn(|a| (2.0 * half[a] / mm[a]).ceil() as u32);
    let frame = Frame::new(half.map(|h| -h), pitch, size).expect("a valid frame");
    let reach = 8.1 * mm.iter().map(|m| m * m).sum::<f64>().sqrt();
    LabelGrid::from_tiles(frame, |t| {
        let at = t.map(|c| i64::from(c) * TILE as i64);
        let middle = frame.centre_mm(at.map(|c| c + 8));
        if depth(middle) > skin + reach {
            return Tile::Constant(WHITE);
        }
        if depth(middle) < -reach {
            return Tile::Constant(0);
        }
        let mut labels = Box::new([0; TILE_VOXELS]);
        for (i, label) in labels.iter_mut().enumerate() {
            let v = [
                at[0] + (i % TILE) as i64,
                at[1] + (i / TILE % TILE) as i64,
                at[2] + (i / TILE / TILE) as i64,
            ];
            let p = frame.centre_mm(v);
            let d = depth(p);
            *label = if d < 0.0 {
                0
            } else if d > skin {
                WHITE
            } else {
                halftone(p, v)
            };
        }
        Tile::Dense(labels)
    })
}

/// A ball of `diameter` mm with a halftoned skin of `skin` mm.
pub fn ball(diameter: f64, skin: f64) -> LabelGrid {
    let r = diameter / 2.0;
    solid([r; 3], skin, |p| r - p.iter().map(|c| c * c).sum::<f64>().sqrt())
}

/// A square sheet of 12 mm with a halftoned skin of `skin` mm.
pub fn sheet(thickness: f64, skin: f64) -> LabelGrid {
    let half = [6.0, 6.0, thickness / 2.0];
    solid(half, skin, |p| (0..3).map(|a| half[a] - p[a].abs()).fold(f64::INFINITY, f64::min))
}
