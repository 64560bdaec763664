//! How colours, and pairs of them, change from one viewing to another.

use crate::space::{Lab, Xyz};
use crate::{Viewing, delta_e_2000};

/// Colour inconstancy: CIEDE2000 between what a radiance (one value a channel) looks like in two viewings, each with
/// its light's colour discounted. 0 for a colour that stays itself, as the print's white does.
///
/// ```
/// use pellucid_color::{Viewing, constancy, spectrum::Illuminant};
/// use pellucid_voxel::Channels;
/// let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
/// let [day, lamp] = [Illuminant::D65, Illuminant::A].map(|i| Viewing::new(&bands, i, &[0.8; 31]).unwrap());
/// assert!(constancy::inconstancy(&day, &lamp, &[0.2; 31]) < 1e-3); // a flat grey stays grey
/// let purple: Vec<f32> = (0..31).map(|k| if (8..22).contains(&k) { 0.2 } else { 0.6 }).collect();
/// assert!(constancy::inconstancy(&day, &lamp, &purple) > 2.0);
/// ```
pub fn inconstancy(one: &Viewing, other: &Viewing, radiance: &[f32]) -> f64 {
    delta_e_2000(seen(one, radiance), seen(other, radiance))
}

/// Special index of metamerism, change in illuminant (CIE 15): CIEDE2000 between two radiances in the viewing `test`,
/// once what sets them apart in the viewing `reference` was taken out by scaling X, Y and Z. 0 for equal spectra, and for
/// colours that differ in both viewings alike.
///
/// ```
/// use pellucid_color::{Viewing, constancy, spectrum::Illuminant};
/// use pellucid_voxel::Channels;
/// let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
/// let [day, lamp] = [Illuminant::D65, Illuminant::A].map(|i| Viewing::new(&bands, i, &[1.0; 31]).unwrap());
/// let grey = [0.3; 31];
/// let striped: Vec<f32> = (0..31).map(|k| if k / 4 % 2 == 0 { 0.45 } else { 0.15 }).collect();
/// assert_eq!(constancy::metamerism_index(&day, &lamp, &grey, &grey), 0.0);
/// assert!(constancy::metamerism_index(&day, &lamp, &striped, &grey) > 0.5);
/// ```
pub fn metamerism_index(reference: &Viewing, test: &Viewing, sample: &[f32], standard: &[f32]) -> f64 {
    let xyz = |viewing: &Viewing, radiance: &[f32]| {
        Xyz::from_linear_rgb(viewing.relative_rgb(radiance).map(f64::from))
    };
    let (own, meant) = (xyz(reference, sample), xyz(reference, standard));
    let scaled = |value: f64, own: f64, meant: f64| if own > 0.0 { value * meant / own } else { value };
    let shown = xyz(test, sample);
    let corrected = Xyz {
        x: scaled(shown.x, own.x, meant.x),
        y: scaled(shown.y, own.y, meant.y),
        z: scaled(shown.z, own.z, meant.z),
    };
    delta_e_2000(corrected.to_lab(Xyz::D65), xyz(test, standard).to_lab(Xyz::D65))
}

fn seen(viewing: &Viewing, radiance: &[f32]) -> Lab {
    Lab::from_linear_rgb(viewing.relative_rgb(radiance).map(f64::from))
}
