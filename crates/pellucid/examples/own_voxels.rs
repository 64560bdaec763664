//! Voxels that a tool made itself, such as a simulation's, with a colour for each surface voxel.
//!
//! `cargo run --release -p pellucid --example own_voxels -- print`

use std::path::Path;

use pellucid::voxel::{Frame, LabelGrid};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, Report, Workspace};

/// Prepares a ball whose colours follow a field.
pub fn ball(diameter_mm: f64, settings: PrintSettings, out: &Path) -> Result<Report, PrintError> {
    let job = PrintJob::new(settings)?;
    let pitch = job.settings().printer.pitch();
    let size = pitch.mm().map(|mm| (diameter_mm / mm).ceil() as u32);
    let frame = Frame::new([-diameter_mm / 2.0; 3], pitch, size)?;
    let centre = |voxel: [u32; 3]| frame.centre_mm(voxel.map(i64::from));
    // Solid where the label is not 0; which material goes where is the job's to find.
    let solid = LabelGrid::from_fn(frame, |voxel| {
        let square: f64 = centre(voxel).iter().map(|c| c * c).sum();
        u8::from(square.sqrt() < diameter_mm / 2.0)
    });
    // Linear RGB.
    let color = |voxel| {
        let [x, _, z] = centre(voxel);
        let wave = (0.5 + 0.5 * (4.0 * x + 3.0 * z).sin()) as f32;
        [0.1 + 0.7 * wave, 0.25, 0.6 - 0.4 * wave]
    };
    let monitor = Monitor::silent();
    let prepared = job.prepare_volume("ball", &solid, color, &Workspace::none(), &monitor)?;
    prepared.write(out, true, &monitor)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("own_voxels OUT")?;
    let report = ball(6.0, PrintSettings::default(), out.as_ref())?;
    println!("{} surface voxels in {} layers", report.surface_voxels, report.layers);
    Ok(())
}
