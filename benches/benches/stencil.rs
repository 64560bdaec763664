//! Stencil extraction: points a second on near-surface points of a real-sized object.
//!
//! `cargo bench -p pellucid-benches --bench stencil`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use pellucid_benches::dense::{self, DenseSat};
use pellucid_benches::volumes;
use pellucid_stencil::{
    Coefficients, Features, FirstFlight, FirstFlights, StencilSpec, Stencils, near_order,
};
use pellucid_voxel::{Control, CountSat, MaterialTable, Surface, SurfaceOptions};
use rayon::prelude::*;

const POINTS: usize = 32_768;
/// Points a call: what a predictor extracts before it runs its network.
const CALL: usize = 8192;

fn extraction(c: &mut Criterion) {
    let table = MaterialTable::cmykw();
    let spec = StencilSpec::paper();
    let none = Control::none();
    let rgb = Coefficients::all(&table, Features::ScatterAbsorb).expect("channels");
    let mut group = c.benchmark_group("stencil");
    group.sample_size(10);
    for diameter in [20.0, 60.0] {
        let grid = volumes::dimpled_ball(diameter, 1.0);
        let sat = CountSat::build(&grid, table.len(), &none).expect("a valid grid");
        let points = volumes::surface_points(&grid, POINTS);
        let points: Vec<_> = near_order(&points).into_iter().map(|i| points[i as usize]).collect();
        let stencils = Stencils::new(spec, &grid, &sat).expect("same size");
        let mut out = vec![0.0; CALL * rgb.values_per_point(&spec)];
        group.throughput(Throughput::Elements(points.len() as u64));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let id = BenchmarkId::new(format!("rgb {diameter} mm"), format!("{threads} threads"));
            group.bench_function(id, |b| {
                b.iter(|| {
                    for points in points.chunks(CALL) {
                        let out = &mut out[..points.len() * rgb.values_per_point(&spec)];
                        pool.install(|| stencils.extract(&rgb, points, out, &none)).expect("valid");
                    }
                });
            });
        }
    }
    group.finish();
}

fn first_flights(c: &mut Criterion) {
    let table = MaterialTable::cmykw();
    let none = Control::none();
    let grid = volumes::dimpled_ball(20.0, 1.0);
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &none).expect("a valid grid");
    let flights = FirstFlights::new(&table, &grid, &surface, 1.5).expect("labels of the table");
    let points: Vec<u32> = near_order(surface.voxels()).into_iter().take(POINTS).collect();
    let mut out = vec![FirstFlight::default(); points.len() * 3];
    let mut group = c.benchmark_group("first flight");
    group.sample_size(10);
    group.throughput(Throughput::Elements(out.len() as u64));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    group.bench_function("rgb, a point and channel, 1 thread", |b| {
        b.iter(|| pool.install(|| flights.extract(&points, &mut out, &none)).expect("valid"));
    });
    group.finish();
}

fn against_dense(c: &mut Criterion) {
    let table = MaterialTable::cmykw();
    let spec = StencilSpec::paper();
    let none = Control::none();
    let rgb = Coefficients::all(&table, Features::ScatterAbsorb).expect("channels");
    let grid = volumes::dimpled_ball(10.0, 1.0);
    let points = volumes::surface_points(&grid, 4096);
    let row = rgb.values_per_point(&spec);
    let mut out = vec![0.0; points.len() * row];
    let mut group = c.benchmark_group("stencil against dense f64, ball 10 mm");
    group.sample_size(10);
    group.throughput(Throughput::Elements(points.len() as u64));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
    let sat = CountSat::build(&grid, table.len(), &none).expect("a valid grid");
    let stencils = Stencils::new(spec, &grid, &sat).expect("same size");
    group.bench_function("counts, rgb, 2 threads", |b| {
        b.iter(|| pool.install(|| stencils.extract(&rgb, &points, &mut out, &none)).expect("valid"));
    });
    let tables = DenseSat::of_channels(&grid, &table);
    group.bench_function("dense f64, rgb, 2 threads", |b| {
        b.iter(|| {
            pool.install(|| {
                out.par_chunks_exact_mut(row)
                    .zip(&points)
                    .for_each(|(out, point)| dense::stencil(&tables, *point, out));
            });
        });
    });
    group.finish();
}

criterion_group!(benches, first_flights, against_dense, extraction);
criterion_main!(benches);
