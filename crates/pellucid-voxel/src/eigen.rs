//! Eigenvalues of symmetric 3 x 3 matrices.

/// Eigenvalues, ascending, and unit eigenvectors of the symmetric matrix with entries
/// xx, yy, zz, xy, xz, yz, by cyclic Jacobi rotations.
pub(crate) fn symmetric_eigen([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let scale = (xx.abs() + yy.abs() + zz.abs()).max(f64::MIN_POSITIVE);
    // Convergence is quadratic; a handful of sweeps reach the last bit.
    for _ in 0..12 {
        if a[0][1].abs() + a[0][2].abs() + a[1][2].abs() <= 1e-15 * scale {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for k in 0..3 {
                let (kp, kq) = (a[k][p], a[k][q]);
                a[k][p] = c * kp - s * kq;
                a[k][q] = s * kp + c * kq;
            }
            for k in 0..3 {
                let (pk, qk) = (a[p][k], a[q][k]);
                a[p][k] = c * pk - s * qk;
                a[q][k] = s * pk + c * qk;
                let (kp, kq) = (v[k][p], v[k][q]);
                v[k][p] = c * kp - s * kq;
                v[k][q] = s * kp + c * kq;
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| [v[0][i], v[1][i], v[2][i]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rebuilds_the_matrix(
            m in prop::array::uniform6(prop_oneof![Just(0.0), Just(1.0), -10.0f64..10.0]),
            scale in prop_oneof![Just(1.0), Just(1e-9), Just(1e12)],
        ) {
            let m = m.map(|e| e * scale);
            let (values, vectors) = symmetric_eigen(m);
            prop_assert!(values[0] <= values[1] && values[1] <= values[2]);
            let [xx, yy, zz, xy, xz, yz] = m;
            let full = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            for i in 0..3 {
                for j in 0..3 {
                    let rebuilt: f64 = (0..3).map(|k| values[k] * vectors[k][i] * vectors[k][j]).sum();
                    prop_assert!((rebuilt - full[i][j]).abs() <= 1e-12 * 40.0 * scale);
                    let dot: f64 = (0..3).map(|k| vectors[i][k] * vectors[j][k]).sum();
                    prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }
    }
}
