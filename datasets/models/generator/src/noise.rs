//! Hash noise in space, the same on every machine.

use crate::vec3::V3;

/// A number in 0..1 from integer coordinates and a seed.
pub fn hash(cell: [i64; 3], seed: u64) -> f64 {
    let mut h = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for c in cell {
        h = (h ^ c as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h ^= h >> 29;
    }
    h = h.wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth value noise in 0..1 with features of one unit.
pub fn value(p: V3, seed: u64) -> f64 {
    let base = p.map(f64::floor);
    let f: V3 = std::array::from_fn(|a| crate::vec3::smoothstep(0.0, 1.0, p[a] - base[a]));
    let cell = base.map(|b| b as i64);
    (0..8).fold(0.0, |sum, k| {
        let weight: f64 = (0..3).map(|a| if k >> a & 1 == 1 { f[a] } else { 1.0 - f[a] }).product();
        sum + weight * hash(std::array::from_fn(|a| cell[a] + (k >> a & 1)), seed)
    })
}

/// Distances to the nearest and second nearest of one random point a unit cell, and the nearest
/// point's own number in 0..1.
pub fn cellular(p: V3, seed: u64) -> (f64, f64, f64) {
    let base = p.map(|v| v.floor() as i64);
    let (mut first, mut second, mut id) = (f64::INFINITY, f64::INFINITY, 0.0);
    for k in 0..27 {
        let cell = [base[0] + k % 3 - 1, base[1] + k / 3 % 3 - 1, base[2] + k / 9 - 1];
        let point: V3 = std::array::from_fn(|a| cell[a] as f64 + hash(cell, seed + 1 + a as u64));
        let d = crate::vec3::length(crate::vec3::sub(point, p));
        if d < first {
            second = first;
            (first, id) = (d, hash(cell, seed));
        } else {
            second = second.min(d);
        }
    }
    (first, second, id)
}
