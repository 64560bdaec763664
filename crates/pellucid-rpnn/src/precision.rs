//! Number format of the products.

/// Number format of the products; sums, weights and everything between the products are f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Both factors in f32.
    #[default]
    F32,
    /// Both factors rounded to bf16, except in the last three layers.
    Bf16,
}
