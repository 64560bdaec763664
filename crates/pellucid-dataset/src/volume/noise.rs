//! Deterministic noise over space: hashes, gradient noise and Voronoi cells.
//!
//! Neighbouring voxels mostly fall into the same noise cell, so the sources keep what they hashed for the last
//! one; that changes no value.

use pellucid_voxel::TILE;

/// Mixes four integers into 64 random bits.
pub fn hash(seed: u64, x: i64, y: i64, z: i64) -> u64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for v in [x, y, z] {
        h = (h ^ v as u64).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 32;
        h = h.wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        h ^= h >> 29;
    }
    h
}

/// The top bits of a hash as a number in 0..1.
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// Gradient noise (Perlin 2002) of unit feature size; about -1 to 1, zero mean.
#[derive(Clone, Debug)]
pub struct GradientNoise {
    seed: u64,
    cell: Option<[i64; 3]>,
    /// Direction numbers of the cell's corners, x fastest.
    corners: [u8; 8],
}

impl GradientNoise {
    /// The noise of a seed.
    pub fn new(seed: u64) -> Self {
        Self { seed, cell: None, corners: [0; 8] }
    }

    /// The value at a point.
    pub fn at(&mut self, p: [f64; 3]) -> f64 {
        let floor = p.map(f64::floor);
        let cell = floor.map(|v| v as i64);
        if self.cell != Some(cell) {
            self.cell = Some(cell);
            self.corners = std::array::from_fn(|i| {
                let i = i as i64;
                (hash(self.seed, cell[0] + (i & 1), cell[1] + (i >> 1 & 1), cell[2] + (i >> 2)) >> 60) as u8
            });
        }
        let f: [f64; 3] = std::array::from_fn(|a| p[a] - floor[a]);
        let fade = f.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
        let corner = |i: usize| {
            let [x, y, z] = [f[0] - (i & 1) as f64, f[1] - (i >> 1 & 1) as f64, f[2] - (i >> 2) as f64];
            let [a, b, c] = DIRECTIONS[usize::from(self.corners[i])];
            a * x + b * y + c * z
        };
        let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
        let edge = |i| mix(corner(i), corner(i + 1), fade[0]);
        let face = |i| mix(edge(i), edge(i + 2), fade[1]);
        mix(face(0), face(4), fade[2])
    }
}

