//! Texture look-up against naive counterparts.

use std::sync::Arc;

use pellucid_mesh::{Filter, Image, Mip, Sampler, Texture, Wrap};
use proptest::prelude::*;

fn texture(width: u32, height: u32, texels: Vec<[u16; 3]>, sampler: Sampler) -> Texture {
    Texture::new(Arc::new(Image::from_linear16(width, height, texels).unwrap()), sampler)
}

fn ramp(width: u32, height: u32) -> Vec<[u16; 3]> {
    (0..width * height).map(|i| [(i * 4099 % 65536) as u16, (i * 257 % 65536) as u16, 7]).collect()
}

/// Index of texel `i` of a row of `n`, laid out by hand.
fn naive_wrap(i: i64, n: i64, mode: Wrap) -> usize {
    let line: Vec<i64> = match mode {
        Wrap::Repeat => (0..n).collect(),
        Wrap::Mirrored => (0..n).chain((0..n).rev()).collect(),
        Wrap::Clamp => return i.clamp(0, n - 1) as usize,
    };
    line[i.rem_euclid(line.len() as i64) as usize] as usize
}

fn modes() -> impl Strategy<Value = Wrap> {
    prop_oneof![Just(Wrap::Repeat), Just(Wrap::Mirrored), Just(Wrap::Clamp)]
}

proptest! {
    #[test]
    fn nearest_texels_wrap_as_laid_out(
        (width, height) in (1u32..9, 1u32..9),
        (u, v) in (-3.0f32..3.0, -3.0f32..3.0),
        (wrap_u, wrap_v) in (modes(), modes()),
    ) {
        let sampler = Sampler { wrap_u, wrap_v, magnify: Filter::Nearest, ..Sampler::default() };
        let texels = ramp(width, height);
        let x = naive_wrap((f64::from(u) * f64::from(width)).floor() as i64, width.into(), wrap_u);
        let y = naive_wrap((f64::from(v) * f64::from(height)).floor() as i64, height.into(), wrap_v);
        let expected = texels[y * width as usize + x].map(|c| (f64::from(c) / 65535.0) as f32);
        prop_assert_eq!(texture(width, height, texels, sampler).sample([u, v], 0.0), expected);
    }

    #[test]
    fn bilinear_weighs_the_four_nearest_texels(
        (width, height) in (1u32..9, 1u32..9),
        (u, v) in (-2.0f32..2.0, -2.0f32..2.0),
        (wrap_u, wrap_v) in (modes(), modes()),
    ) {
        let sampler = Sampler { wrap_u, wrap_v, ..Sampler::default() };
        let texels = ramp(width, height);
        let (px, py) = (f64::from(u) * f64::from(width), f64::from(v) * f64::from(height));
        let mut expected = 0.0;
        for x in (px - 2.0) as i64 - 1..(px + 3.0) as i64 {
            for y in (py - 2.0) as i64 - 1..(py + 3.0) as i64 {
                let tent = |p: f64, i: i64| (1.0 - (p - (i as f64 + 0.5)).abs()).max(0.0);
                let at = naive_wrap(y, height.into(), wrap_v) * width as usize + naive_wrap(x, width.into(), wrap_u);
                expected += tent(px, x) * tent(py, y) * f64::from(texels[at][0]) / 65535.0;
            }
        }
        let found = texture(width, height, texels, sampler).sample([u, v], 1.0)[0];
        prop_assert!((f64::from(found) - expected).abs() < 1e-5, "{found} is not {expected}");
    }

    #[test]
    fn no_coordinates_or_footprint_break_it(
        u in proptest::num::f32::ANY,
        v in proptest::num::f32::ANY,
        axes in proptest::array::uniform4(proptest::num::f64::ANY),
        (wrap_u, mip) in (modes(), prop_oneof![Just(Mip::Nearest), Just(Mip::Linear)]),
    ) {
        let texture = texture(5, 3, ramp(5, 3), Sampler { wrap_u, mip, ..Sampler::default() });
        for color in [
            texture.sample([u, v], axes[0]),
            texture.sample_anisotropic([u, v], [[axes[0], axes[1]], [axes[2], axes[3]]]),
        ] {
            prop_assert!(color.iter().all(|c| (0.0..=1.0).contains(c)), "{color:?}");
        }
    }
}

#[test]
fn larger_footprints_move_towards_the_mean_without_a_step() {
    let texels = ramp(64, 64);
    let mean = texels.iter().map(|t| f64::from(t[0]) / 65535.0).sum::<f64>() / texels.len() as f64;
    let texture = texture(64, 64, texels, Sampler::default());
    let at = |footprint: f64| f64::from(texture.sample([0.37, 0.61], footprint)[0]);
    assert!((at(64.0) - mean).abs() < 1e-4 && at(1e6) == at(64.0));
    let mut last = at(1.0);
    for step in 1..=600 {
        let next = at(2f64.powf(f64::from(step) * 0.01));
        assert!((next - last).abs() < 0.02, "a step of {} at 2^{}", next - last, f64::from(step) * 0.01);
        last = next;
    }
}

#[test]
fn the_nearest_level_is_taken_where_the_sampler_says_so() {
    let mut texels = vec![[0; 3]; 16];
    texels[5] = [65535; 3];
    let sampler = Sampler { minify: Filter::Nearest, mip: Mip::Nearest, ..Sampler::default() };
    let texture = texture(4, 4, texels, sampler);
    // Texel (1, 1) lies in the first of the four texels of level 1, and in level 2's only one.
    let at = |footprint| texture.sample([0.3, 0.3], footprint)[0];
    assert!((at(2.0) - 0.25).abs() < 1e-4 && (at(2.7) - 0.25).abs() < 1e-4);
    assert!((at(2.9) - 0.0625).abs() < 1e-4 && (at(100.0) - 0.0625).abs() < 1e-4);
}

#[test]
fn a_long_footprint_blurs_along_itself_only() {
    // Columns of 16 texels black and white: blur along v keeps them, along u it does not.
    let texels: Vec<[u16; 3]> =
        (0..128 * 128).map(|i| [if i % 128 / 16 % 2 == 0 { 0 } else { 65535 }; 3]).collect();
    let texture = texture(128, 128, texels, Sampler::default());
    let (thin, long) = (1.0 / 128.0, 64.0 / 128.0);
    let along_v = texture.sample_anisotropic([8.0 / 128.0, 0.5], [[thin, 0.0], [0.0, long]]);
    assert!(along_v[0] < 1e-3, "{along_v:?}");
    let along_u = texture.sample_anisotropic([8.0 / 128.0, 0.5], [[long, 0.0], [0.0, thin]]);
    assert!((along_u[0] - 0.5).abs() < 0.02, "{along_u:?}");
}

#[test]
fn wrong_sizes_are_refused() {
    assert!(Image::from_srgb8(0, 1, vec![]).is_err());
    assert!(Image::from_srgb8(2, 2, vec![[0; 3]; 3]).is_err());
    assert!(Image::from_linear16(u32::MAX, u32::MAX, vec![[0; 3]]).is_err());
}
