//! The products in AVX-512. All of this crate's unsafe code.
#![allow(unsafe_code, reason = "vector intrinsics; `product` proves every extent that the tiles rely on")]

use std::arch::x86_64::*;

use super::optimiser::{self, Update};
use super::{Add, Finish, Left, Matrix, PANEL, Packed, TILE_ROWS, Target, Words, features, pack};
use crate::Precision;

/// Proof that this machine has the instructions used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Proof {
    /// Whether it multiplies bf16.
    bf16: bool,
}

impl Proof {
    /// `None` on machines without AVX-512. Products of bf16 are made by f32 ones unless `bf16` allows for them.
    pub(super) fn detect(bf16: bool) -> Option<Self> {
        let all = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("fma");
        all.then(|| Self { bf16: bf16 && is_x86_feature_detected!("avx512bf16") })
    }

    /// Whether it multiplies bf16.
    pub(super) fn bf16(self) -> bool {
        self.bf16
    }
}

/// Defines a safe function that runs a plain one compiled for AVX-512.
macro_rules! compiled_for_avx512 {
    ($module:ident::$name:ident($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        pub(super) fn $name(_: Proof, $($arg: $type),*) $(-> $out)? {
            #[target_feature(enable = "avx512f,avx512bw,avx512vl,fma")]
            fn compiled($($arg: $type),*) $(-> $out)? {
                $module::$name($($arg),*)
            }
            // SAFETY: the proof says that the machine has these features.
            unsafe { compiled($($arg),*) }
        }
    };
}

compiled_for_avx512!(pack::pack_right(right: Matrix<'_>, packed: &mut Packed));
compiled_for_avx512!(pack::pack_left(left: Matrix<'_>, words: &mut [u32]));
compiled_for_avx512!(pack::add_rows(values: &[f32], sums: &mut [f32]));
compiled_for_avx512!(features::log_features(level: &mut [f32], scale: f32));

compiled_for_avx512!(optimiser::sum_of_squares(values: &[f32]) -> f64);
compiled_for_avx512!(optimiser::update(
    u: Update,
    parameters: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    average: &mut [f32]
));

/// `target = left right`, finished.
pub(super) fn product(proof: Proof, target: Target<'_>, left: Left<'_>, right: &Packed) {
    let (rows, cols, steps) = (left.rows, target.cols, right.steps);
    if rows == 0 || cols == 0 {
        return;
    }
    assert!(
        steps == 0 || (rows - 1) * left.row_stride + (steps - 1) * left.step_stride < left.len(),
        "the left factor is too short"
    );
    assert!(cols.div_ceil(PANEL) * steps * PANEL <= right.words.len(), "the right factor is too short");
    assert!(target.out.len() == rows * cols, "the output has another extent");
    let dense = |m: Option<&[f32]>, len: usize| m.is_none_or(|m| m.len() == len);
    let other = if let Add::Other(m) = target.finish.add { Some(m) } else { None };
    assert!(
        dense(other, rows * cols)
            && dense(target.finish.mask, rows * cols)
            && dense(target.finish.bias, cols),
        "a finish of another extent"
    );
    let work = Work {
        out: target.out.as_mut_ptr(),
        cols,
        steps,
        left: left.as_ptr(),
        row_stride: left.row_stride,
        step_stride: left.step_stride,
        add: match target.finish.add {
            Add::Nothing => std::ptr::null(),
            Add::Output => target.out.as_ptr(),
            Add::Other(other) => other.as_ptr(),
        },
        finish: target.finish,
    };
    for p in 0..cols.div_ceil(PANEL) {
        let panel = &right.words[p * steps * PANEL..(p + 1) * steps * PANEL];
        let mut row = 0;
        while row < rows {
            let n = TILE_ROWS.min(rows - row);
            // SAFETY: the machine has the features by the proof; the assertions above show that rows
            // `row..row + n` of the left factor, the output and the finish, and the panel's `steps * PANEL`
            // words, lie within their slices; tiles mask off columns from `cols` on.
            unsafe {
                match (right.precision, proof.bf16) {
                    (Precision::F32, _) => work.tile::<Single>(n, row, p * PANEL, panel.as_ptr()),
                    (Precision::Bf16, true) => work.tile_bf16(n, row, p * PANEL, panel.as_ptr()),
                    (Precision::Bf16, false) => work.tile::<Widened>(n, row, p * PANEL, panel.as_ptr()),
                }
            }
            row += n;
        }
    }
}

impl Left<'_> {
    fn as_ptr(&self) -> *const u32 {
        match self.words {
            Words::Single(values) => values.as_ptr().cast(),
            Words::Pairs(words) => words.as_ptr(),
        }
    }
}

/// A product in raw form.
struct Work<'a> {
    out: *mut f32,
    cols: usize,
    steps: usize,
    left: *const u32,
    row_stride: usize,
    step_stride: usize,
    add: *const f32,
    finish: Finish<'a>,
}

type Vectors = [__m512; 2];

/// How a step's words are multiplied.
trait Step {
    /// # Safety
    /// Needs AVX-512 F.
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512;
}

/// Words are f32.
struct Single;

impl Step for Single {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        // SAFETY: the caller's promise.
        unsafe { _mm512_fmadd_ps(_mm512_castsi512_ps(a), _mm512_castsi512_ps(b), sum) }
    }
}

/// Words are pairs of bf16 on a machine that multiplies f32 only.
struct Widened;

impl Step for Widened {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        // SAFETY: the caller's promise.
        unsafe {
            let high = _mm512_set1_epi32(0xffff_0000_u32 as i32);
            let odd = |v| _mm512_castsi512_ps(_mm512_and_si512(v, high));
            let even = |v| _mm512_castsi512_ps(_mm512_slli_epi32::<16>(v));
            _mm512_fmadd_ps(even(a), even(b), _mm512_fmadd_ps(odd(a), odd(b), sum))
        }
    }
}

/// Words are pairs of bf16.
struct Pairs;

impl Step for Pairs {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        // SAFETY: the caller's promise; both types are 64 bytes of plain data.
        unsafe {
            let pairs = |v| std::mem::transmute::<__m512i, __m512bh>(v);
            _mm512_dpbf16_ps(sum, pairs(a), pairs(b))
        }
    }
}

