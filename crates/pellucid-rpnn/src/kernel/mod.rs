//! Matrix products with what follows them fused in: residual sums, biases, ReLUs and their masks.
//!
//! The right factor is packed into panels of [`PANEL`] columns, the left one is read in place (f32) or rounded
//! to pairs of bf16. Sums run over the inner axis in order, so an entry of the result depends on its row, its
//! column and the form of the kernel only, not on the size of the batch. The AVX-512 and AVX2 forms are chosen at
//! run time; the portable form is their twin under the same tests. All unsafe code of the crate is in [`avx512`],
//! [`avx2`], [`tiles`] and [`compiled`].

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod compiled;
mod features;
mod optimiser;
mod pack;
mod portable;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod tiles;

use pellucid_core::InstructionSet;

use crate::Precision;

pub(crate) use optimiser::Update;
pub(crate) use pack::Matrix;

/// Columns of a panel: two vectors of AVX-512.
const PANEL: usize = 32;

/// What is done to a product before it is stored.
#[derive(Clone, Copy, Default)]
pub(crate) struct Finish<'a> {
    /// Summand, of the output's shape.
    pub add: Add<'a>,
    /// Summand of every row.
    pub bias: Option<&'a [f32]>,
    /// Negative values become zero.
    pub relu: bool,
    /// Values become zero where these, of the output's shape, are not positive.
    pub mask: Option<&'a [f32]>,
}

/// What a product is added to.
#[derive(Clone, Copy, Default)]
pub(crate) enum Add<'a> {
    /// Nothing.
    #[default]
    Nothing,
    /// What the output held.
    Output,
    /// Another matrix.
    Other(&'a [f32]),
}

/// The form of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// AVX-512, with bf16 products where the precision asks for them.
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Proof),
    /// AVX2; products of bf16 are made by f32 ones.
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Proof),
    /// Plain Rust.
    Portable,
}

impl Form {
    /// The fastest form that is not above `set`.
    pub(crate) fn of(set: InstructionSet) -> Self {
        #[cfg(target_arch = "x86_64")]
        if set >= InstructionSet::Avx512
            && let Some(proof) = avx512::Proof::detect(set >= InstructionSet::Avx512Bf16)
        {
            return Self::Avx512(proof);
        }
        #[cfg(target_arch = "x86_64")]
        if set >= InstructionSet::Avx2
            && let Some(proof) = avx2::Proof::detect()
        {
            return Self::Avx2(proof);
        }
        let _ = set;
        Self::Portable
    }

    /// The least instruction set whose products have the same bits. Products of f32 are the same sums in the same
    /// order in AVX2 and AVX-512.
    pub(crate) fn instruction_set(self, precision: Precision) -> InstructionSet {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(proof) if proof.bf16() && precision == Precision::Bf16 => InstructionSet::Avx512Bf16,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) | Self::Avx2(_) => InstructionSet::Avx2,
            Self::Portable => InstructionSet::Portable,
        }
    }
}

/// The right factor of a product, packed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packed {
    /// Panels of `steps` rows of 32 columns; a word is an f32 or two bf16 of successive rows.
    words: Vec<u32>,
    precision: Precision,
    rows: usize,
    cols: usize,
    steps: usize,
}

/// A left factor's values.
#[derive(Clone, Copy)]
enum Words<'a> {
    Single(&'a [f32]),
    /// Two bf16 of successive steps.
    Pairs(&'a [u32]),
}

#[cfg(target_arch = "x86_64")]
impl Left<'_> {
    fn len(&self) -> usize {
        match self.words {
            Words::Single(values) => values.len(),
            Words::Pairs(words) => words.len(),
        }
    }
}

/// The left factor: element (row, step) lies at `row * row_stride + step * step_stride`.
#[derive(Clone, Copy)]
struct Left<'a> {
    words: Words<'a>,
    rows: usize,
    row_stride: usize,
    step_stride: usize,
}

/// A product's output with its finish, all extents checked.
struct Target<'a> {
    out: &'a mut [f32],
    cols: usize,
    finish: Finish<'a>,
}

/// Multiplies, with scratch memory of its own.
#[derive(Debug)]
pub(crate) struct Products {
    form: Form,
    left: Vec<u32>,
    right: Packed,
}

impl Clone for Products {
    fn clone(&self) -> Self {
        Self::new(self.form)
    }
}

impl Products {
    pub(crate) fn new(form: Form) -> Self {
        Self { form, left: Vec::new(), right: Packed::default() }
    }

    pub(crate) fn form(&self) -> Form {
        self.form
    }

    /// Packs a right factor, reusing the memory of `packed`.
    pub(crate) fn pack(&self, right: Matrix<'_>, precision: Precision, packed: &mut Packed) {
        pack_right(self.form, right, precision, packed);
    }

