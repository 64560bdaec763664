//! What a refinement asks of a colour model: printable colours and the mixtures that give them.

/// Relates media-relative linear RGB (print white = 1) and volume fractions of materials.
pub trait InkModel: Sync {
    /// The labels that carry fractions, 2 to 16 of them, in halftone order: most absorbing first, white last.
    fn labels(&self) -> &[u8];

    /// Writes the volume fractions (one per label of [`InkModel::labels`], each at least 0, sum 1)
    /// of the printable colour nearest to `rgb` and returns that colour. Defined for every finite
    /// `rgb`, also out of gamut; continuous.
    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3];

    /// The media-relative linear RGB of a mixture, one fraction per label of [`InkModel::labels`].
    fn color(&self, fractions: &[f32]) -> [f32; 3];
}
