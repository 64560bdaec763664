//! What a refinement asks of a colour model: printable colours and the mixtures that give them.

use pellucid_color::{Gamut, Lab, delta_e_2000};

use crate::RefineError;

/// Relates media-relative linear RGB (print white = 1) and volume fractions of materials.
pub trait InkModel: Sync {
    /// The labels that carry fractions, in halftone order: darkest first, white last.
    fn labels(&self) -> &[u8];

    /// Media-relative linear RGB of a predictor's radiance, one value a channel.
    fn relative_rgb(&self, radiance: &[f32]) -> [f32; 3];

    /// Writes the volume fractions (one per label of [`InkModel::labels`], each at least 0, sum 1)
    /// of the printable colour nearest to `rgb`, in media-relative linear RGB, and returns that
    /// colour. Defined for every finite `rgb`, also out of gamut; continuous.
    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3];

    /// The media-relative linear RGB of a mixture, one fraction per label of [`InkModel::labels`].
    fn color(&self, fractions: &[f32]) -> [f32; 3];

    /// The printable colour a target is mapped to before refinement (gamut mapping, which may
    /// differ from the nearest colour of [`InkModel::fractions`]).
    fn gamut_map(&self, rgb: [f32; 3]) -> [f32; 3];

    /// CIEDE2000 difference of two media-relative linear RGB colours under D65.
    fn delta_e(&self, a: [f32; 3], b: [f32; 3]) -> f32 {
        let lab = |c: [f32; 3]| Lab::from_linear_rgb(c.map(f64::from));
        delta_e_2000(lab(a), lab(b)) as f32
    }
}

/// The ink model of a [`Gamut`] whose channels are linear R, G, B.
pub struct PrintInk<'a> {
    gamut: &'a Gamut,
    labels: Vec<u8>,
}

impl<'a> PrintInk<'a> {
    /// Wraps a gamut; labels are the mixture model's materials in order, from 1.
    ///
    /// # Errors
    /// [`RefineError::Unsupported`] for more materials than labels.
    pub fn new(gamut: &'a Gamut) -> Result<Self, RefineError> {
        let model = gamut.model();
        let count = u8::try_from(model.materials())
            .map_err(|_| RefineError::unsupported("materials", "more than 255"))?;
        let luminance = |label: u8| {
            let pure = pellucid_color::Fractions::pure(usize::from(label) - 1, model.materials());
            let [r, g, b] = model.relative_rgb(&pure);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let white = model.white() as u8 + 1;
        let mut labels: Vec<u8> = (1..=count).filter(|&l| l != white).collect();
        labels.sort_by(|&a, &b| luminance(a).total_cmp(&luminance(b)));
        labels.push(white);
        Ok(Self { gamut, labels })
    }
}

impl InkModel for PrintInk<'_> {
    fn labels(&self) -> &[u8] {
        &self.labels
    }

    fn relative_rgb(&self, radiance: &[f32]) -> [f32; 3] {
        let white = self.gamut.model().media_white();
        std::array::from_fn(|c| radiance.get(c).map_or(0.0, |&v| (f64::from(v) / white[c]) as f32))
    }

    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
        let found = self.gamut.fractions(rgb);
        for (out, &label) in fractions.iter_mut().zip(&self.labels) {
            *out = found[usize::from(label) - 1];
        }
        self.gamut.model().relative_rgb(&found).map(|v| v as f32)
    }

    fn gamut_map(&self, rgb: [f32; 3]) -> [f32; 3] {
        self.gamut.map(rgb).rgb
    }
}
