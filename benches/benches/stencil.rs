//! Stencil extraction: points a second on near-surface points of a real-sized object.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use pellucid_benches::volumes;
use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils};
use pellucid_voxel::{Control, CountSat, MaterialTable};

const POINTS: usize = 30_000;

fn extraction(c: &mut Criterion) {
    let table = MaterialTable::cmykw();
    let spec = StencilSpec::paper();
    let none = Control::none();
    let mut group = c.benchmark_group("stencil");
    group.sample_size(10);
    for diameter in [20.0, 60.0] {
        let grid = volumes::dimpled_ball(diameter, 1.0);
        let sat = CountSat::build(&grid, table.len(), &none).expect("a valid grid");
        let points = volumes::surface_points(&grid, POINTS);
        let stencils = Stencils::new(spec, &grid, &sat).expect("same size");
        let rgb = Coefficients::all(&table, Features::ScatterAbsorb).expect("channels");
        let mut out = vec![0.0; points.len() * rgb.values_per_point(&spec)];
        group.throughput(Throughput::Elements(points.len() as u64));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let id = BenchmarkId::new(format!("rgb {diameter} mm"), format!("{threads} threads"));
            group.bench_function(id, |b| {
                b.iter(|| pool.install(|| stencils.extract(&rgb, &points, &mut out, &none)).expect("valid"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, extraction);
criterion_main!(benches);
