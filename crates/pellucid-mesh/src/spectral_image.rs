//! Textures of more than three bands: reflectances by wavelength.

#[cfg(feature = "spectral")]
mod exr;

use std::ops::Range;
use std::sync::Arc;

use pellucid_core::Digest;
use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::target::CHUNK;
use crate::{BaseColor, Image, MeshError, Model, PlacedMesh, Sampler, Texture};

/// An image of reflectances by wavelength that takes the place of a model's texture, on the same UV map. Kept in 16 bits a
/// value.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralImage {
    name: String,
    width: u32,
    height: u32,
    wavelengths_nm: Vec<f64>,
    /// Of each wavelength, `[y][x]`, 65535 for 1.
    planes: Vec<Vec<u16>>,
}

/// A place on a mesh that a surface voxel shows.
#[derive(Clone, Copy, Default)]
struct Place {
    triangle: u32,
    weights: [f64; 3],
    footprint_m: f64,
}

impl SpectralImage {
    /// From planes of reflectances `[y][x]`, row 0 at v = 0, each with its wavelength in nm, in any order; `name` is what
    /// errors call it. What is beyond 0 to 1 is cut off.
    ///
    /// ```
    /// use pellucid_mesh::SpectralImage;
    /// let bands = (40..=70).map(|k| (10.0 * f64::from(k), vec![0.25, 0.75]));
    /// let image = SpectralImage::new("two greys", [2, 1], bands.collect())?;
    /// assert_eq!(image.wavelengths_nm().len(), 31);
    /// # Ok::<(), pellucid_mesh::MeshError>(())
    /// ```
    ///
    /// # Errors
    /// [`MeshError::Invalid`] for fewer than 2 wavelengths, one that is given twice or not above 0, a plane that is not
    /// width x height, or a value that is not finite.
    pub fn new(
        name: impl Into<String>,
        [width, height]: [u32; 2],
        mut bands: Vec<(f64, Vec<f32>)>,
    ) -> Result<Self, MeshError> {
        let name = name.into();
        let fail = |object: String, reason: &str| {
            let remedy = "give reflectances of 2 or more wavelengths in nm, a value a pixel";
            Err(MeshError::invalid(name.clone(), object, reason, remedy))
        };
        bands.sort_by(|a, b| a.0.total_cmp(&b.0));
        if bands.len() < 2 {
            return fail("bands".into(), &format!("{} of known wavelength", bands.len()));
        }
        if let Some((nm, _)) = bands.iter().find(|(nm, _)| !nm.is_finite() || *nm <= 0.0) {
            return fail(format!("band {nm} nm"), "its wavelength is not above 0");
        }
        if let Some(twice) = bands.windows(2).find(|w| w[0].0 == w[1].0) {
            return fail(format!("band {} nm", twice[0].0), "it is there twice");
        }
        let pixels = u64::from(width) * u64::from(height);
        for (nm, plane) in &bands {
            if pixels == 0 || plane.len() as u64 != pixels {
                return fail(
                    format!("band {nm} nm"),
                    &format!("{} values for {width} x {height}", plane.len()),
                );
            }
            if !plane.iter().all(|v| v.is_finite()) {
                return fail(format!("band {nm} nm"), "a value is not finite");
            }
        }
        let quantised = |v: &f32| (v.clamp(0.0, 1.0) * 65535.0).round() as u16;
        let planes = bands.par_iter().map(|(_, plane)| plane.iter().map(quantised).collect()).collect();
        let wavelengths_nm = bands.iter().map(|(nm, _)| *nm).collect();
        Ok(Self { name, width, height, wavelengths_nm, planes })
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Wavelengths in nm, ascending; at least 2.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// Digest of wavelengths and texels; the name does not count.
    pub fn digest(&self) -> Digest {
        let mut digest = Digest::new();
        self.size().iter().for_each(|side| digest.add(&side.to_le_bytes()));
        self.wavelengths_nm.iter().for_each(|nm| digest.add(&nm.to_le_bytes()));
        self.planes.iter().flatten().for_each(|v| digest.add(&v.to_le_bytes()));
        digest
    }

    /// Up to three bands as one image; a channel beyond the last is dark.
    fn bands(&self, bands: Range<usize>) -> Result<Arc<Image>, MeshError> {
        let planes = &self.planes[bands];
        let texel = |i: usize| std::array::from_fn(|c| planes.get(c).map_or(0, |plane| plane[i]));
        let texels = (0..self.planes[0].len()).into_par_iter().map(texel).collect();
        Ok(Arc::new(Image::from_linear16(self.width, self.height, texels)?))
    }
}

impl PlacedMesh<'_> {
    /// Reflectances of every surface voxel, in the surface's order, at the places of
    /// [`surface_colors`](crate::surface_colors) and averaged as there: `take` gets, in ascending order, the bands by
    /// number and the values of up to three of them, `[voxel][band]`. The image takes the place of the model's textures;
    /// colours of materials and vertices do not count.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] where a material of the model has no texture, and so no place in the image;
    /// [`MeshError::Cancelled`].
    pub fn surface_reflectances(
        &self,
        surface: &Surface,
        image: &SpectralImage,
        control: &Control,
        mut take: impl FnMut(Range<usize>, &[[f32; 3]]),
    ) -> Result<(), MeshError> {
        let model = self.model();
        let samplers = model.samplers(image)?;
        let opaque = |_: u32, _: [f64; 3], _: f64| false;
        let place = |triangle, weights, footprint_m| Place { triangle, weights, footprint_m };
        let places = self.looks(surface, opaque, place, control)?;
        let mut values = vec![[0.0; 3]; places.len()];
        let count = image.planes.len();
        for first in (0..count).step_by(3) {
            control.check()?;
            let bands = first..count.min(first + 3);
            let texels = image.bands(bands.clone())?;
            let textures: Vec<Texture> =
                samplers.iter().map(|&sampler| Texture::new(Arc::clone(&texels), sampler)).collect();
            values.par_chunks_mut(CHUNK).zip(places.par_chunks(CHUNK)).try_for_each(|(values, places)| {
                control.check()?;
                for (value, p) in values.iter_mut().zip(places) {
                    let texture = &textures[model.triangles()[p.triangle as usize].material as usize];
                    *value = model.texel_of(texture, p.triangle, p.weights, p.footprint_m);
                }
                Ok::<(), MeshError>(())
            })?;
            take(bands, &values);
        }
        Ok(())
    }
}

impl Model {
    /// How each material's texture is sampled.
    fn samplers(&self, image: &SpectralImage) -> Result<Vec<Sampler>, MeshError> {
        let sampler = |(i, material): (usize, &BaseColor)| match material.texture {
            Some(texture) => Ok(self.textures()[texture as usize].sampler()),
            None => Err(MeshError::invalid(
                self.name(),
                format!("material {i} {:?}", material.name),
                format!("it has no texture, whose place {} could take", image.name),
                "give every material a texture, on the UV map that the spectral image has",
            )),
        };
        self.materials().iter().enumerate().map(sampler).collect()
    }
}

#[cfg(test)]
mod tests;
