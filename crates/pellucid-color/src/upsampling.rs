//! The smooth reflectance that a colour may have: a sigmoid of a parabola over the wavelengths (Jakob and Hanika 2019).

use nalgebra::{Matrix3, Vector3};

use crate::space::{lab_derivative_of_linear_rgb, lab_of_linear_rgb};
use crate::{ColorError, Viewing};
use pellucid_voxel::Channels;

/// Steps of Levenberg and Marquardt at most.
const STEPS: usize = 60;
/// Close enough, as Lab's distance.
const CLOSE: f32 = 1e-3;

/// Finds smooth reflectances for colours that are seen in one viewing.
///
/// A reflectance of 1 stands for the print's white: what is found are radiances relative to it. So a texture's colour
/// keeps its look in the viewing it is given for, and gets the look of a smooth pigment in any other.
///
/// ```
/// use pellucid_color::{Viewing, spectrum::Illuminant, upsampling::Upsampling};
/// use pellucid_voxel::Channels;
/// let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
/// let white: Vec<f64> = (0..31).map(|k| 0.7 + 0.005 * f64::from(k)).collect();
/// let viewing = Viewing::new(&bands, Illuminant::D65, &white)?;
/// let upsampling = Upsampling::new(&bands, &viewing, &white)?;
/// let radiance = upsampling.radiance([0.6, 0.2, 0.1]);
/// let seen = viewing.relative_rgb(&radiance);
/// assert!(seen.iter().zip([0.6, 0.2, 0.1]).all(|(a, b)| (a - b).abs() < 1e-4));
/// assert!(radiance[30] > 2.0 * radiance[10]);
/// # Ok::<(), pellucid_color::ColorError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Upsampling {
    /// What a reflectance adds to linear RGB, by band.
    weights: Vec<[f32; 3]>,
    /// Wavelengths from -1 to 1.
    places: Vec<f32>,
    /// Radiance of the print's white.
    white: Vec<f32>,
}

impl Upsampling {
    /// For bands that are seen in a viewing, by a print whose white has the radiance `white`, one value a band.
    ///
    /// # Errors
    /// [`ColorError::Unsupported`] for channels that are not bands, or fewer than 4; [`ColorError::Invalid`] for a
    /// viewing or a white of other channels.
    pub fn new(channels: &Channels, viewing: &Viewing, white: &[f64]) -> Result<Self, ColorError> {
        let nm: Vec<f64> = channels.wavelengths_nm().collect();
        if nm.len() < 4 {
            return Err(ColorError::unsupported(
                "channels",
                "a spectrum is needed: 4 or more bands of known wavelengths",
            ));
        }
        if viewing.channels() != nm.len() || white.len() != nm.len() {
            let (a, b) = (viewing.channels(), white.len());
            return Err(ColorError::invalid(
                "viewing",
                format!("{a} channels, white of {b}; {} bands", nm.len()),
            ));
        }
        let white: Vec<f32> = white.iter().map(|&w| w as f32).collect();
        let mut radiance = vec![0.0; nm.len()];
        let weights = (0..nm.len()).map(|band| {
            radiance[band] = white[band];
            let seen = viewing.relative_rgb(&radiance);
            radiance[band] = 0.0;
            seen
        });
        let weights = weights.collect();
        let middle = 0.5 * (nm[0] + nm[nm.len() - 1]);
        let half = 0.5 * (nm[nm.len() - 1] - nm[0]);
        let places = nm.iter().map(|v| ((v - middle) / half) as f32).collect();
        Ok(Self { weights, places, white })
    }

    /// Radiance by band of a colour, linear RGB relative to the print's white: that of a reflectance within 0 to 1 that
    /// looks like it, or as like it as any of this form does.
    pub fn radiance(&self, rgb: [f32; 3]) -> Vec<f32> {
        let coefficients = self.coefficients(rgb);
        let each = self.places.iter().zip(&self.white);
        each.map(|(&x, white)| white * sigmoid(parabola(&coefficients, x)).0).collect()
    }

