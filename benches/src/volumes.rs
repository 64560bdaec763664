//! Analytic print objects and noise, built tile by tile.

use pellucid_voxel::{Frame, LabelGrid, Pitch, TILE, TILE_VOXELS, Tile};

/// Labels of the default table.
pub const WHITE: u8 = 5;
const LABELS: u64 = 5;

/// A hash of three coordinates and a seed, for noise.
pub fn hash(v: [u32; 3], seed: u64) -> u64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for c in v {
        h = (h ^ u64::from(c)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 32;
    }
    h
}

/// Every voxel one of five labels or air at random: nothing for a sparse table to gain from.
pub fn noise(size: [u32; 3]) -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).expect("a valid size");
    LabelGrid::from_tiles(frame, |t| {
        let mut tile = Box::new([0; TILE_VOXELS]);
        for (i, label) in tile.iter_mut().enumerate() {
            *label = ((hash([i as u32, t[0] + 1000 * t[1], t[2]], 1) >> 20) % (LABELS + 1)) as u8;
        }
        Tile::Dense(tile)
    })
}

/// A solid block of white.
pub fn block(size: [u32; 3]) -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).expect("a valid size");
    LabelGrid::from_tiles(frame, |_| Tile::Constant(WHITE))
}

/// A dimpled ball of `diameter_mm` in a frame 0.5 mm wider, at the printer's pitch: white, under a
/// skin of `skin_mm` in which each voxel has one of five labels, tone varying over the surface.
pub fn dimpled_ball(diameter_mm: f64, skin_mm: f64) -> LabelGrid {
    let pitch = Pitch::j750();
    let half = diameter_mm / 2.0 + 0.5;
    let size = pitch.mm().map(|mm| (2.0 * half / mm).ceil() as u32);
    let frame = Frame::new([-half; 3], pitch, size).expect("a valid size");
    let radius = diameter_mm / 2.0 - 0.3;
    // Depth below the surface in mm; within a factor 1.5 of the distance.
    let depth = |p: [f64; 3]| {
        let dimple: f64 = p.iter().map(|c| (1.1 * c).sin()).product();
        radius + 0.3 * dimple - p.iter().map(|c| c * c).sum::<f64>().sqrt()
    };
    let reach = 1.5 * 8.0 * pitch.mm().iter().map(|c| c * c).sum::<f64>().sqrt();
    LabelGrid::from_tiles(frame, |t| {
        let voxel = |i: usize| -> [u32; 3] {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            std::array::from_fn(|a| t[a] * TILE as u32 + local[a] as u32)
        };
        let centre = frame.centre_mm(t.map(|t| i64::from(t) * 16 + 8));
        let middle = depth(centre);
        if middle < -reach {
            return Tile::Constant(0);
        }
        if middle > skin_mm + reach {
            return Tile::Constant(WHITE);
        }
        let mut tile = Box::new([0; TILE_VOXELS]);
        for (i, label) in tile.iter_mut().enumerate() {
            let v = voxel(i);
            let p = frame.centre_mm(v.map(i64::from));
            let d = depth(p);
            *label = if d < 0.0 {
                0
            } else if d > skin_mm {
                WHITE
            } else {
                let tone = 0.5 + 0.5 * (p[0] * 0.7).sin() * (p[2] * 0.5).cos();
                let h = hash(v, 7);
                if (h >> 40 & 0xffff) as f64 / 65536.0 < tone { WHITE } else { 1 + ((h >> 20) % 4) as u8 }
            };
        }
        Tile::Dense(tile)
    })
}

/// Solid voxels with a face to air, up to `limit`, from the layer range in the middle of the grid
/// on: whole neighbourhoods, as a print's surface list has them.
pub fn surface_points(grid: &LabelGrid, limit: usize) -> Vec<[u32; 3]> {
    let [dx, dy, dz] = grid.tile_dims();
    let mut points = Vec::new();
    for tz in dz / 4..dz {
        for ty in 0..dy {
            for tx in 0..dx {
                if matches!(grid.tile([tx, ty, tz]), Tile::Constant(0)) {
                    continue;
                }
                for i in 0..TILE_VOXELS {
                    let v = [tx * 16 + i as u32 % 16, ty * 16 + i as u32 / 16 % 16, tz * 16 + i as u32 / 256];
                    let at = v.map(i64::from);
                    let exposed = (0..3).any(|a| {
                        [-1, 1].iter().any(|step| {
                            let mut n = at;
                            n[a] += step;
                            grid.at(n) == 0
                        })
                    });
                    if grid.at(at) != 0 && exposed {
                        points.push(v);
                    }
                }
                if points.len() >= limit {
                    points.truncate(limit);
                    return points;
                }
            }
        }
    }
    points
}
