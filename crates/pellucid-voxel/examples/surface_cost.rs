//! What surfaces and nearest-surface maps cost: solid spheres at the J750's pitch.
//!
//! `cargo run --release -p pellucid-voxel --example surface_cost -- [DIAMETER_MM ...]`
//!
//! Prints, for each diameter, the voxels in the box, the wall and processor seconds and the memory
//! of each step (thickness up to 5 mm; one look-up a surface voxel), and the angle between the
//! normals and the sphere's own.

use std::time::Instant;

use pellucid_voxel::{
    Control, Frame, LabelGrid, NearestSurface, Pitch, Surface, SurfaceOptions, TILE, TILE_VOXELS, Tile,
    local_thickness_mm,
};

const DEPTH_MM: f64 = 2.0;

/// A sphere of label 5 with two voxels of air around it.
fn sphere(diameter_mm: f64) -> LabelGrid {
    let mm = Pitch::j750().mm();
    let size = mm.map(|edge| (diameter_mm / edge).ceil() as u32 + 4);
    let origin: [f64; 3] = std::array::from_fn(|a| -0.5 * f64::from(size[a]) * mm[a]);
    let frame = Frame::new(origin, Pitch::j750(), size).expect("the sphere fits a frame");
    let r2 = (diameter_mm / 2.0).powi(2);
    LabelGrid::from_tiles(frame, |t| {
        let corner = t.map(|v| i64::from(v) * TILE as i64);
        let low = frame.centre_mm(corner);
        let high = frame.centre_mm(corner.map(|c| c + TILE as i64 - 1));
        let nearest: f64 = (0..3).map(|a| 0.0f64.clamp(low[a], high[a]).powi(2)).sum();
        let farthest: f64 = (0..3).map(|a| low[a].abs().max(high[a].abs()).powi(2)).sum();
        if nearest > r2 {
            return Tile::Constant(0);
        }
        if farthest <= r2 {
            return Tile::Constant(5);
        }
        let mut labels = Box::new([0; TILE_VOXELS]);
        for (i, label) in labels.iter_mut().enumerate() {
            let local = Tile::coords(i);
            let c = frame.centre_mm(std::array::from_fn(|a| corner[a] + local[a] as i64));
            *label = 5 * u8::from(c.iter().map(|v| v * v).sum::<f64>() <= r2);
        }
        Tile::Dense(labels)
    })
}

/// Largest resident size of this process so far in MiB, where the system tells.
fn peak_mib() -> Option<f64> {
    Some(pellucid_core::memory::peak_bytes()? as f64 / f64::from(1 << 20))
}

/// Processor time of all threads so far in seconds, where the system tells; 100 ticks a second.
fn cpu_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
    let ticks: u64 = fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?;
    Some(ticks as f64 / 100.0)
}

/// Runs a step and tells its wall and processor time in seconds.
fn timed<T>(step: impl FnOnce() -> T) -> (T, String) {
    let (start, cpu) = (Instant::now(), cpu_s());
    let result = step();
    let wall = start.elapsed().as_secs_f64();
    let cpu = cpu_s().zip(cpu).map_or("?".to_owned(), |(after, before)| format!("{:.2}", after - before));
    (result, format!("{wall:.2} / {cpu}"))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut diameters = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<Vec<f64>, _>>()?;
    if diameters.is_empty() {
        diameters = vec![20.0, 40.0, 60.0];
    }
    println!(
        "| diameter mm | box 10^6 | solid 10^6 | surface 10^6 | within {DEPTH_MM} mm 10^6 | grid s | surface s | nearest s | \
         thickness s | look-ups s | surface MiB | nearest MiB | peak MiB | normals rms, max degrees | least thickness mm |"
    );
    println!("|{}", " --- |".repeat(15));
    for diameter in diameters {
        let (grid, grid_s) = timed(|| sphere(diameter));
        let (surface, surface_s) =
            timed(|| Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()));
        let surface = surface?;
        let (nearest, nearest_s) =
            timed(|| NearestSurface::build(&grid, &surface, DEPTH_MM, &Control::none()));
        let nearest = nearest?;
        let (thickness, thickness_s) = timed(|| local_thickness_mm(&grid, &surface, 5.0, &Control::none()));
        let thinnest = thickness?.into_iter().fold(f32::INFINITY, f32::min);

        // Every surface voxel once, in an order that jumps about the object.
        let count = surface.len() as u64;
        let (found_all, lookup_s) = timed(|| {
            let position = |i: u64| (i * 0x9e37_79b9 % count) as usize;
            (0..count).filter(|&i| surface.index_of(surface.voxels()[position(i)]).is_some()).count()
        });
        assert_eq!(found_all, surface.len(), "every surface voxel has an index");

        let found: u64 = (0..grid.tiles().len())
            .filter_map(|i| nearest.tile(i))
            .map(|tile| tile.iter().filter(|&&e| e != NearestSurface::NONE).count() as u64)
            .sum();
        let (mut sum, mut worst) = (0.0f64, 0.0f64);
        for (i, n) in surface.normals().iter().enumerate() {
            let p = surface.position_mm(i as u32);
            let length = p.iter().map(|c| c * c).sum::<f64>().sqrt();
            let cos: f64 = (0..3).map(|a| p[a] / length * f64::from(n[a])).sum();
            let angle = cos.clamp(-1.0, 1.0).acos().to_degrees();
            sum += angle * angle;
            worst = worst.max(angle);
        }
        println!(
            "| {diameter} | {:.0} | {:.0} | {:.2} | {:.1} | {grid_s} | {surface_s} | {nearest_s} | {thickness_s} | {lookup_s} | {:.0} | {:.0} | {} | {:.2}, {worst:.1} | {thinnest:.1} |",
            grid.frame().voxels() as f64 / 1e6,
            grid.histogram()[5] as f64 / 1e6,
            surface.len() as f64 / 1e6,
            found as f64 / 1e6,
            surface.memory_bytes() as f64 / f64::from(1 << 20),
            nearest.memory_bytes() as f64 / f64::from(1 << 20),
            peak_mib().map_or("?".to_owned(), |mib| format!("{mib:.0}")),
            (sum / surface.len() as f64).sqrt(),
        );
    }
    Ok(())
}
