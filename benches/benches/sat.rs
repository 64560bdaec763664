//! Summed-area tables: build, incremental rebuild.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pellucid_benches::volumes;
use pellucid_voxel::{Control, CountSat};

fn build(c: &mut Criterion) {
    let none = Control::none();
    let mut group = c.benchmark_group("sat build");
    group.sample_size(10);
    for (name, grid) in [
        ("constant", volumes::block([384; 3])),
        ("shell, 20 mm", volumes::dimpled_ball(20.0, 1.0)),
        ("mixed noise", volumes::noise([384; 3])),
    ] {
        let sat = CountSat::build(&grid, 5, &none).expect("a valid grid");
        println!("{name}: {:?} {}", sat.memory(), grid.frame().voxels());
        drop(sat);
        group.throughput(Throughput::Elements(grid.frame().voxels()));
        group.bench_function(name, |b| b.iter_with_large_drop(|| CountSat::build(&grid, 5, &none)));
    }
    group.finish();
}

criterion_group!(benches, build);
criterion_main!(benches);
