//! The plain form: eight look-ups a corner.

use pellucid_voxel::TILE;

use super::{Plane, Sums, widened};
use crate::axis::{Kind, Position};

pub(super) fn corner_sums(plane: &Plane, sums: &mut [Sums]) {
    let (nx, ny) = (plane.xs.len(), plane.ys.len());
    for (p, sums) in sums.chunks_exact_mut(nx * ny).enumerate() {
        match plane.z[p].kind {
            Kind::Zero => sums.fill([0; 8]),
            Kind::Same => {}
            Kind::Fresh => {
                for j in 0..ny {
                    for i in 0..nx {
                        let (x, y) = (&plane.xs[i][p], &plane.ys[j][p]);
                        sums[j * nx + i] = match (x.kind, y.kind) {
                            (Kind::Zero, _) | (_, Kind::Zero) => [0; 8],
                            (Kind::Same, _) => sums[j * nx + i - 1],
                            (_, Kind::Same) => sums[(j - 1) * nx + i],
                            _ => around(plane, [x, y, &plane.z[p]]),
                        };
                    }
                }
            }
        }
    }
}

/// The sum over the voxel corners around a corner.
fn around(plane: &Plane, at: [&Position; 3]) -> Sums {
    let base = at.map(|p| p.tile * TILE as u32 + u32::from(p.local));
    let mut sum = [0u32; 8];
    for step in 0..8u32 {
        let corner = std::array::from_fn(|a| base[a] + (step >> a & 1));
        let counts = widened(plane.tables.prefix(corner));
        for (sum, count) in sum.iter_mut().zip(counts) {
            *sum = sum.wrapping_add(count);
        }
    }
    sum
}
