//! What slices that another tool made will look like when they are printed: a stack of PNGs in, a picture out.
//!
//! `cargo run --release -p pellucid --example look_of_slices -- folder 'slice_*.png' look.png`

use std::path::Path;
use std::sync::Arc;

use pellucid::color::{Viewing, spectrum::Illuminant};
use pellucid::core::Control;
use pellucid::predict::{Changed, Draw, MonteCarlo, Object, Pass, Predictor};
use pellucid::proof::{View, Visibility};
use pellucid::slice::{ImageStack, PrintTarget, list_images, read_images};
use pellucid::voxel::{MaterialTable, Surface, SurfaceOptions};

const REFRACTIVE_INDEX: f64 = 1.5;

/// Draws a stack in the colours of a printer's palette, as traced with so many paths a point and channel.
pub fn draw(
    folder: &Path,
    pattern: &str,
    spp: u32,
    picture: &Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let (printer, materials, control) = (PrintTarget::j750(), MaterialTable::cmykw(), Control::none());
    let stack = ImageStack::for_target(&printer, &materials)?;
    let labels = read_images(&list_images(folder, pattern)?, &stack, &control)?;
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control)?;
    let view = View::new("front", 30.0, 20.0)?;
    let seen = Visibility::trace(&labels, &surface, &view, 480, &control)?;
    let viewing = Viewing::of_print(&materials, "white", REFRACTIVE_INDEX, Illuminant::D65)?;
    let object = Arc::new(Object::new(surface, materials, REFRACTIVE_INDEX)?);

    let mut bound = MonteCarlo::new(spp)?.bind(Arc::clone(&object))?;
    bound.update(&labels, Changed::Unknown, &control)?;
    // Only what the picture shows.
    let points = seen.visible_points();
    let mut radiance = vec![0.0; points.len() * object.channels()];
    bound.predict(&points, Draw::new(0, Pass::Proof), &mut radiance, &control)?;

    let mut colors = vec![[0.0; 3]; object.surface().len()];
    for (&point, radiance) in points.iter().zip(radiance.chunks_exact(object.channels())) {
        colors[point as usize] = viewing.relative_rgb(radiance);
    }
    seen.shade(&colors, &control)?.write_png(picture, &control)?;
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, pattern, picture] = &arguments[..] else {
        return Err("look_of_slices FOLDER PATTERN PICTURE".into());
    };
    draw(folder.as_ref(), pattern, 256, picture.as_ref())
}