    /// `out = left right`, finished. `out` is dense row-major.
    pub(crate) fn product(&mut self, out: &mut [f32], left: Matrix<'_>, right: &Packed, finish: Finish<'_>) {
        product(self.form, &mut self.left, out, left, right, finish);
    }

    /// As [`Products::product`] with a right factor that is used once.
    pub(crate) fn product_once(
        &mut self,
        out: &mut [f32],
        left: Matrix<'_>,
        right: Matrix<'_>,
        precision: Precision,
        finish: Finish<'_>,
    ) {
        pack_right(self.form, right, precision, &mut self.right);
        product(self.form, &mut self.left, out, left, &self.right, finish);
    }

    /// Adds the sum of the rows of `values` to `sums`.
    pub(crate) fn add_rows(&self, values: &[f32], sums: &mut [f32]) {
        match self.form {
            #[cfg(target_arch = "x86_64")]
            Form::Avx512(proof) => avx512::add_rows(proof, values, sums),
            #[cfg(target_arch = "x86_64")]
            Form::Avx2(proof) => avx2::add_rows(proof, values, sums),
            Form::Portable => pack::add_rows(values, sums),
        }
    }
}

/// [`features::log_features`] in a form that `set` allows for; all give the same bits.
pub(crate) fn log_features(set: InstructionSet, level: &mut [f32], scale: f32) {
    match Form::of(set) {
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(proof) => avx512::log_features(proof, level, scale),
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(proof) => avx2::log_features(proof, level, scale),
        Form::Portable => features::log_features(level, scale),
    }
}

/// [`optimiser::update`] in a form that `set` allows for; all give the same bits.
pub(crate) fn update(
    set: InstructionSet,
    update: Update,
    parameters: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    average: &mut [f32],
) {
    match Form::of(set) {
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(proof) => avx512::update(proof, update, parameters, gradient, first, second, average),
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(proof) => avx2::update(proof, update, parameters, gradient, first, second, average),
        Form::Portable => optimiser::update(update, parameters, gradient, first, second, average),
    }
}

/// [`optimiser::sum_of_squares`] in a form that `set` allows for; all give the same bits.
pub(crate) fn sum_of_squares(set: InstructionSet, values: &[f32]) -> f64 {
    match Form::of(set) {
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(proof) => avx512::sum_of_squares(proof, values),
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(proof) => avx2::sum_of_squares(proof, values),
        Form::Portable => optimiser::sum_of_squares(values),
    }
}

fn pack_right(form: Form, right: Matrix<'_>, precision: Precision, packed: &mut Packed) {
    let (rows, cols) = right.shape();
    let steps = if precision == Precision::Bf16 { rows.div_ceil(2) } else { rows };
    *packed = Packed { words: std::mem::take(&mut packed.words), precision, rows, cols, steps };
    // Every word is written below, the padding too.
    packed.words.resize(cols.div_ceil(PANEL) * steps * PANEL, 0);
    match form {
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(proof) => avx512::pack_right(proof, right, packed),
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(proof) => avx2::pack_right(proof, right, packed),
        Form::Portable => pack::pack_right(right, packed),
    }
}

fn product(
    form: Form,
    scratch: &mut Vec<u32>,
    out: &mut [f32],
    left: Matrix<'_>,
    right: &Packed,
    finish: Finish<'_>,
) {
    let (rows, inner) = left.shape();
    assert_eq!(inner, right.rows, "inner extents differ");
    assert_eq!(out.len(), rows * right.cols, "output extent differs");
    let fits = |shape: Option<&[f32]>, len: usize| shape.is_none_or(|s| s.len() == len);
    let other = if let Add::Other(other) = finish.add { Some(other) } else { None };
    assert!(
        fits(other, out.len()) && fits(finish.mask, out.len()) && fits(finish.bias, right.cols),
        "a finish of another extent"
    );
    let target = Target { out, cols: right.cols, finish };
    let words = match right.precision {
        Precision::F32 => left.as_left(),
        Precision::Bf16 => {
            let (row_stride, step_stride) = if left.is_transposed() { (1, rows) } else { (right.steps, 1) };
            scratch.resize(rows * right.steps, 0);
            match form {
                #[cfg(target_arch = "x86_64")]
                Form::Avx512(proof) => avx512::pack_left(proof, left, scratch),
                #[cfg(target_arch = "x86_64")]
                Form::Avx2(proof) => avx2::pack_left(proof, left, scratch),
                Form::Portable => pack::pack_left(left, scratch),
            }
            Left { words: Words::Pairs(scratch), rows, row_stride, step_stride }
        }
    };
    match form {
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(proof) => avx512::product(proof, target, words, right),
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(proof) => avx2::product(proof, target, words, right),
        Form::Portable => portable::product(target, words, right),
    }
}
