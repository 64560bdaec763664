//! Stencil extraction in processor time, for machines that others use too: wall time there says
//! more about the others. Linux only.
//!
//! `cargo run --release -p pellucid-benches --example stencil_rate -- DIAMETER_MM [POINTS]`

use std::time::Instant;

use pellucid_benches::volumes;
use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils, near_order};
use pellucid_voxel::{Control, CountSat, MaterialTable};

/// Seconds that all threads of this process have run.
fn processor_seconds() -> f64 {
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else { return f64::NAN };
    let nanoseconds = threads.flatten().filter_map(|thread| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    nanoseconds.sum::<f64>() * 1e-9
}

fn main() {
    let mut args = std::env::args().skip(1);
    let diameter = args.next().and_then(|a| a.parse().ok()).unwrap_or(20.0);
    let limit = args.next().and_then(|a| a.parse().ok()).unwrap_or(32_768);
    let table = MaterialTable::cmykw();
    let none = Control::none();
    let grid = volumes::dimpled_ball(diameter, 1.0);
    let sat = CountSat::build(&grid, table.len(), &none).expect("a valid grid");
    println!("ball {diameter} mm: {:?} voxels, table {:?}", grid.size(), sat.memory());
    let points = volumes::surface_points(&grid, limit);
    let points: Vec<_> = near_order(&points).into_iter().map(|i| points[i as usize]).collect();
    let rgb = Coefficients::all(&table, Features::ScatterAbsorb).expect("channels");
    // Both live to the end: the time of threads that have ended would be missed.
    let pools = [1, 2].map(|n| (n, rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool")));
    for (threads, pool) in &pools {
        for levels in [1, 4, 5, 6, 7, 8, 9] {
            let spec = StencilSpec::new([5, 3, 9], levels).expect("a valid spec");
            let stencils = Stencils::new(spec, &grid, &sat).expect("same size");
            let row = rgb.values_per_point(&spec);
            let mut out = vec![0.0; 8192 * row];
            let (mut processor, mut wall) = (f64::INFINITY, f64::INFINITY);
            for _ in 0..5 {
                let (start, clock) = (processor_seconds(), Instant::now());
                for points in points.chunks(8192) {
                    pool.install(|| stencils.extract(&rgb, points, &mut out[..points.len() * row], &none))
                        .expect("valid");
                }
                processor = processor.min(processor_seconds() - start);
                wall = wall.min(clock.elapsed().as_secs_f64());
            }
            let n = points.len() as f64;
            println!(
                "{threads} threads, {levels} levels: {:.2} us of processor a point, so {:.0} points/s on {threads} cores; {:.0} points/s by the clock",
                1e6 * processor / n,
                *threads as f64 * n / processor,
                n / wall,
            );
        }
    }
}
