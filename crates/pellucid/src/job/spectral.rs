//! Targets from a spectral image in place of the model's texture.

use pellucid_color::Viewing;
use pellucid_color::plane_parallel::Solver;
use pellucid_core::{Control, Fault};
use pellucid_mesh::{Model, PlacedMesh, SpectralImage};
use pellucid_voxel::{Channels, Surface, WIDEST_GAP_NM, band_weights};

use crate::job::Placed;
use crate::{Monitor, Prepared, PrintError, PrintJob, Workspace};

/// How reflectances become a texture's colours under the lights of a job.
pub(super) struct SpectralColors<'i> {
    image: &'i SpectralImage,
    /// What a reflectance of 1 adds to linear RGB, `[light][wavelength of the image]`.
    weights: Vec<Vec<[f32; 3]>>,
}

impl PrintJob {
    /// [`PrintJob::prepare`] with a spectral image in place of the model's texture: what a print should look like under
    /// every light of the settings follows from its reflectances, not from one colour. By the relative intent a
    /// reflectance of 1 stands for the print's white; with [`PrintSettings::absolute`](crate::PrintSettings) for a perfect
    /// one.
    ///
    /// # Errors
    /// [`PrintError::Unsupported`] for materials without bands or see-through parts, [`PrintError::Invalid`] when
    /// the image's wavelengths do not reach the materials' or leave gaps, [`PrintError::Mesh`] when a material of the
    /// model has no texture; else as there.
    pub fn prepare_spectral(
        &self,
        model: &Model,
        image: &SpectralImage,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        self.prepare_chosen(self.place_spectral(model, image, monitor)?, workspace, monitor)
    }

    /// [`PrintJob::place`] for [`PrintJob::prepare_spectral`].
    ///
    /// # Errors
    /// As there.
    pub fn place_spectral(
        &self,
        model: &Model,
        image: &SpectralImage,
        monitor: &Monitor<'_>,
    ) -> Result<Placed, PrintError> {
        if self.clear.is_some() {
            let fault = Fault::new("spectral image", "it does not say what is see-through");
            return Err(PrintError::Unsupported(fault.remedy("leave clear_from_alpha out")));
        }
        let colors = self.spectral_colors(image)?;
        let mut placed = self.place_colored(model, Some(&colors), monitor)?;
        placed.model.spectral_image = Some(image.digest().hex());
        Ok(placed)
    }

    fn spectral_colors<'i>(&self, image: &'i SpectralImage) -> Result<SpectralColors<'i>, PrintError> {
        let s = &self.settings;
        let bands = self.inks.spectrum();
        let Channels::Bands { .. } = bands else {
            let fault = Fault::new("spectral image", "the materials have no bands, but R, G and B or names");
            return Err(PrintError::Unsupported(fault.remedy("give materials by band")));
        };
        let resampling = band_weights(image.wavelengths_nm(), bands, WIDEST_GAP_NM)
            .map_err(|e| PrintError::invalid("spectral image", e.to_string()))?;
        let white = self.white_radiance()?;
        let main = Viewing::new(bands, s.illuminant, &white)?;
        let media_white = main.media_white();
        let viewings = std::iter::once(Ok(main)).chain(self.further_viewings(&white));
        let mut weights = viewings
            .map(|viewing| {
                let viewing = viewing?;
                let radiance = |nm: usize| -> Vec<f32> {
                    let scaled = |(row, white): (&Vec<f64>, &f64)| {
                        (row[nm] * if s.absolute { 1.0 } else { *white }) as f32
                    };
                    resampling.iter().zip(&white).map(scaled).collect()
                };
                let wavelengths = 0..image.wavelengths_nm().len();
                Ok(wavelengths.map(|nm| viewing.relative_rgb(&radiance(nm))).collect())
            })
            .collect::<Result<Vec<Vec<[f32; 3]>>, PrintError>>()?;
        if s.absolute {
            // A texture's absolute colours are divided by the print's white later.
            let absolute = |rgb: &mut [f32; 3]| (0..3).for_each(|c| rgb[c] *= media_white[c]);
            weights[0].iter_mut().for_each(absolute);
        }
        Ok(SpectralColors { image, weights })
    }

    /// Radiance of a thick block of white, one value a channel.
    pub(super) fn white_radiance(&self) -> Result<Vec<f64>, PrintError> {
        let white = self.inks.get(self.white).ok_or_else(|| PrintError::invalid("materials", "no white"))?;
        Ok(Solver::new(self.settings.refractive_index)?.thick_block(white)?)
    }

    /// From radiance to colour under each further light of the settings.
    pub(super) fn further_viewings(
        &self,
        white: &[f64],
    ) -> impl Iterator<Item = Result<Viewing, PrintError>> {
        let lights = self.settings.also_under.iter();
        lights.map(move |&light| Ok(Viewing::new(self.inks.spectrum(), light, white)?))
    }
}

impl SpectralColors<'_> {
    /// Colours of every surface voxel under each light, linear RGB.
    pub(super) fn of(
        &self,
        mesh: &PlacedMesh<'_>,
        surface: &Surface,
        control: &Control<'_>,
    ) -> Result<Vec<Vec<[f32; 3]>>, PrintError> {
        let mut colors = vec![vec![[0.0f32; 3]; surface.len()]; self.weights.len()];
        mesh.surface_reflectances(surface, self.image, control, |bands, values| {
            for (colors, weights) in colors.iter_mut().zip(&self.weights) {
                for (rgb, values) in colors.iter_mut().zip(values) {
                    for (value, weight) in values.iter().zip(&weights[bands.clone()]) {
                        (0..3).for_each(|c| rgb[c] += value * weight[c]);
                    }
                }
            }
        })?;
        Ok(colors)
    }
}
