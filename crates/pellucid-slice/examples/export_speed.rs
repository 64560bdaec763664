//! Times slice export and read-back of a halftoned ball: `export_speed [DIAMETER_MM] [LAYERS]`.
//!
//! The ball is noise of five materials for 2 mm under its surface and white within, as a
//! prepared print is. `LAYERS` keeps only so many layers around its middle.
#![forbid(unsafe_code)]

use std::time::Instant;

use pellucid_slice::{ExportSettings, PrintTarget, export, read_stack};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, TILE, TILE_VOXELS, Tile};

fn ball(
    diameter_mm: f64,
    layers: u32,
    target: &PrintTarget,
) -> Result<LabelGrid, pellucid_voxel::VoxelError> {
    let mm = target.pitch().mm();
    let mut size: [u32; 3] = std::array::from_fn(|a| (diameter_mm / mm[a]).ceil() as u32);
    size[2] = size[2].min(layers);
    let half_height = f64::from(size[2]) * mm[2] / 2.0;
    let frame = Frame::new([-diameter_mm / 2.0, -diameter_mm / 2.0, -half_height], target.pitch(), size)?;
    Ok(LabelGrid::from_tiles(frame, |t| {
        let mut labels = Box::new([0; TILE_VOXELS]);
        for (i, label) in labels.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            let voxel: [u32; 3] = std::array::from_fn(|a| t[a] * TILE as u32 + local[a] as u32);
            let radius = frame.centre_mm(voxel.map(i64::from)).iter().map(|c| c * c).sum::<f64>().sqrt();
            let hash =
                voxel.iter().fold(0u64, |h, &v| (h ^ u64::from(v)).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            *label = match diameter_mm / 2.0 - radius {
                depth if depth < 0.0 => 0,
                depth if depth < 2.0 => ((hash >> 40) % 8).min(5) as u8,
                _ => 5,
            };
            if *label == 0 && radius <= diameter_mm / 2.0 {
                *label = 5;
            }
        }
        Tile::Dense(labels)
    }))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let diameter = args.next().map_or(Ok(20.0), |a| a.parse())?;
    let layers = args.next().map_or(Ok(u32::MAX), |a| a.parse())?;
    let target = PrintTarget::j750();
    let grid = ball(diameter, layers, &target)?;
    let dir = std::env::temp_dir().join(format!("export-speed-{}", std::process::id()));
    let voxels = grid.frame().voxels() as f64;
    println!("{:?} = {:.1} M voxels, {} threads", grid.size(), voxels / 1e6, rayon::current_num_threads());
    let start = Instant::now();
    let settings = ExportSettings::default();
    let manifest = export(&grid, &MaterialTable::cmykw(), &target, &settings, &dir, &Control::none())?;
    let seconds = start.elapsed().as_secs_f64();
    let mut bytes = 0;
    for entry in std::fs::read_dir(dir.join("slices"))? {
        bytes += entry?.metadata()?.len();
    }
    println!("export {seconds:.2} s, {:.0} M voxels/s, {:.1} MB", voxels / seconds / 1e6, bytes as f64 / 1e6);
    let start = Instant::now();
    let (back, _) = read_stack(&dir, &Control::none())?;
    let seconds = start.elapsed().as_secs_f64();
    println!("read   {seconds:.2} s, {:.0} M voxels/s", voxels / seconds / 1e6);
    assert!(back == grid, "{} layers differ", manifest.layers);
    std::fs::remove_dir_all(&dir)?;
    Ok(())
}
