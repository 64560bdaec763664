//! The sixteen lanes in plain Rust: the kernel's scalar twin.

use std::array::from_fn;

use super::lanes::Lanes;
use crate::rng::{PCG_INCREMENT, PCG_MULTIPLIER};

/// Runs anywhere.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

impl Lanes for Portable {
    type F = [f32; 16];
    type I = [u32; 16];
    type W = [u64; 16];
    type M = u16;

    fn splat(self, v: f32) -> [f32; 16] {
        [v; 16]
    }
    fn load(self, v: &[f32; 16]) -> [f32; 16] {
        *v
    }
    fn store(self, v: [f32; 16]) -> [f32; 16] {
        v
    }
    fn add(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| a[i] + b[i])
    }
    fn sub(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| a[i] - b[i])
    }
    fn mul(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| a[i] * b[i])
    }
    fn div(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| a[i] / b[i])
    }
    fn fma(self, a: [f32; 16], b: [f32; 16], c: [f32; 16]) -> [f32; 16] {
        from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    fn fnma(self, a: [f32; 16], b: [f32; 16], c: [f32; 16]) -> [f32; 16] {
        from_fn(|i| (-a[i]).mul_add(b[i], c[i]))
    }
    fn min(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    fn max(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    fn sqrt(self, a: [f32; 16]) -> [f32; 16] {
        a.map(f32::sqrt)
    }
    fn abs(self, a: [f32; 16]) -> [f32; 16] {
        a.map(f32::abs)
    }
    fn lt(self, a: [f32; 16], b: [f32; 16]) -> u16 {
        (0..16).fold(0, |m, i| m | (u16::from(a[i] < b[i]) << i))
    }
    fn le(self, a: [f32; 16], b: [f32; 16]) -> u16 {
        (0..16).fold(0, |m, i| m | (u16::from(a[i] <= b[i]) << i))
    }
    fn select(self, m: u16, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        from_fn(|i| if m >> i & 1 != 0 { a[i] } else { b[i] })
    }
    fn lookup(self, table: [f32; 16], i: [u32; 16]) -> [f32; 16] {
        i.map(|i| table[(i & 15) as usize])
    }
    fn splat_i(self, v: u32) -> [u32; 16] {
        [v; 16]
    }
    fn load_i(self, v: &[u32; 16]) -> [u32; 16] {
        *v
    }
    fn store_i(self, v: [u32; 16]) -> [u32; 16] {
        v
    }
    fn add_i(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i].wrapping_add(b[i]))
    }
    fn sub_i(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i].wrapping_sub(b[i]))
    }
    fn mul_i(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i].wrapping_mul(b[i]))
    }
    fn and_i(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i] & b[i])
    }
    fn or_i(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i] | b[i])
    }
    fn shl<const N: u32>(self, a: [u32; 16]) -> [u32; 16] {
        a.map(|v| v << N)
    }
    fn shr<const N: u32>(self, a: [u32; 16]) -> [u32; 16] {
        a.map(|v| v >> N)
    }
    fn shr_by(self, a: [u32; 16], n: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i] >> (n[i] & 31))
    }
    fn min_u(self, a: [u32; 16], b: [u32; 16]) -> [u32; 16] {
        from_fn(|i| a[i].min(b[i]))
    }
    fn eq_i(self, a: [u32; 16], b: [u32; 16]) -> u16 {
        (0..16).fold(0, |m, i| m | (u16::from(a[i] == b[i]) << i))
    }
    fn to_i(self, a: [f32; 16]) -> [u32; 16] {
        a.map(|v| if v.abs() < 2_147_483_648.0 { v as i32 as u32 } else { 1 << 31 })
    }
    fn to_f(self, a: [u32; 16]) -> [f32; 16] {
        a.map(|v| v as i32 as f32)
    }
    fn bits(self, a: [f32; 16]) -> [u32; 16] {
        a.map(f32::to_bits)
    }
    fn floats(self, a: [u32; 16]) -> [f32; 16] {
        a.map(f32::from_bits)
    }
    unsafe fn gather(self, words: &[u32], i: [u32; 16]) -> [u32; 16] {
        i.map(|i| words[i as usize])
    }
    fn load_w(self, v: &[u64; 16]) -> [u64; 16] {
        *v
    }
    fn select_w(self, m: u16, a: [u64; 16], b: [u64; 16]) -> [u64; 16] {
        from_fn(|i| if m >> i & 1 != 0 { a[i] } else { b[i] })
    }
    fn draw(self, state: [u64; 16]) -> ([u64; 16], [u32; 16]) {
        let out = state.map(|s| ((((s >> 18) ^ s) >> 27) as u32).rotate_right((s >> 59) as u32));
        (state.map(|s| s.wrapping_mul(PCG_MULTIPLIER).wrapping_add(PCG_INCREMENT)), out)
    }
    fn mask(self, bits: u16) -> u16 {
        bits
    }
    fn mask_bits(self, m: u16) -> u16 {
        m
    }
    fn and(self, a: u16, b: u16) -> u16 {
        a & b
    }
    fn and_not(self, a: u16, b: u16) -> u16 {
        a & !b
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::math::{neg_ln, sin_cos_turn, unit};

    #[test]
    fn elementary_functions_keep_their_stated_errors() {
        for k in 0..20_000u32 {
            let bits = k.wrapping_mul(0x9E37_79B9) ^ (k << 3);
            let u = unit(Portable, [bits; 16])[0];
            assert!(u > 0.0 && u < 1.0);
            let exact = -f64::from(u).ln();
            let got = f64::from(neg_ln(Portable, [u; 16])[0]);
            assert!((got - exact).abs() <= 3e-7 * exact.max(1.0), "-ln {u}: {got} for {exact}");
            let (s, c) = sin_cos_turn(Portable, [u - 0.5; 16]);
            let (es, ec) = (std::f64::consts::TAU * f64::from(u - 0.5)).sin_cos();
            assert!((f64::from(s[0]) - es).abs() < 1e-6 && (f64::from(c[0]) - ec).abs() < 1e-6, "{u}");
        }
        for u in [2f32.powi(-24), 1.0 - 2f32.powi(-24)] {
            let got = f64::from(neg_ln(Portable, [u; 16])[0]);
            assert!(got > 0.0 && (got + f64::from(u).ln()).abs() < 2e-6, "{u}: {got}");
        }
    }

    #[test]
    fn draws_are_rand_pcgs() {
        use rand_core::Rng;
        let mut reference = crate::rng::path_rng(99, 3);
        let seeded = crate::rng::path_state(99, 3)
            .wrapping_add(PCG_INCREMENT)
            .wrapping_mul(PCG_MULTIPLIER)
            .wrapping_add(PCG_INCREMENT);
        let mut state = [seeded; 16];
        for _ in 0..100 {
            let (next, out) = Portable.draw(state);
            state = next;
            assert_eq!(out, [reference.next_u32(); 16]);
        }
    }
}
