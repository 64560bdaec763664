//! Summed-area tables: build and incremental rebuild, against dense f64 tables.
//!
//! `cargo bench -p pellucid-benches --bench sat`

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use pellucid_benches::dense::DenseSat;
use pellucid_benches::volumes;
use pellucid_voxel::{Control, CountSat, LabelGrid, MaterialTable, TILE_VOXELS, Tile};

/// Prints the bytes that a table holds.
fn report_memory(name: &str, grid: &LabelGrid) {
    let sat = CountSat::build(grid, 5, &Control::none()).expect("a valid grid");
    let memory = sat.memory();
    let mixed = memory.mixed_tiles * TILE_VOXELS;
    let voxels = grid.frame().voxels();
    let record = memory.records as f64 / grid.tiles().len() as f64;
    println!(
        "memory, {name}: {:.3} GiB for {voxels} voxels, {} mixed tiles, {:.0} bytes a constant tile, {:.2} bytes a mixed voxel",
        memory.total() as f64 / f64::powi(2.0, 30),
        memory.mixed_tiles,
        record,
        if mixed > 0 { memory.tiles as f64 / mixed as f64 + record / TILE_VOXELS as f64 } else { 0.0 },
    );
}

fn build(c: &mut Criterion) {
    let none = Control::none();
    let mut group = c.benchmark_group("sat build");
    group.sample_size(10);
    for (name, grid) in [
        ("constant 384^3", volumes::block([384; 3])),
        ("shell 1 mm, ball 20 mm", volumes::dimpled_ball(20.0, 1.0)),
        ("mixed 384^3", volumes::noise([384; 3])),
    ] {
        report_memory(name, &grid);
        group.throughput(Throughput::Elements(grid.frame().voxels()));
        group.bench_function(name, |b| b.iter_with_large_drop(|| CountSat::build(&grid, 5, &none)));
    }
    group.finish();
}

fn rebuild(c: &mut Criterion) {
    let none = Control::none();
    let grid = volumes::dimpled_ball(20.0, 1.0);
    let mixed: Vec<u32> = (0..grid.tiles().len() as u32)
        .filter(|&i| matches!(grid.tiles()[i as usize], Tile::Dense(_)))
        .collect();
    let mut group = c.benchmark_group("sat rebuild, ball 20 mm");
    group.sample_size(10);
    for percent in [1, 10, 100] {
        let step = 100 / percent;
        let changed: Vec<u32> = mixed.iter().copied().step_by(step).collect();
        let mut other = grid.clone();
        let d = grid.tile_dims();
        other.update_tiles(|t, tile| {
            let index = (t[2] * d[1] + t[1]) * d[0] + t[0];
            match tile {
                Tile::Dense(labels) if changed.binary_search(&index).is_ok() => {
                    Some(Tile::Dense(Box::new(labels.map(|l| if l == 1 { 2 } else { l }))))
                }
                _ => None,
            }
        });
        let mut sat = CountSat::build(&grid, 5, &none).expect("a valid grid");
        let mut turn = false;
        group.throughput(Throughput::Elements((changed.len() * TILE_VOXELS) as u64));
        group.bench_function(format!("{percent} % of the mixed tiles"), |b| {
            b.iter(|| {
                turn = !turn;
                sat.update(if turn { &other } else { &grid }, &changed, &none).expect("the same size");
            });
        });
    }
    group.finish();
}

fn dense(c: &mut Criterion) {
    let none = Control::none();
    let grid = volumes::noise([192; 3]);
    let table = MaterialTable::cmykw();
    let bytes: usize = DenseSat::of_channels(&grid, &table).iter().map(DenseSat::bytes).sum();
    println!(
        "memory, dense f64 tables of RGB: {:.1} bytes a voxel",
        bytes as f64 / grid.frame().voxels() as f64
    );
    let mut group = c.benchmark_group("sat against dense f64, mixed 192^3");
    group.sample_size(10);
    group.throughput(Throughput::Elements(grid.frame().voxels()));
    group.bench_function("counts, all channels", |b| {
        b.iter_with_large_drop(|| CountSat::build(&grid, 5, &none))
    });
    group.bench_function("dense f64, RGB", |b| {
        b.iter_batched(|| (), |()| DenseSat::of_channels(&grid, &table), BatchSize::PerIteration);
    });
    group.finish();
}

/// The memory bar: a solid object of 60 mm at full pitch.
fn large(_: &mut Criterion) {
    report_memory("ball 60 mm, skin 1 mm", &volumes::dimpled_ball(60.0, 1.0));
}

criterion_group!(benches, build, rebuild, dense, large);
criterion_main!(benches);
