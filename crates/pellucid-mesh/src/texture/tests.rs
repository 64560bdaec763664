use super::*;

#[test]
fn the_stated_size_covers_the_mip_chain() {
    for (width, height) in [(1, 1), (16, 4), (5, 3), (1, 64), (31, 2), (64, 64), (1000, 3), (7, 129)] {
        let image = Image::from_srgb8(width, height, vec![[0; 3]; (width * height) as usize]).unwrap();
        let held: usize = image
            .levels
            .iter()
            .map(|l| match &l.texels {
                Texels::Srgb8(t) => 3 * t.len(),
                Texels::Linear16(t) => 6 * t.len(),
                Texels::Grey8(t) => t.len(),
            })
            .sum();
        assert!(held as u64 <= Image::bytes(width, height, false), "{width} x {height}");
        let grey = Image::from_linear_grey8(width, height, vec![0; (width * height) as usize]).unwrap();
        let texels: u32 = grey.levels.iter().map(|l| l.width * l.height).sum();
        assert!(u64::from(texels) <= Image::grey_bytes(width, height), "{width} x {height}");
    }
}

#[test]
fn every_level_keeps_the_mean() {
    // Odd sides too, where two by two texels would leave a row out.
    let (width, height) = (13, 6);
    let texels: Vec<[u16; 3]> =
        (0..width * height).map(|i| [(i * 797) as u16, (i * i * 11) as u16, 65535]).collect();
    let image = Image::from_linear16(width, height, texels).unwrap();
    let mean = |l: &Level| -> [f64; 3] {
        let mut sum = [0.0; 3];
        for y in 0..l.height {
            for x in 0..l.width {
                let t = l.texel(x, y);
                (0..3).for_each(|c| sum[c] += t[c] / f64::from(l.width * l.height));
            }
        }
        sum
    };
    let expected = mean(&image.levels[0]);
    assert_eq!(image.levels.last().map(|l| (l.width, l.height)), Some((1, 1)));
    for level in &image.levels[1..] {
        let found = mean(level);
        assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 1e-4), "{found:?} is not {expected:?}");
    }
}

#[test]
fn principal_axes_of_a_turned_ellipse() {
    // Conjugate axes of an ellipse of 3 by 1 turned by 0.6, themselves turned by any angle.
    let (sin, cos) = 0.6f64.sin_cos();
    for angle in [0.0f64, 0.4, 1.3, 2.9] {
        let (s, c) = angle.sin_cos();
        let axis = |a: f64, b: f64| [3.0 * a * cos - b * sin, 3.0 * a * sin + b * cos];
        let (long, short) = principal_axes([axis(c, s), axis(-s, c)]);
        assert!((long[0] - 3.0 * cos).abs() < 1e-9 && (long[1] - 3.0 * sin).abs() < 1e-9, "{long:?}");
        assert!((short - 1.0).abs() < 1e-9);
    }
}
