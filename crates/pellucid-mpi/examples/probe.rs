//! What messages between the processes cost: seconds of a meeting without contents, and a second's bytes of a large one.
//!
//! `mpirun -n 2 cargo run --release --example probe`

use std::time::Instant;

use pellucid::core::Team;
use pellucid_mpi::World;

/// Meetings of which the fastest half are averaged.
const TIMES: usize = 41;
/// What the tracer's derivatives send at a time.
const LARGE: usize = 1 << 20;

fn main() {
    let Some(universe) = mpi::initialize() else { return };
    let world = World::of(&universe);
    let seconds = |work: &mut dyn FnMut()| {
        let mut all: Vec<f64> = (0..TIMES)
            .map(|_| {
                let start = Instant::now();
                work();
                start.elapsed().as_secs_f64()
            })
            .collect();
        all.sort_by(f64::total_cmp);
        all[..TIMES / 2].iter().sum::<f64>() / (TIMES / 2) as f64
    };
    let small = seconds(&mut || world.sum(&mut [1]));
    let mut values = vec![1; LARGE];
    let sum = seconds(&mut || world.sum(&mut values));
    let own = vec![1.0; LARGE / world.size()];
    let mut all = vec![0.0; own.len() * world.size()];
    let gather = seconds(&mut || world.gather(&own, &vec![own.len(); world.size()], &mut all));
    if world.rank() == 0 {
        let rate = |bytes: usize, seconds: f64| bytes as f64 / (seconds - small).max(1e-9);
        println!(
            "probe: {} ranks, {small:.3e} s a meeting, {:.3e} bytes/s added up, {:.3e} bytes/s gathered",
            world.size(),
            rate(size_of_val(&values[..]), sum),
            rate(size_of_val(&all[..]), gather)
        );
    }
}
