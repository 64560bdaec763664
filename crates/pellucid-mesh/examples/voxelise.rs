//! Voxelises a model and prints what was found and how long each step took.
//!
//! `cargo run --release -p pellucid-mesh --example voxelise -- MODEL HEIGHT_MM`

use std::time::Instant;

use pellucid_mesh::{ImportLimits, Scale, ThicknessReport, VoxeliseOptions};
use pellucid_voxel::{Control, Surface, SurfaceOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, height] = arguments.as_slice() else {
        return Err("usage: voxelise MODEL HEIGHT_MM".into());
    };
    let control = Control::none();
    let mut clock = Instant::now();
    let mut lap = |what: &str| {
        println!("{what}: {:.2} s", clock.elapsed().as_secs_f64());
        clock = Instant::now();
    };

    let model = pellucid_mesh::import_path(path, &ImportLimits::default())?;
    lap("import");
    let options = VoxeliseOptions { scale: Scale::HeightMm(height.parse()?), ..Default::default() };
    let voxelised = pellucid_mesh::voxelise(&model, &options, &control)?;
    lap("voxelise");
    let grid = &voxelised.grid;
    println!("{:#?}", voxelised.report);
    println!(
        "{:?} voxels, {} solid, {} MB of labels",
        grid.size(),
        grid.histogram()[usize::from(options.label)],
        grid.memory_bytes() / 1_000_000
    );
    lap("count");
    let surface = Surface::extract(grid, &SurfaceOptions::default(), &control)?;
    lap("surface");
    println!("{} surface voxels", surface.len());
    let thickness = ThicknessReport::measure(grid, &surface, 1.0, &control)?;
    lap("thickness");
    println!(
        "{:.2} % of the surface is thinner than {} mm, in {} regions; the least is {:.3} mm",
        100.0 * thickness.thin_share,
        thickness.limit_mm,
        thickness.region_count,
        thickness.least_mm
    );
    let colors = pellucid_mesh::surface_colors(&model, &voxelised.placement, &surface, &control)?;
    lap("target colours");
    let mean: Vec<f64> = (0..3)
        .map(|c| colors.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / colors.len() as f64)
        .collect();
    println!("mean linear RGB {mean:.3?}");
    Ok(())
}
