//! Mixtures of print materials: volume fractions to colour, and back.
//!
//! Coefficients of a fine mixture are the volume-weighted means of its materials'; the colour is
//! the half-space radiance per channel. [`MixtureModel`] computes it with derivatives,
//! [`inverse`] finds the fractions of a colour exactly, and [`table`] tabulates that for speed.

mod check;
mod fractions;
pub mod inverse;
mod simplex;
pub mod table;

pub use fractions::Fractions;
use pellucid_voxel::MaterialTable;

use crate::ColorError;
use crate::curve::ReflectanceCurve;
use crate::intent::MediaWhite;
use crate::plane_parallel::{Layer, Solver};
use crate::spectrum::{Conditions, Illuminant};
use crate::viewing::Viewing;

/// Most materials in a mixture: the starts of its inverse grow with a power of their number.
pub const MAX_MATERIALS: usize = 8;

/// Colour of mixtures of a material table, as an infinitely thick print shows it.
pub struct MixtureModel {
    count: usize,
    white: usize,
    names: Vec<String>,
    /// Per channel and material, 1/mm: absorption, reduced scattering (1 - g) σ_s, scattering.
    absorption: Vec<[f64; MAX_MATERIALS]>,
    reduced: Vec<[f64; MAX_MATERIALS]>,
    scattering: Vec<[f64; MAX_MATERIALS]>,
    curve: ReflectanceCurve,
    /// Infinite for a thick print.
    thickness_mm: f64,
    /// Linear RGB rows over the channels.
    to_rgb: [Vec<f64>; 3],
    white_rgb: [f64; 3],
}

impl MixtureModel {
    /// Of a table over any channels, seen under D65, its designated white material by name, and the
    /// resin's refractive index.
    ///
    /// ```
    /// use pellucid_color::mixture::MixtureModel;
    /// use pellucid_voxel::MaterialTable;
    /// let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?;
    /// let rgb = model.linear_rgb(&[0.0, 0.0, 0.0, 0.0, 1.0]);
    /// assert!(rgb[1] > rgb[0]); // thick white resin is not neutral
    /// assert_eq!(model.relative_rgb(&[0.0, 0.0, 0.0, 0.0, 1.0]), [1.0; 3]);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for an unknown white, fewer than 2 materials, a material that
    /// neither scatters nor absorbs, or an index outside 1 to 3; [`ColorError::Unsupported`] for
    /// more than [`MAX_MATERIALS`] materials or bands that tell no colour.
    pub fn new(table: &MaterialTable, white: &str, refractive_index: f64) -> Result<Self, ColorError> {
        Self::under(table, white, refractive_index, Illuminant::D65)
    }

    /// As [`Self::new`] under another illuminant, or for another observer; it changes how bands are seen
    /// ([`Conditions::rows_for`]).
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn under(
        table: &MaterialTable,
        white: &str,
        refractive_index: f64,
        conditions: impl Into<Conditions>,
    ) -> Result<Self, ColorError> {
        Self::with_weights(table, white, refractive_index, conditions.into().rows_for(table.spectrum())?)
    }

