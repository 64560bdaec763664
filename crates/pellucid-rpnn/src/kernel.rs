//! Bounds-checked views over the `gemm` crate's raw matrix product. All of this crate's unsafe code.
#![allow(unsafe_code, reason = "gemm takes raw pointers; `product` checks every extent first")]

/// A read-only strided matrix.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    row_stride: usize,
    col_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Rows of `cols` consecutive values, `row_stride` apart.
    pub(crate) fn rows(data: &'a [f32], rows: usize, cols: usize, row_stride: usize) -> Self {
        assert!(
            rows == 0 || cols == 0 || (rows - 1) * row_stride + cols <= data.len(),
            "matrix exceeds its data"
        );
        Self { data, rows, cols, row_stride, col_stride: 1 }
    }

    /// The transposed view.
    pub(crate) fn t(self) -> Self {
        Self {
            rows: self.cols,
            cols: self.rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
            ..self
        }
    }
}

/// `out = left right`, or `out += left right` when `accumulate`. `out` is dense row-major.
pub(crate) fn product(out: &mut [f32], accumulate: bool, left: Matrix<'_>, right: Matrix<'_>) {
    assert_eq!(left.cols, right.rows, "inner extents differ");
    assert_eq!(out.len(), left.rows * right.cols, "output extent differs");
    // SAFETY: `Matrix::rows` proved that every (row, col) of both operands lies in its slice, `t` only
    // swaps the axes, and the output is dense with exactly left.rows x right.cols elements. The exclusive
    // borrow of `out` keeps it apart from the operands.
    unsafe {
        gemm::gemm(
            left.rows,
            right.cols,
            left.cols,
            out.as_mut_ptr(),
            1,
            right.cols as isize,
            accumulate,
            left.data.as_ptr(),
            left.col_stride as isize,
            left.row_stride as isize,
            right.data.as_ptr(),
            right.col_stride as isize,
            right.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_sums() {
        let a: Vec<f32> = (0..35).map(|i| (i as f32 * 0.7).sin()).collect();
        let b: Vec<f32> = (0..28).map(|i| (i as f32 * 1.3).cos()).collect();
        // 3 x 5 of a with stride 7, times the transpose of 4 x 5 of b with stride 7.
        let (left, right) = (Matrix::rows(&a, 3, 5, 7), Matrix::rows(&b, 4, 5, 7).t());
        let mut out = vec![1.0; 12];
        product(&mut out, true, left, right);
        for i in 0..3 {
            for j in 0..4 {
                let sum: f32 = (0..5).map(|k| a[i * 7 + k] * b[j * 7 + k]).sum();
                assert!((out[i * 4 + j] - 1.0 - sum).abs() < 1e-5);
            }
        }
        product(&mut out, false, left, right);
        let sum: f32 = (0..5).map(|k| a[k] * b[k]).sum();
        assert!((out[0] - sum).abs() < 1e-5);
    }

    #[test]
    #[should_panic(expected = "matrix exceeds its data")]
    fn extents_are_checked() {
        Matrix::rows(&[0.0; 10], 2, 5, 6);
    }
}