impl Work<'_> {
    /// # Safety
    /// Needs AVX-512 F; `n` rows from `row` on, columns from `first` on and `steps` rows of the panel must lie
    /// within the memory of the product.
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,fma")]
    unsafe fn tile<S: Step>(&self, n: usize, row: usize, first: usize, panel: *const u32) {
        // SAFETY: the caller's promise.
        unsafe { self.any_rows::<S>(n, row, first, panel) }
    }

    /// # Safety
    /// As [`Work::tile`], and AVX-512 BF16.
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bf16,fma")]
    unsafe fn tile_bf16(&self, n: usize, row: usize, first: usize, panel: *const u32) {
        // SAFETY: the caller's promise.
        unsafe { self.any_rows::<Pairs>(n, row, first, panel) }
    }

    /// # Safety
    /// As [`Work::tile`].
    #[inline(always)]
    unsafe fn any_rows<S: Step>(&self, n: usize, row: usize, first: usize, panel: *const u32) {
        // SAFETY: the caller's promise.
        unsafe {
            match n {
                1 => self.rows::<S, 1>(row, first, panel),
                2 => self.rows::<S, 2>(row, first, panel),
                3 => self.rows::<S, 3>(row, first, panel),
                4 => self.rows::<S, 4>(row, first, panel),
                5 => self.rows::<S, 5>(row, first, panel),
                6 => self.rows::<S, 6>(row, first, panel),
                7 => self.rows::<S, 7>(row, first, panel),
                8 => self.rows::<S, 8>(row, first, panel),
                9 => self.rows::<S, 9>(row, first, panel),
                10 => self.rows::<S, 10>(row, first, panel),
                11 => self.rows::<S, 11>(row, first, panel),
                _ => self.rows::<S, TILE_ROWS>(row, first, panel),
            }
        }
    }

    /// # Safety
    /// As [`Work::tile`], for `M` rows.
    #[inline(always)]
    unsafe fn rows<S: Step, const M: usize>(&self, row: usize, first: usize, panel: *const u32) {
        // SAFETY: the caller's promise: each address lies within the left factor or the panel.
        unsafe {
            let mut sums: [Vectors; M] = [[_mm512_setzero_ps(); 2]; M];
            let mut left = self.left.add(row * self.row_stride);
            let mut right = panel;
            for _ in 0..self.steps {
                let b = [_mm512_loadu_epi32(right.cast()), _mm512_loadu_epi32(right.add(16).cast())];
                for i in 0..M {
                    let a = _mm512_set1_epi32(*left.add(i * self.row_stride) as i32);
                    sums[i][0] = S::accumulate(sums[i][0], a, b[0]);
                    sums[i][1] = S::accumulate(sums[i][1], a, b[1]);
                }
                left = left.wrapping_add(self.step_stride);
                right = right.wrapping_add(PANEL);
            }
            for i in 0..M {
                self.store(row + i, first, sums[i]);
            }
        }
    }

    /// # Safety
    /// Needs AVX-512 F; the row and the columns from `first` on, as far as there are, must lie within the
    /// output and the finish.
    #[inline(always)]
    unsafe fn store(&self, row: usize, first: usize, sums: Vectors) {
        for (half, sum) in sums.into_iter().enumerate() {
            let col = first + 16 * half;
            if col >= self.cols {
                return;
            }
            let lanes: __mmask16 = if self.cols - col >= 16 { !0 } else { (1 << (self.cols - col)) - 1 };
            let at = row * self.cols + col;
            // SAFETY: the caller's promise; lanes past the last column are neither read nor written.
            unsafe {
                let mut v = sum;
                if !self.add.is_null() {
                    v = _mm512_add_ps(v, _mm512_maskz_loadu_ps(lanes, self.add.add(at)));
                }
                if let Some(bias) = self.finish.bias {
                    v = _mm512_add_ps(v, _mm512_maskz_loadu_ps(lanes, bias.as_ptr().add(col)));
                }
                if self.finish.relu {
                    v = _mm512_max_ps(v, _mm512_setzero_ps());
                }
                let mut kept = lanes;
                if let Some(mask) = self.finish.mask {
                    let values = _mm512_maskz_loadu_ps(lanes, mask.as_ptr().add(at));
                    kept = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(values, _mm512_setzero_ps());
                }
                _mm512_mask_storeu_ps(self.out.add(at), lanes, _mm512_maskz_mov_ps(kept, v));
            }
        }
    }
}
