//! Scenes shared by the tests.
#![allow(dead_code, reason = "each test binary uses its own part")]

use pellucid_trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, TILE, Tile,
};

/// A grid with its surface, ready to trace.
pub struct Object {
    pub grid: LabelGrid,
    pub surface: Surface,
    pub volume: Volume,
}

impl Object {
    /// From a label for every voxel.
    pub fn new(pitch: Pitch, size: [u32; 3], label: impl Fn([u32; 3]) -> u8 + Sync) -> Self {
        let frame = Frame::new([0.0; 3], pitch, size).unwrap();
        let grid = LabelGrid::from_tiles(frame, |t| {
            let mut labels = Box::new([0; TILE * TILE * TILE]);
            for (i, l) in labels.iter_mut().enumerate() {
                let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
                let v: [u32; 3] = std::array::from_fn(|a| t[a] * TILE as u32 + local[a] as u32);
                if (0..3).all(|a| v[a] < size[a]) {
                    *l = label(v);
                }
            }
            Tile::Dense(labels)
        });
        Self::of(grid)
    }

    pub fn of(grid: LabelGrid) -> Self {
        let control = Control::none();
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let volume = Volume::new(&grid, &surface, &control).unwrap();
        Self { grid, surface, volume }
    }

    /// The surface point over the middle of the top layer.
    pub fn top(&self) -> u32 {
        let s = self.grid.size();
        self.surface.index_of([s[0] / 2, s[1] / 2, s[2] - 1]).unwrap()
    }

    /// Value and standard error per channel of each point.
    pub fn radiance(&self, table: &MaterialTable, options: TraceOptions, points: &[u32]) -> Vec<(f64, f64)> {
        let tracer = Tracer::new(&self.volume, table, options).unwrap();
        let n = table.channels() * points.len();
        let (mut l, mut e) = (vec![0.0; n], vec![0.0; n]);
        tracer.radiance_with_error(points, 0, &mut l, &mut e, &Control::none()).unwrap();
        l.iter().zip(&e).map(|(&l, &e)| (f64::from(l), f64::from(e))).collect()
    }
}

/// A one-channel table of (sigma_s, sigma_a, g) rows.
pub fn table(rows: &[(f32, f32, f32)]) -> MaterialTable {
    let materials = rows
        .iter()
        .enumerate()
        .map(|(i, &(s, a, g))| Material {
            name: format!("m{i}"),
            sigma_s: vec![s],
            sigma_a: vec![a],
            g: g.into(),
        })
        .collect();
    MaterialTable::new(vec!["x".into()], materials).unwrap()
}

/// An index-matched surface.
pub fn matched(spp: u32) -> TraceOptions {
    TraceOptions { spp, seed: 5, boundary: Boundary::Matched, ..TraceOptions::default() }
}

/// A dielectric surface of index 1.5.
pub fn dielectric(spp: u32) -> TraceOptions {
    TraceOptions { spp, seed: 5, ..TraceOptions::default() }
}

/// A well mixed hash of a voxel.
pub fn hash(v: [u32; 3]) -> u64 {
    let mut h = u64::from(v[0]) ^ u64::from(v[1]) << 20 ^ u64::from(v[2]) << 40;
    for _ in 0..2 {
        h = (h ^ (h >> 31)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }
    h ^ (h >> 29)
}
