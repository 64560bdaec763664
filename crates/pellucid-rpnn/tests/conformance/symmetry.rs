//! The symmetry of octants.

use pellucid_rpnn::variant::{
    CELLS_XYZ, FEATURES, Head, LEVEL_INPUTS, LEVELS, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use pellucid_rpnn::{Network, Precision, Variant};

use super::common::{inputs, weights};

/// Mirrors every level of a sample along the axes of `mask` (bit 0 = x).
fn mirrored(sample: &[f32], mask: usize) -> Vec<f32> {
    let [nx, ny, nz] = CELLS_XYZ;
    let mut out = vec![0.0; sample.len()];
    for k in 0..sample.len() / LEVEL_INPUTS {
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let flip =
                        |axis: usize, n: usize, i: usize| if mask >> axis & 1 == 1 { n - 1 - i } else { i };
                    let from = (flip(2, nz, z) * ny + flip(1, ny, y)) * nx + flip(0, nx, x);
                    let to = (z * ny + y) * nx + x;
                    for f in 0..FEATURES {
                        out[(k * 135 + to) * FEATURES + f] = sample[(k * 135 + from) * FEATURES + f];
                    }
                }
            }
        }
    }
    out
}

#[test]
fn mirroring_exchanges_octants_exactly() {
    let x = inputs(1, 3);
    for mask in 0..OCTANTS {
        let m = mirrored(&x, mask);
        for octant in 0..OCTANTS {
            for (a, b) in octant_gather(octant).into_iter().zip(octant_gather(octant ^ mask)) {
                for k in 0..LEVELS {
                    assert_eq!(m[k * LEVEL_INPUTS + usize::from(a)], x[k * LEVEL_INPUTS + usize::from(b)]);
                }
            }
        }
    }
    assert_eq!(OCTANT_INPUTS, octant_gather(0).len());
}

/// The 480-wide layers mix octants freely, so one evaluation is not invariant; the mean over the eight
/// mirrors is, because it sums the same eight numbers.
#[test]
fn the_mean_over_mirrors_is_invariant_and_one_evaluation_is_not() {
    let variant = Variant::SharedLevelsAndOctants;
    let weights = weights(variant, Head::Radiance, 4);
    let mut network = Network::new(variant, Head::Radiance, 8, Precision::F32).unwrap();
    network.load(&weights).unwrap();
    let mut over_mirrors = |x: &[f32]| {
        let all: Vec<f32> = (0..8).flat_map(|m| mirrored(x, m)).collect();
        let mut out = vec![0.0; 8];
        network.forward(&all, &mut out).unwrap();
        out
    };
    let x = inputs(1, 6);
    let plain = over_mirrors(&x);
    let spread = plain.iter().fold(0.0f32, |s, v| s.max((v - plain[0]).abs()));
    assert!(spread > 1e-3, "octants should mix; spread {spread}");
    let mut sorted = plain.clone();
    sorted.sort_by(f32::total_cmp);
    for mask in 1..8 {
        let mut other = over_mirrors(&mirrored(&x, mask));
        other.sort_by(f32::total_cmp);
        assert_eq!(sorted, other, "the same eight evaluations in another order");
    }
}
