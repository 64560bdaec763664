//! What a refinement asks of a colour model: printable colours and the mixtures that give them.

/// Relates media-relative linear RGB (print white = 1) and volume fractions of materials.
pub trait InkModel: Sync {
    /// The labels that carry fractions, in halftone order: most absorbing first, white last.
    fn labels(&self) -> &[u8];

    /// Absolute linear RGB radiance of a thick block of white: what media-relative 1 stands for.
    fn media_white(&self) -> [f32; 3];

    /// Writes the volume fractions (one per label of [`InkModel::labels`], each at least 0, sum 1)
    /// of the printable colour nearest to `rgb` and returns that colour. Defined for every finite
    /// `rgb`, also out of gamut; continuous.
    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3];

    /// The media-relative linear RGB of a mixture, one fraction per label of [`InkModel::labels`].
    fn color(&self, fractions: &[f32]) -> [f32; 3];

    /// CIELAB of media-relative linear RGB, the media white being L* = 100.
    fn lab(&self, rgb: [f32; 3]) -> [f32; 3];

    /// CIEDE2000 difference of two CIELAB colours.
    fn delta_e(&self, a: [f32; 3], b: [f32; 3]) -> f32;
}