    /// As [`Self::new`] with rows of one's own from channels to linear RGB.
    ///
    /// # Errors
    /// As [`Self::new`], and for rows of another length than the channels.
    pub fn with_weights(
        table: &MaterialTable,
        white: &str,
        refractive_index: f64,
        to_rgb: [Vec<f64>; 3],
    ) -> Result<Self, ColorError> {
        let (count, channels) = (table.len(), table.channels());
        let white = check::checked(table, white, &to_rgb)?;
        let mut absorption = vec![[0.0; MAX_MATERIALS]; channels];
        let mut reduced = absorption.clone();
        let mut scattering = absorption.clone();
        let (mut g_low, mut g_high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (i, material) in table.materials().iter().enumerate() {
            for channel in 0..channels {
                let g = f64::from(material.g.at(channel));
                (g_low, g_high) = (g_low.min(g), g_high.max(g));
                let (s, a) = (f64::from(material.sigma_s[channel]), f64::from(material.sigma_a[channel]));
                absorption[channel][i] = a;
                reduced[channel][i] = (1.0 - g) * s;
                scattering[channel][i] = s;
            }
        }
        let curve = ReflectanceCurve::half_space(refractive_index, g_low, g_high)?;
        let names = table.materials().iter().map(|m| m.name.clone()).collect();
        let mut model = Self {
            count,
            white,
            names,
            absorption,
            reduced,
            scattering,
            curve,
            thickness_mm: f64::INFINITY,
            to_rgb,
            white_rgb: [1.0; 3],
        };
        let mut pure = [0.0; MAX_MATERIALS];
        pure[white] = 1.0;
        model.white_rgb = model.rgb_of(&pure, None);
        if let Some(bad) = model.white_rgb.iter().find(|v| !v.is_finite() || **v <= 1e-3) {
            return Err(ColorError::invalid(
                "white",
                format!("its colour has a component of {bad}; it must reflect"),
            ));
        }
        Ok(model)
    }

    /// The same materials in a slab of the given thickness, lit from both sides, as thin parts of
    /// an object are. Light crosses a thin slab, so it reaches neither the dark nor the saturated
    /// colours of a thick print, but lighter ones. Colours stay relative to the thick print's
    /// white.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] unless the thickness is positive and finite.
    pub fn with_thickness(&self, thickness_mm: f64) -> Result<Self, ColorError> {
        if !(thickness_mm > 0.0 && thickness_mm.is_finite()) {
            return Err(ColorError::invalid(
                "thickness",
                format!("{thickness_mm} mm must be positive and finite"),
            ));
        }
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        let (mut g_low, mut g_high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (channel, absorption) in self.absorption.iter().enumerate() {
            for i in 0..self.count {
                let (reduced, scattering) = (self.reduced[channel][i], self.scattering[channel][i]);
                (low, high) = (low.min(absorption[i] + reduced), high.max(absorption[i] + reduced));
                if scattering > 0.0 {
                    let g = 1.0 - reduced / scattering;
                    (g_low, g_high) = (g_low.min(g), g_high.max(g));
                }
            }
        }
        if g_low > g_high || g_high - g_low < 1e-9 {
            (g_low, g_high) = (g_low.min(g_high), g_low.min(g_high));
        }
        let curve = ReflectanceCurve::slab(
            self.curve.refractive_index(),
            g_low,
            g_high,
            low * thickness_mm,
            high * thickness_mm,
        )?;
        Ok(Self {
            curve,
            thickness_mm,
            names: self.names.clone(),
            absorption: self.absorption.clone(),
            reduced: self.reduced.clone(),
            scattering: self.scattering.clone(),
            to_rgb: self.to_rgb.clone(),
            ..*self
        })
    }

    /// Thickness in mm of the slab that this is a model of; infinite for a thick print.
    pub fn thickness_mm(&self) -> f64 {
        self.thickness_mm
    }

    /// Number of materials.
    pub fn materials(&self) -> usize {
        self.count
    }

    /// Position of the white material in label order.
    pub fn white(&self) -> usize {
        self.white
    }

    /// Name of each material.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Linear RGB of the thick white print: the media white, about 0.8 for the default materials.
    pub fn media_white(&self) -> [f64; 3] {
        self.white_rgb
    }

    /// Radiance of the thick white print, by channel.
    pub fn white_radiance(&self) -> Vec<f64> {
        let mut pure = [0.0; MAX_MATERIALS];
        pure[self.white] = 1.0;
        (0..self.absorption.len()).map(|channel| self.channel(channel, &pure, None)).collect()
    }

    /// From radiance to colour as this model sees it, relative to the thick white print.
    ///
    /// ```
    /// use pellucid_color::MixtureModel;
    /// use pellucid_voxel::MaterialTable;
    /// let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?;
    /// let white: Vec<f32> = model.white_radiance().iter().map(|&v| v as f32).collect();
    /// assert_eq!(model.viewing().relative_rgb(&white), [1.0; 3]);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    pub fn viewing(&self) -> Viewing {
        let checked =
            MediaWhite::new(self.white_rgb).and_then(|w| Viewing::from_rows(self.to_rgb.clone(), w));
        checked.expect("the model's rows and white were checked when it was built")
    }

    /// Largest component of a perfect diffuser relative to the media white, at least 1.
    pub(crate) fn brightest(&self) -> f64 {
        self.white_rgb.iter().map(|w| 1.0 / w).fold(1.0, f64::max)
    }

    /// Radiance per channel of a mixture (0 to 1), into `out`; the shorter length counts.
    pub fn radiance(&self, fractions: &[f32], out: &mut [f64]) {
        let x = self.widen(fractions);
        for (channel, out) in out.iter_mut().enumerate().take(self.absorption.len()) {
            *out = self.channel(channel, &x, None);
        }
    }

    /// Linear RGB of a mixture, absolute: a perfect diffuser is 1.
    pub fn linear_rgb(&self, fractions: &[f32]) -> [f64; 3] {
        self.rgb_of(&self.widen(fractions), None)
    }

    /// Linear RGB of a mixture relative to the media white.
    pub fn relative_rgb(&self, fractions: &[f32]) -> [f64; 3] {
        let rgb = self.linear_rgb(fractions);
        std::array::from_fn(|i| rgb[i] / self.white_rgb[i])
    }

    /// Absolute linear RGB of a layer of one mixture on a thick base of another, such as a coloured
    /// skin on a white core. Solves the layers exactly: milliseconds, for tables and studies.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when the thickness is negative or not finite, or all fractions are 0.
    pub fn linear_rgb_over(
        &self,
        solver: &Solver,
        fractions: &[f32],
        thickness_mm: f64,
        base: &[f32],
    ) -> Result<[f64; 3], ColorError> {
        let (skin, base) = (self.widen(fractions), self.widen(base));
        let mut rgb = [0.0; 3];
        for channel in 0..self.absorption.len() {
            let layer = |x: &[f64; MAX_MATERIALS], thickness_mm: f64| {
                let mean =
                    |values: &[f64; MAX_MATERIALS]| x.iter().zip(values).map(|(w, v)| w * v).sum::<f64>();
                let sigma_s = mean(&self.scattering[channel]);
                let g = if sigma_s > 0.0 { 1.0 - mean(&self.reduced[channel]) / sigma_s } else { 0.0 };
                Layer { sigma_s, sigma_a: mean(&self.absorption[channel]), g, thickness_mm }
            };
            if !(thickness_mm >= 0.0 && thickness_mm.is_finite()) {
                return Err(ColorError::invalid(
                    "thickness",
                    format!("{thickness_mm} mm must be finite and at least 0"),
                ));
            }
            let radiance =
                solver.radiance_normal(&[layer(&skin, thickness_mm), layer(&base, f64::INFINITY)])?;
            for i in 0..3 {
                rgb[i] += self.to_rgb[i][channel] * radiance;
            }
        }
        Ok(rgb)
    }

    fn widen(&self, fractions: &[f32]) -> [f64; MAX_MATERIALS] {
        let mut x = [0.0; MAX_MATERIALS];
        for (x, f) in x.iter_mut().zip(&fractions[..fractions.len().min(self.count)]) {
            *x = f64::from(*f);
        }
        x
    }

    /// Absolute linear RGB, and its derivatives by fraction.
    pub(crate) fn rgb_of(
        &self,
        x: &[f64; MAX_MATERIALS],
        jacobian: Option<&mut [[f64; MAX_MATERIALS]; 3]>,
    ) -> [f64; 3] {
        let mut rgb = [0.0; 3];
        if let Some(jacobian) = jacobian {
            *jacobian = [[0.0; MAX_MATERIALS]; 3];
            for channel in 0..self.absorption.len() {
                let mut slope = [0.0; MAX_MATERIALS];
                let value = self.channel(channel, x, Some(&mut slope));
                for i in 0..3 {
                    let weight = self.to_rgb[i][channel];
                    rgb[i] += weight * value;
                    for (sum, slope) in jacobian[i].iter_mut().zip(slope) {
                        *sum += weight * slope;
                    }
                }
            }
            return rgb;
        }
        for channel in 0..self.absorption.len() {
            let value = self.channel(channel, x, None);
            for i in 0..3 {
                rgb[i] += self.to_rgb[i][channel] * value;
            }
        }
        rgb
    }

    /// Radiance of one channel, and its derivatives by fraction.
    fn channel(
        &self,
        channel: usize,
        x: &[f64; MAX_MATERIALS],
        slope: Option<&mut [f64; MAX_MATERIALS]>,
    ) -> f64 {
        let mean = |per_material: &[f64; MAX_MATERIALS]| -> f64 {
            let mut sum = 0.0;
            for (weight, value) in x.iter().zip(per_material) {
                sum += weight * value;
            }
            sum
        };
        let (a, r) = (mean(&self.absorption[channel]), mean(&self.reduced[channel]));
        let total = a + r;
        if total <= 0.0 {
            return 0.0;
        }
        let s = (a / total).sqrt();
        let depth = total * self.thickness_mm;
        let scattering = mean(&self.scattering[channel]);
        let g = if scattering > 0.0 { 1.0 - r / scattering } else { 0.0 };
        let [value, by_s, by_g, by_log_depth] = self.curve.at(s, g, depth);
        if let Some(slope) = slope {
            // d(s²) = (r da - a dr) / total²; g = 1 - r / scattering; the depth grows with a + r.
            let in_s = by_s / (2.0 * s.max(1e-6) * total * total);
            let in_g = if scattering > 0.0 { by_g / scattering } else { 0.0 };
            for i in 0..self.count {
                let (da, dr) = (self.absorption[channel][i], self.reduced[channel][i]);
                slope[i] = in_s * (r * da - a * dr)
                    + in_g * ((1.0 - g) * self.scattering[channel][i] - dr)
                    + by_log_depth * (da + dr) / total;
            }
        }
        value
    }
}

#[cfg(test)]
mod tests;