    /// The parabola whose sigmoid is the reflectance: Levenberg and Marquardt's least squares in Lab.
    fn coefficients(&self, rgb: [f32; 3]) -> [f32; 3] {
        let aim = lab(rgb);
        // A grey of its luminance.
        let grey = (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]).clamp(1e-3, 0.999);
        let half = 2.0 * (grey - 0.5);
        let mut best = [half / (1.0 - half * half).sqrt(), 0.0, 0.0];
        let (mut residual, mut slopes) = self.residual(&best, aim);
        let mut damping = 1e-2;
        for _ in 0..STEPS {
            if residual.norm() < CLOSE || damping > 1e9 {
                break;
            }
            let normal = slopes.transpose() * slopes;
            let damped = normal + Matrix3::from_diagonal(&normal.diagonal().add_scalar(1e-6)) * damping;
            let step = damped.lu().solve(&(slopes.transpose() * residual)).unwrap_or_else(Vector3::zeros);
            let tried = std::array::from_fn(|i| best[i] - step[i]);
            let (there, slopes_there) = self.residual(&tried, aim);
            if there.norm() < residual.norm() {
                (best, residual, slopes) = (tried, there, slopes_there);
                damping *= 0.3;
            } else {
                damping *= 4.0;
            }
        }
        best
    }

    /// What a parabola's colour lacks in Lab, and how that changes with its coefficients.
    fn residual(&self, coefficients: &[f32; 3], aim: [f32; 3]) -> (Vector3<f32>, Matrix3<f32>) {
        let (mut rgb, mut by_coefficients) = ([0.0f32; 3], Matrix3::<f32>::zeros());
        for (&x, weights) in self.places.iter().zip(&self.weights) {
            let (value, slope) = sigmoid(parabola(coefficients, x));
            for (c, weight) in weights.iter().enumerate() {
                rgb[c] += weight * value;
                for (k, power) in [1.0, x, x * x].into_iter().enumerate() {
                    by_coefficients[(c, k)] += weight * slope * power;
                }
            }
        }
        let shown = lab(rgb);
        let by_rgb = lab_derivative_of_linear_rgb(rgb);
        let by_rgb = Matrix3::from_fn(|i, j| by_rgb[i][j]);
        (Vector3::from_fn(|i, _| shown[i] - aim[i]), by_rgb * by_coefficients)
    }
}

fn parabola(c: &[f32; 3], x: f32) -> f32 {
    c[0] + x * (c[1] + x * c[2])
}

/// 1/2 + x / (2 sqrt(1 + x²)), and its slope.
fn sigmoid(x: f32) -> (f32, f32) {
    let root = (1.0 + x * x).sqrt();
    (0.5 + 0.5 * x / root, 0.5 / (root * root * root))
}

fn lab(rgb: [f32; 3]) -> [f32; 3] {
    let mut lab = [[0.0; 3]];
    lab_of_linear_rgb(&[rgb], &mut lab);
    lab[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Illuminant;
    use proptest::prelude::*;

    const BANDS: Channels = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };

    fn upsampling() -> (Viewing, Upsampling) {
        let white: Vec<f64> = (0..31).map(|k| 0.6 + 0.008 * f64::from(k)).collect();
        let viewing = Viewing::new(&BANDS, Illuminant::D65, &white).unwrap();
        let upsampling = Upsampling::new(&BANDS, &viewing, &white).unwrap();
        (viewing, upsampling)
    }

    proptest! {
        /// Colours of surfaces are met; radiances lie between none and the white's.
        #[test]
        fn surface_colours_are_met(rgb in prop::array::uniform3(0.03f32..0.85)) {
            let (viewing, upsampling) = upsampling();
            let radiance = upsampling.radiance(rgb);
            for (radiance, white) in radiance.iter().zip(&upsampling.white) {
                prop_assert!((0.0..=*white).contains(radiance));
            }
            let seen = lab(viewing.relative_rgb(&radiance));
            let off = (0..3).map(|k| (seen[k] - lab(rgb)[k]).powi(2)).sum::<f32>().sqrt();
            prop_assert!(off < 0.05, "{rgb:?} off by {off}");
        }

        /// Whatever is asked, something finite within range comes.
        #[test]
        fn impossible_colours_end(rgb in prop::array::uniform3(-0.5f32..2.0)) {
            let (_, upsampling) = upsampling();
            let radiance = upsampling.radiance(rgb);
            prop_assert!(radiance.iter().all(|v| (0.0..=1.0).contains(v)));
        }
    }

    #[test]
    fn greys_are_flat_and_white_is_white() {
        let (_, upsampling) = upsampling();
        for grey in [0.02f32, 0.2, 0.5, 0.9] {
            let radiance = upsampling.radiance([grey; 3]);
            let relative: Vec<f32> = radiance.iter().zip(&upsampling.white).map(|(r, w)| r / w).collect();
            assert!(relative.iter().all(|r| (r - grey).abs() < 2e-3), "{grey} {relative:?}");
        }
        let radiance = upsampling.radiance([1.0; 3]);
        assert!(radiance.iter().zip(&upsampling.white).all(|(r, w)| r / w > 0.995));
    }

    #[test]
    fn channels_without_wavelengths_are_refused() {
        let (viewing, _) = upsampling();
        assert!(matches!(
            Upsampling::new(&Channels::Rgb, &viewing, &[1.0; 3]),
            Err(ColorError::Unsupported(_))
        ));
        assert!(matches!(Upsampling::new(&BANDS, &viewing, &[1.0; 3]), Err(ColorError::Invalid(_))));
    }
}
