//! The path tracer: paths a second by instruction set, preparation of a volume, assisted radiance.
//!
//! `cargo bench -p pellucid-benches --bench tracer`. The study of error against run time is the benchmark
//! `tracer_error`; Mitsuba's figures come from `benches/peers/mitsuba_cube.py`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use pellucid_benches::volumes;
use pellucid_trace::{
    AdjointOptions, AssistOptions, Boundary, Derivatives, InstructionSet, TraceOptions, Tracer, Volume,
};
use pellucid_voxel::{Control, LabelGrid, Material, MaterialTable, Surface, SurfaceOptions};

fn prepared(grid: &LabelGrid) -> (Surface, Volume) {
    let none = Control::none();
    let surface = Surface::extract(grid, &SurfaceOptions::default(), &none).expect("a surface");
    let volume = Volume::new(grid, &surface, &none).expect("a volume");
    (surface, volume)
}

/// The 10 mm white cube, blue, index-matched: 331 scatterings a path.
fn white_cube(c: &mut Criterion) {
    let none = Control::none();
    let grid = volumes::block([236, 118, 370]);
    let (surface, volume) = prepared(&grid);
    let top = surface.index_of([118, 59, 369]).expect("a surface voxel");
    let cmykw = MaterialTable::cmykw();
    let blue = cmykw.materials().iter().map(|m| Material {
        sigma_s: vec![m.sigma_s[2]],
        sigma_a: vec![m.sigma_a[2]],
        ..m.clone()
    });
    let table = MaterialTable::new(vec!["B".into()], blue.collect()).expect("valid materials");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let mut group = c.benchmark_group("white cube, one thread");
    group.sample_size(10);
    for set in InstructionSet::available() {
        let spp = if set == InstructionSet::Portable { 1 << 11 } else { 1 << 15 };
        let options = TraceOptions {
            spp,
            boundary: Boundary::Matched,
            instruction_set: Some(set),
            ..TraceOptions::default()
        };
        let tracer = Tracer::new(&volume, &table, options).expect("valid options");
        // The tracer has no form of its own for bf16.
        if tracer.instruction_set() != set {
            continue;
        }
        group.throughput(Throughput::Elements(u64::from(spp)));
        group.bench_function(BenchmarkId::from_parameter(set.name()), |b| {
            b.iter(|| pool.install(|| tracer.radiance(&[top], 0, &mut [0.0], &none)).expect("traced"));
        });
    }
    group.finish();
}

/// Takes the derivatives of a skin of some 1 mm.
struct Skin {
    center: [f64; 3],
    sum: f64,
}

impl Derivatives for Skin {
    fn add(&mut self, _: [u32; 3], _: u8, derivative: f32) {
        self.sum += f64::from(derivative);
    }

    fn wants(&self, first: [u32; 3], _: [u32; 3]) -> bool {
        // In units of the radius: the ball touches its grid.
        let square = |a: usize| (f64::from(first[a] + 2) / self.center[a] - 1.0).powi(2);
        (0..3).map(square).sum::<f64>() > 0.9f64.powi(2)
    }
}

/// A 20 mm ball with a halftone skin of 1 mm, dielectric: what refinement traces.
fn skin(c: &mut Criterion) {
    let none = Control::none();
    let grid = volumes::dimpled_ball(20.0, 1.0);
    let (surface, mut volume) = prepared(&grid);
    let table = MaterialTable::cmykw();
    // Contiguous points, as refinement has.
    let points: Vec<u32> = (0..8192).map(|i| surface.len() as u32 / 3 + i).collect();
    let mut out = vec![0.0; points.len() * 3];
    let mut group = c.benchmark_group("20 mm ball, all threads");
    group.sample_size(10);
    group.bench_function("new volume", |b| {
        b.iter(|| Volume::new(&grid, &surface, &none).expect("a volume"));
    });
    group.bench_function("new labels", |b| {
        b.iter(|| volume.set_labels(&grid, &none).expect("the same shape"));
    });
    let options = TraceOptions { spp: 16, ..TraceOptions::default() };
    let tracer = Tracer::new(&volume, &table, options).expect("valid options");
    group.throughput(Throughput::Elements(points.len() as u64 * 3));
    group.bench_function("16 paths a value", |b| {
        b.iter(|| tracer.radiance(&points, 0, &mut out, &none).expect("traced"));
    });
    group.bench_function("16 paths a value, assisted", |b| {
        let assist = AssistOptions::default();
        b.iter(|| tracer.radiance_assisted(&points, 0, &assist, &mut out, &none).expect("traced"));
    });
    let tracer = Tracer::new(&volume, &table, TraceOptions { spp: 2, ..options }).expect("valid options");
    group.bench_function("2 paths a value", |b| {
        b.iter(|| tracer.radiance(&points, 0, &mut out, &none).expect("traced"));
    });
    let weights = vec![1.0; out.len()];
    let mut skin = Skin { center: grid.size().map(|s| f64::from(s) / 2.0), sum: 0.0 };
    group.bench_function("2 paths a value, derivative", |b| {
        let adjoint = AdjointOptions::default();
        b.iter(|| tracer.pullback(&points, 0, &weights, &adjoint, &mut skin, &none).expect("traced"));
    });
    group.finish();
}

criterion_group!(benches, white_cube, skin);
criterion_main!(benches);
