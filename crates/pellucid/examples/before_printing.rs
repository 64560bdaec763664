//! What can be said within seconds, before any refinement: size, layers, thin walls, colours out of reach. A print
//! server answers with this while a customer waits.
//!
//! `cargo run --release -p pellucid --example before_printing -- model.glb 12`

use std::path::Path;

use pellucid::color::delta_e::delta_e_2000_of_linear_rgb;
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings};

/// Differences from the texture above this are noticed side by side.
const NOTICED: f32 = 5.0;

/// An answer to a customer.
pub struct Outlook {
    /// Size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// Number of layers.
    pub layers: u32,
    /// Part of the surface whose colour the inks cannot show, 0 to 1.
    pub out_of_gamut: f64,
    /// Part of the surface whose colour its wall is too thin for, 0 to 1.
    pub too_thin: f64,
}

/// Looks at a model so many mm high.
pub fn look(model: &Path, height_mm: f64) -> Result<Outlook, PrintError> {
    let job = PrintJob::new(PrintSettings { scale: Scale::HeightMm(height_mm), ..PrintSettings::default() })?;
    let monitor = Monitor::silent();
    let placed = job.place(&import_path(model, &ImportLimits::default())?, &monitor)?;
    let aimed = job.aim(placed, &monitor)?;
    let part = |from: &[[f32; 3]], to: &[[f32; 3]]| {
        let mut difference = vec![0.0; from.len()];
        delta_e_2000_of_linear_rgb(from, to, &mut difference);
        difference.iter().filter(|d| **d > NOTICED).count() as f64 / difference.len().max(1) as f64
    };
    Ok(Outlook {
        extent_mm: aimed.extent_mm,
        layers: aimed.solid.size()[2],
        out_of_gamut: part(&aimed.target, &aimed.gamut_target),
        too_thin: part(&aimed.gamut_target, &aimed.printable_target),
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, height_mm] = &arguments[..] else {
        return Err("before_printing MODEL HEIGHT_MM".into());
    };
    let outlook = look(model.as_ref(), height_mm.parse()?)?;
    let [x, y, z] = outlook.extent_mm;
    println!("{x:.1} x {y:.1} x {z:.1} mm in {} layers", outlook.layers);
    println!("colours out of the inks' reach on {:.0} % of the surface", 100.0 * outlook.out_of_gamut);
    println!("walls too thin for their colour on {:.0} %", 100.0 * outlook.too_thin);
    Ok(())
}
