//! Sixteen lanes of arithmetic, the same on every instruction set.
//!
//! Every operation is exactly rounded (IEEE 754 or integer), so that all implementations give
//! bit-identical results.

/// A token that proves the instruction set is there, with its operations on sixteen lanes.
pub(crate) trait Lanes: Copy {
    /// Sixteen f32.
    type F: Copy;
    /// Sixteen u32.
    type I: Copy;
    /// Sixteen u64, the state of sixteen PCG32 generators.
    type W: Copy;
    /// Sixteen truth values.
    type M: Copy;

    fn splat(self, v: f32) -> Self::F;
    fn load(self, v: &[f32; 16]) -> Self::F;
    fn store(self, v: Self::F) -> [f32; 16];
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b + c`, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `c - a * b`, rounded once.
    fn fnma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `a < b ? a : b`.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a > b ? a : b`.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn sqrt(self, a: Self::F) -> Self::F;
    fn abs(self, a: Self::F) -> Self::F;
    fn lt(self, a: Self::F, b: Self::F) -> Self::M;
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// `m ? a : b`.
    fn select(self, m: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// `table[i & 15]`.
    fn lookup(self, table: Self::F, i: Self::I) -> Self::F;

    fn splat_i(self, v: u32) -> Self::I;
    fn load_i(self, v: &[u32; 16]) -> Self::I;
    fn store_i(self, v: Self::I) -> [u32; 16];
    fn add_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// The low halves of the products.
    fn mul_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn and_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn or_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn shl<const N: u32>(self, a: Self::I) -> Self::I;
    fn shr<const N: u32>(self, a: Self::I) -> Self::I;
    /// Each lane shifted right by its own count, below 32.
    fn shr_by(self, a: Self::I, n: Self::I) -> Self::I;
    /// The lesser as unsigned numbers.
    fn min_u(self, a: Self::I, b: Self::I) -> Self::I;
    fn eq_i(self, a: Self::I, b: Self::I) -> Self::M;
    /// Rounds toward zero; out of range or NaN gives 2^31.
    fn to_i(self, a: Self::F) -> Self::I;
    /// From signed integers.
    fn to_f(self, a: Self::I) -> Self::F;
    fn bits(self, a: Self::F) -> Self::I;
    fn floats(self, a: Self::I) -> Self::F;
    /// `words[i]` per lane.
    ///
    /// # Safety
    /// Every index must be below `words.len()`, and that at most 2^31.
    unsafe fn gather(self, words: &[u32], i: Self::I) -> Self::I;

    fn load_w(self, v: &[u64; 16]) -> Self::W;
    fn select_w(self, m: Self::M, a: Self::W, b: Self::W) -> Self::W;
    /// PCG32 (XSH RR): the next state and this state's output.
    fn draw(self, state: Self::W) -> (Self::W, Self::I);

    fn mask(self, bits: u16) -> Self::M;
    fn mask_bits(self, m: Self::M) -> u16;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    /// `a & !b`.
    fn and_not(self, a: Self::M, b: Self::M) -> Self::M;
    fn any(self, m: Self::M) -> bool {
        self.mask_bits(m) != 0
    }
}