/// The twelve edge directions of a cube, four of them twice.
const DIRECTIONS: [[f64; 3]; 16] = [
    [1.0, 1.0, 0.0],
    [-1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [-1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [-1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [-1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, -1.0, 1.0],
    [0.0, 1.0, -1.0],
    [0.0, -1.0, -1.0],
    [1.0, 1.0, 0.0],
    [0.0, -1.0, 1.0],
    [-1.0, 1.0, 0.0],
    [0.0, -1.0, -1.0],
];

/// Octaves of gradient noise, each of half the size and amplitude of the one before.
#[derive(Clone, Debug)]
pub struct FractalNoise {
    octaves: Vec<GradientNoise>,
    /// Scale of the first octave.
    first: f64,
}

impl FractalNoise {
    /// The noise of a seed.
    pub fn new(seed: u64, octaves: u32) -> Self {
        let octaves = (0..octaves).map(|o| GradientNoise::new(seed.wrapping_add(u64::from(o)))).collect();
        Self { octaves, first: 1.0 }
    }

    /// The noise of the first `count` octaves, and that of the others; their sum is the whole.
    pub fn split(mut self, count: usize) -> (Self, Self) {
        let count = count.min(self.octaves.len());
        let first = self.first * 2f64.powi(count as i32);
        let fine = Self { octaves: self.octaves.split_off(count), first };
        (self, fine)
    }

    /// Number of octaves.
    pub fn octaves(&self) -> usize {
        self.octaves.len()
    }

    /// The value at a point.
    pub fn at(&mut self, p: [f64; 3]) -> f64 {
        let mut scale = self.first;
        let mut sum = 0.0;
        for octave in &mut self.octaves {
            sum += octave.at(p.map(|v| v * scale)) / scale;
            scale *= 2.0;
        }
        sum
    }
}

/// Values at every fourth, second and fourth voxel of a tile along x, y and z, for smooth fields: what lies
/// between is interpolated linearly.
#[derive(Clone, Debug)]
pub struct Lattice(Box<[f32; LATTICE[0] * LATTICE[1] * LATTICE[2]]>);

const STEP: [usize; 3] = [4, 2, 4];
const LATTICE: [usize; 3] = [TILE / STEP[0] + 1, TILE / STEP[1] + 1, TILE / STEP[2] + 1];

impl Lattice {
    /// Voxels between its points along `[x, y, z]`.
    pub const STEP: [usize; 3] = STEP;

    /// Takes the values at voxel offsets from the tile's first voxel.
    pub fn new(mut value: impl FnMut([usize; 3]) -> f64) -> Self {
        Self(Box::new(std::array::from_fn(|i| {
            let at = [i % LATTICE[0], i / LATTICE[0] % LATTICE[1], i / LATTICE[0] / LATTICE[1]];
            value(std::array::from_fn(|a| at[a] * STEP[a])) as f32
        })))
    }

    /// The value at a voxel of the tile, each coordinate below 16.
    pub fn at(&self, local: [usize; 3]) -> f64 {
        let first: [usize; 3] = std::array::from_fn(|a| local[a] / STEP[a]);
        let t: [f32; 3] = std::array::from_fn(|a| (local[a] % STEP[a]) as f32 / STEP[a] as f32);
        let base = (first[2] * LATTICE[1] + first[1]) * LATTICE[0] + first[0];
        let mix = |a: f32, b: f32, t: f32| a + t * (b - a);
        let edge = |i: usize| mix(self.0[i], self.0[i + 1], t[0]);
        let face = |i: usize| mix(edge(i), edge(i + LATTICE[0]), t[1]);
        f64::from(mix(face(base), face(base + LATTICE[0] * LATTICE[1]), t[2]))
    }
}

/// Cells about one random point a unit cube.
#[derive(Clone, Debug)]
pub struct VoronoiCells {
    seed: u64,
    /// Twice the unit cube of the points in hand, rounded down: which half of it.
    half: Option<[i64; 3]>,
    points: [([f64; 3], u64); 8],
}

impl VoronoiCells {
    /// The cells of a seed.
    pub fn new(seed: u64) -> Self {
        Self { seed, half: None, points: [([0.0; 3], 0); 8] }
    }

    /// A number that tells apart the cells: that of the nearest point among the eight unit cubes nearest to
    /// `p`. A point farther off could be nearer still; cells are Voronoi's but for such corners.
    pub fn at(&mut self, p: [f64; 3]) -> u64 {
        let half = p.map(|v| (2.0 * v).floor() as i64);
        if self.half != Some(half) {
            self.half = Some(half);
            self.points = std::array::from_fn(|i| {
                let cell: [i64; 3] = std::array::from_fn(|a| ((half[a] + 1) >> 1) - 1 + (i as i64 >> a & 1));
                let h = hash(self.seed, cell[0], cell[1], cell[2]);
                let point = std::array::from_fn(|a| {
                    cell[a] as f64 + (h >> (21 * a) & 0x1f_ffff) as f64 / (1 << 21) as f64
                });
                (point, h)
            });
        }
        let mut best = (f64::INFINITY, 0);
        for (point, h) in &self.points {
            let distance = (0..3).map(|a| (point[a] - p[a]) * (point[a] - p[a])).sum::<f64>();
            if distance < best.0 {
                best = (distance, *h);
            }
        }
        hash(best.1, 1, 2, 3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_noise_is_continuous_and_centred() {
        let (mut sum, mut squares, mut steepest) = (0.0, 0.0, 0.0f64);
        let n = 20_000;
        let mut noise = GradientNoise::new(7);
        for i in 0..n {
            let p = [unit(hash(1, i, 0, 0)), unit(hash(1, i, 1, 0)), unit(hash(1, i, 2, 0))]
                .map(|u| u * 50.0 - 25.0);
            let v = noise.at(p);
            let w = noise.at([p[0] + 1e-4, p[1], p[2]]);
            assert!(v.abs() < 1.3);
            sum += v;
            squares += v * v;
            steepest = steepest.max((w - v).abs() / 1e-4);
        }
        let deviation = (squares / n as f64).sqrt();
        assert!((0.15..0.45).contains(&deviation), "{deviation}");
        // Four standard errors; neighbouring samples are far apart.
        assert!((sum / n as f64).abs() < 4.0 * deviation / (n as f64).sqrt());
        assert!(steepest < 8.0, "{steepest}");
    }

    #[test]
    fn a_lattice_is_exact_for_linear_fields() {
        let field = |v: [usize; 3]| v[0] as f64 * 0.5 - v[1] as f64 * 0.25 + v[2] as f64 * 2.0 - 3.0;
        let lattice = Lattice::new(field);
        for i in 0..TILE * TILE * TILE {
            let v = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            assert!((lattice.at(v) - field(v)).abs() < 1e-5, "{v:?}");
        }
    }

    #[test]
    fn values_do_not_depend_on_what_was_asked_before() {
        let (mut noise, mut cells) = (FractalNoise::new(5, 3), VoronoiCells::new(5));
        for i in 0..2000 {
            let p = [0, 1, 2].map(|a| unit(hash(2, i, a, 0)) * 4.0 - 2.0);
            assert_eq!(noise.at(p), FractalNoise::new(5, 3).at(p));
            let (mut coarse, mut fine) = noise.clone().split(2);
            assert_eq!((coarse.octaves(), fine.octaves()), (2, 1));
            assert!((coarse.at(p) + fine.at(p) - noise.at(p)).abs() < 1e-12);
            assert_eq!(cells.at(p), VoronoiCells::new(5).at(p));
        }
    }

    #[test]
    fn voronoi_cells_have_unit_volume_on_average() {
        let mut cells = VoronoiCells::new(3);
        let mut ids: Vec<u64> =
            (0..8000).map(|i| cells.at([i % 20, i / 20 % 20, i / 400].map(|v| f64::from(v) * 0.5))).collect();
        ids.sort_unstable();
        ids.dedup();
        // 10 x 10 x 10 units hold about a thousand whole cells and parts of those around.
        assert!((900..1800).contains(&ids.len()), "{}", ids.len());
    }
}
