//! Deterministic noise over space: hashes, gradient noise and Voronoi cells.

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
pub fn gradient_noise(seed: u64, p: [f64; 3]) -> f64 {
    let cell = p.map(f64::floor);
    let f: [f64; 3] = std::array::from_fn(|a| p[a] - cell[a]);
    let fade = f.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let corner = |dx: i64, dy: i64, dz: i64| {
        let h = hash(seed, cell[0] as i64 + dx, cell[1] as i64 + dy, cell[2] as i64 + dz);
        let (x, y, z) = (f[0] - dx as f64, f[1] - dy as f64, f[2] - dz as f64);
        // The twelve edge directions of a cube, four of them twice.
        match h >> 60 {
            0 | 12 => x + y,
            1 | 14 => -x + y,
            2 => x - y,
            3 => -x - y,
            4 => x + z,
            5 => -x + z,
            6 => x - z,
            7 => -x - z,
            8 => y + z,
            9 | 13 => -y + z,
            10 => y - z,
            _ => -y - z,
        }
    };
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let edge = |dy, dz| mix(corner(0, dy, dz), corner(1, dy, dz), fade[0]);
    let face = |dz| mix(edge(0, dz), edge(1, dz), fade[1]);
    mix(face(0), face(1), fade[2])
}

/// `octaves` of gradient noise, each of half the size and amplitude of the one before.
pub fn fractal_noise(seed: u64, p: [f64; 3], octaves: u32) -> f64 {
    (0..octaves)
        .map(|o| {
            let scale = f64::from(1u32 << o);
            gradient_noise(seed.wrapping_add(u64::from(o)), p.map(|v| v * scale)) / scale
        })
        .sum()
}

/// The hash of the nearest of one random point a unit cell.
pub fn voronoi_cell(seed: u64, p: [f64; 3]) -> u64 {
    let base = p.map(|v| v.floor() as i64);
    let mut best = (f64::INFINITY, 0);
    for dz in -1..=1 {
        for dy in -1..=1 {
            for dx in -1..=1 {
                let cell = [base[0] + dx, base[1] + dy, base[2] + dz];
                let h = hash(seed, cell[0], cell[1], cell[2]);
                let distance: f64 = (0..3)
                    .map(|a| {
                        let jitter = (h >> (21 * a) & 0x1f_ffff) as f64 / (1 << 21) as f64;
                        (cell[a] as f64 + jitter - p[a]).powi(2)
                    })
                    .sum();
                if distance < best.0 {
                    best = (distance, h);
                }
            }
        }
    }
    hash(best.1, 1, 2, 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_noise_is_continuous_and_centred() {
        let (mut sum, mut squares, mut steepest) = (0.0, 0.0, 0.0f64);
        let n = 20_000;
        for i in 0..n {
            let p =
                [unit(hash(1, i, 0, 0)), unit(hash(1, i, 1, 0)), unit(hash(1, i, 2, 0))].map(|u| u * 50.0);
            let v = gradient_noise(7, p);
            let w = gradient_noise(7, [p[0] + 1e-4, p[1], p[2]]);
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
    fn voronoi_cells_have_unit_volume_on_average() {
        let mut ids: Vec<u64> = (0..8000)
            .map(|i| voronoi_cell(3, [i % 20, i / 20 % 20, i / 400].map(|v| f64::from(v) * 0.5)))
            .collect();
        ids.sort_unstable();
        ids.dedup();
        // 10 x 10 x 10 units hold about a thousand whole cells and parts of those around.
        assert!((900..1800).contains(&ids.len()), "{}", ids.len());
    }
}
