//! Small least squares on the probability simplex.

use super::MAX_MATERIALS;

const N: usize = MAX_MATERIALS;

/// A convex quadratic ½ xᵀ H x - bᵀ x in up to [`MAX_MATERIALS`] unknowns.
#[derive(Clone, Debug)]
pub(crate) struct Quadratic {
    pub count: usize,
    pub hessian: [[f64; N]; N],
    pub linear: [f64; N],
}

impl Quadratic {
    pub fn new(count: usize) -> Self {
        Self { count, hessian: [[0.0; N]; N], linear: [0.0; N] }
    }

    /// Adds ½ weight (row · x - value)².
    pub fn add_squared(&mut self, row: &[f64; N], value: f64, weight: f64) {
        for i in 0..self.count {
            for j in 0..self.count {
                self.hessian[i][j] += weight * row[i] * row[j];
            }
            self.linear[i] += weight * row[i] * value;
        }
    }

    /// The minimiser with x ≥ 0 and Σ x = 1, from a feasible start, by active sets: walk to the
    /// minimum on the free unknowns, stop at the first that vanishes, and free a vanished one
    /// where that lowers the value. Deterministic; the start is returned if the system is singular.
    pub fn minimise_on_simplex(&self, start: &[f64; N]) -> [f64; N] {
        let mut x = *start;
        let mut free = [false; N];
        for i in 0..self.count {
            free[i] = x[i] > 0.0;
        }
        for _ in 0..8 * self.count {
            let Some((target, multiplier)) = self.on_face(&free) else {
                return x;
            };
            let mut step = 1.0;
            let mut blocking = None;
            for i in 0..self.count {
                if free[i] && target[i] < 0.0 {
                    let reach = x[i] / (x[i] - target[i]);
                    if reach < step {
                        (step, blocking) = (reach, Some(i));
                    }
                }
            }
            for i in 0..self.count {
                if free[i] {
                    x[i] = (x[i] + step * (target[i] - x[i])).max(0.0);
                }
            }
            if let Some(i) = blocking {
                x[i] = 0.0;
                free[i] = false;
                continue;
            }
            let mut worst = None;
            let mut lowest = -1e-9 * (1.0 + multiplier.abs());
            for i in 0..self.count {
                if !free[i] {
                    let slope: f64 =
                        (0..self.count).map(|j| self.hessian[i][j] * x[j]).sum::<f64>() - self.linear[i];
                    if slope - multiplier < lowest {
                        lowest = slope - multiplier;
                        worst = Some(i);
                    }
                }
            }
            match worst {
                Some(i) => free[i] = true,
                None => break,
            }
        }
        x
    }

    /// Minimiser with Σ x = 1 over the free unknowns, and the slope common to them.
    fn on_face(&self, free: &[bool; N]) -> Option<([f64; N], f64)> {
        let mut index = [0; N];
        let mut size = 0;
        for i in 0..self.count {
            if free[i] {
                index[size] = i;
                size += 1;
            }
        }
        // Unknowns, then the multiplier; last column the right-hand side.
        let mut m = [[0.0; N + 2]; N + 1];
        for a in 0..size {
            for b in 0..size {
                m[a][b] = self.hessian[index[a]][index[b]];
            }
            m[a][size] = -1.0;
            m[a][size + 1] = self.linear[index[a]];
            m[size][a] = 1.0;
        }
        m[size][size + 1] = 1.0;
        let order = size + 1;
        for column in 0..order {
            let pivot = (column..order).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()))?;
            if m[pivot][column].abs() < 1e-300 {
                return None;
            }
            m.swap(column, pivot);
            for row in column + 1..order {
                let factor = m[row][column] / m[column][column];
                if factor != 0.0 {
                    for k in column..=order {
                        m[row][k] -= factor * m[column][k];
                    }
                }
            }
        }
        let mut solved = [0.0; N + 1];
        for row in (0..order).rev() {
            let known: f64 = (row + 1..order).map(|k| m[row][k] * solved[k]).sum();
            solved[row] = (m[row][order] - known) / m[row][row];
        }
        let mut x = [0.0; N];
        for a in 0..size {
            x[index[a]] = solved[a];
        }
        x.iter().all(|v| v.is_finite()).then_some((x, solved[size]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn projects_onto_the_simplex() {
        let mut q = Quadratic::new(3);
        for (i, v) in [0.9, 0.4, -0.5].into_iter().enumerate() {
            let mut row = [0.0; N];
            row[i] = 1.0;
            q.add_squared(&row, v, 1.0);
        }
        let mut start = [0.0; N];
        start[2] = 1.0;
        let x = q.minimise_on_simplex(&start);
        assert!((x[0] - 0.75).abs() < 1e-12 && (x[1] - 0.25).abs() < 1e-12 && x[2] == 0.0, "{x:?}");
    }

    proptest! {
        /// Against the optimality conditions, which are sufficient for a convex problem.
        #[test]
        fn satisfies_the_optimality_conditions(
            rows in proptest::collection::vec((proptest::array::uniform8(-1.0_f64..1.0), -2.0_f64..2.0), 1..6),
            count in 2_usize..=N, corner in 0_usize..N,
        ) {
            let mut q = Quadratic::new(count);
            for (row, value) in &rows {
                q.add_squared(row, *value, 1.0);
            }
            for i in 0..count {
                let mut row = [0.0; N];
                row[i] = 1.0;
                q.add_squared(&row, 0.0, 1e-3);
            }
            let mut start = [0.0; N];
            start[corner % count] = 1.0;
            let x = q.minimise_on_simplex(&start);
            prop_assert!((x.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let slope: Vec<f64> = (0..count)
                .map(|i| (0..count).map(|j| q.hessian[i][j] * x[j]).sum::<f64>() - q.linear[i])
                .collect();
            let lowest = slope.iter().copied().fold(f64::INFINITY, f64::min);
            for i in 0..count {
                prop_assert!(x[i] >= 0.0);
                prop_assert!(x[i] < 1e-9 || slope[i] - lowest < 1e-6, "{x:?} {slope:?}");
            }
        }
    }
}
