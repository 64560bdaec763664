//! Singular values of a graded square matrix to high relative accuracy.

use nalgebra::{DMatrix, DVector};

const MAX_SWEEPS: usize = 60;

/// Singular values and right singular vectors (columns), by one-sided Jacobi rotations.
///
/// The layer matrices span 1/µ² over twelve decades; a tridiagonal QR loses the small singular
/// values (the diffusion mode) in the rounding of the large ones, Jacobi does not (Demmel and
/// Veselić 1992).
pub(crate) fn singular_values(mut x: DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let count = x.ncols();
    let mut v = DMatrix::identity(count, count);
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for p in 0..count {
            for q in p + 1..count {
                let (mut pp, mut qq, mut pq) = (0.0, 0.0, 0.0);
                for (a, b) in x.column(p).iter().zip(x.column(q).iter()) {
                    pp += a * a;
                    qq += b * b;
                    pq += a * b;
                }
                if pq * pq <= 1e-30 * pp * qq {
                    continue;
                }
                rotated = true;
                let zeta = (qq - pp) / (2.0 * pq);
                let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
                let cosine = 1.0 / (1.0 + t * t).sqrt();
                rotate(&mut x, p, q, cosine, cosine * t);
                rotate(&mut v, p, q, cosine, cosine * t);
            }
        }
        if !rotated {
            break;
        }
    }
    (DVector::from_iterator(count, x.column_iter().map(|column| column.norm())), v)
}

fn rotate(m: &mut DMatrix<f64>, p: usize, q: usize, cosine: f64, sine: f64) {
    let rows = m.nrows();
    let (left, right) = m.as_mut_slice().split_at_mut(q * rows);
    for (a, b) in left[p * rows..(p + 1) * rows].iter_mut().zip(&mut right[..rows]) {
        (*a, *b) = (cosine * *a - sine * *b, sine * *a + cosine * *b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_planted_values_over_twelve_decades() {
        // D C D with a well-conditioned C: the product of the singular values is |det|, and the
        // factors reproduce the matrix.
        let d = [1e6, 1e3, 1.0, 1e-3, 1e-6];
        let c =
            DMatrix::from_fn(5, 5, |i, j| if i == j { 1.0 } else { 0.1 / (1.0 + i as f64 + 2.0 * j as f64) });
        let determinant = c.determinant();
        let x = DMatrix::from_fn(5, 5, |i, j| d[i] * c[(i, j)] * d[j]);
        let (values, v) = singular_values(x.clone());
        let product: f64 = values.iter().product();
        assert!((product / determinant - 1.0).abs() < 1e-12, "{product} {determinant}");
        assert!((v.transpose() * &v - DMatrix::identity(5, 5)).norm() < 1e-13);
        let gram = v.transpose() * x.transpose() * x * v;
        for (i, s) in values.iter().enumerate().take(2) {
            assert!((gram[(i, i)] / (s * s) - 1.0).abs() < 1e-9);
        }
    }
}
