//! Pictures of single predictions beside each other, as in the paper's Figures 11 and 12.

use std::path::Path;

use pellucid::color::delta_e::delta_e_2000_of_linear_rgb;
use pellucid::proof::{Picture, View, Visibility, contact_sheet};
use pellucid::voxel::Control;
use pellucid_benches::appearance::{heat_color, signed_color};

use super::Error;
use super::finished::Finished;
use super::object::Case;

/// CIEDE2000 that is shown brightest.
pub const FULL_DELTA_E: f32 = 10.0;
/// Difference in radiance that is shown in full colour.
pub const FULL_DIFFERENCE: f32 = 0.1;

/// How a picture is made.
#[derive(Clone, Copy)]
pub struct Look {
    /// Longer edge in pixels.
    pub edge: u32,
    /// Paths of the reference.
    pub spp: u32,
}

/// Draws a column for the reference and one for each network: appearance, CIEDE2000 from the reference, and the mean
/// difference over channels. Below the reference stand the scales of the false colours.
pub fn draw(
    path: &Path,
    case: &Case,
    networks: &[&Finished],
    look: Look,
    control: &Control<'_>,
) -> Result<(), Error> {
    let surface = case.object.surface();
    let view = View::front_and_back().swap_remove(0);
    let seen = Visibility::trace(&case.labels, surface, &view, look.edge, control)?;
    let points = seen.visible_points();
    let channels = case.object.channels();
    // Errors are those of pixels: each averages several voxels, and with them the reference's noise.
    let shade = |color: &dyn Fn(usize) -> [f32; 3]| {
        let mut all = vec![[0.0; 3]; surface.len()];
        points.iter().enumerate().for_each(|(i, &p)| all[p as usize] = color(i));
        seen.shade(&all, control)
    };
    let of_point = |i: usize| i * channels..(i + 1) * channels;
    let appearance = |values: &[f32]| shade(&|i| case.viewing.relative_rgb(&values[of_point(i)]));
    let mean = |values: &[f32]| {
        let mean = |i: usize| values[of_point(i)].iter().sum::<f32>() / channels as f32;
        shade(&|i| [mean(i); 3])
    };

    let reference = case.traced(&points, look.spp, control)?;
    let (seen_reference, mean_reference) = (appearance(&reference)?, mean(&reference)?);
    let mut rows = [
        vec![seen_reference.clone()],
        vec![scale(&seen_reference, &|part| heat_color(part, 1.0))?],
        vec![scale(&seen_reference, &|part| signed_color(2.0 * part - 1.0, 1.0))?],
    ];
    for network in networks {
        let predicted = case.predicted(network, &points, control)?;
        let (shown, mean) = (appearance(&predicted)?, mean(&predicted)?);
        let mut difference = vec![0.0; shown.rgba().len() / 4];
        delta_e_2000_of_linear_rgb(&rgb(&shown), &rgb(&seen_reference), &mut difference);
        let signed = rgb(&mean).into_iter().zip(rgb(&mean_reference)).map(|(a, b)| a[0] - b[0]);
        let signed: Vec<f32> = signed.collect();
        rows[1].push(over(&shown, |i| heat_color(difference[i], FULL_DELTA_E))?);
        rows[2].push(over(&shown, |i| signed_color(signed[i], FULL_DIFFERENCE))?);
        rows[0].push(shown);
    }
    contact_sheet(&rows, control)?.write_png(path, control)?;
    Ok(())
}

/// The colours of a picture's pixels.
fn rgb(picture: &Picture) -> Vec<[f32; 3]> {
    picture.rgba().as_chunks::<4>().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}

/// Other colours on the pixels of a picture.
fn over(picture: &Picture, color: impl Fn(usize) -> [f32; 3]) -> Result<Picture, Error> {
    let pixels = picture.rgba().as_chunks::<4>().0.iter().enumerate();
    let rgba = pixels.flat_map(|(i, &[.., a])| {
        let [r, g, b] = color(i);
        [r, g, b, a]
    });
    Ok(Picture::new(picture.width(), picture.height(), rgba.collect())?)
}

/// Share of a picture's height and width that a scale takes.
const SCALE: [f32; 2] = [0.12, 0.9];

/// A scale of false colours, from left to right, in the middle of a picture's place.
fn scale(place: &Picture, color: &dyn Fn(f32) -> [f32; 3]) -> Result<Picture, Error> {
    let (width, height) = (place.width(), place.height());
    let [tall, wide] = SCALE;
    let pixel = |i: u32| {
        let [x, y] = [(i % width) as f32 + 0.5, (i / width) as f32 + 0.5];
        let part = (x / width as f32 - 0.5) / wide + 0.5;
        let inside = (0.0..=1.0).contains(&part) && (y / height as f32 - 0.5).abs() < 0.5 * tall;
        let [r, g, b] = color(part.clamp(0.0, 1.0));
        [r, g, b, if inside { 1.0 } else { 0.0 }]
    };
    Ok(Picture::new(width, height, (0..width * height).flat_map(pixel).collect())?)
}
