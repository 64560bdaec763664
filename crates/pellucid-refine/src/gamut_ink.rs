//! The colour crate's gamut as an ink model.

use pellucid_color::{Fractions, Gamut, space};
use pellucid_voxel::MaterialTable;

use crate::InkModel;

/// A [`Gamut`] with its materials in halftone order: darkest first, white last, so that the union of the
/// darkest few is as evenly spread as each alone.
pub struct GamutInk {
    gamut: Gamut,
    labels: Vec<u8>,
}

impl GamutInk {
    /// Orders the materials that `gamut` was built of by the luminance of a thick block.
    pub fn new(gamut: Gamut, materials: &MaterialTable) -> Self {
        let model = gamut.model();
        let luminance = |label: u8| {
            let pure = Fractions::pure(usize::from(label) - 1, model.materials());
            space::luminance(model.relative_rgb(&pure))
        };
        let white = model.white() as u8 + 1;
        let mut labels: Vec<u8> =
            (1..=materials.len().min(model.materials()) as u8).filter(|&l| l != white).collect();
        labels.sort_by(|&a, &b| luminance(a).total_cmp(&luminance(b)));
        labels.push(white);
        Self { gamut, labels }
    }

    /// The printable colours.
    pub fn gamut(&self) -> &Gamut {
        &self.gamut
    }
}

impl InkModel for GamutInk {
    fn labels(&self) -> &[u8] {
        &self.labels
    }

    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
        let mixture = self.gamut.fractions(rgb);
        for (slot, &label) in fractions.iter_mut().zip(&self.labels) {
            *slot = mixture[usize::from(label) - 1];
        }
        self.gamut.model().relative_rgb(&mixture).map(|v| v as f32)
    }

    fn color(&self, fractions: &[f32]) -> [f32; 3] {
        let mut ordered = [0.0; 256];
        for (&fraction, &label) in fractions.iter().zip(&self.labels) {
            ordered[usize::from(label) - 1] = fraction;
        }
        self.gamut.model().relative_rgb(&ordered[..self.labels.len()]).map(|v| v as f32)
    }
}
