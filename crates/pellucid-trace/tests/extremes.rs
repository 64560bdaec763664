//! Volumes at the edge of what a tracer stands.

mod common;

use common::{Object, dielectric, hash, matched, table};
use pellucid_trace::{AnalyticScene, Medium, Optics, Shape, TraceError, TraceOptions, Tracer, Volume};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, Tile, VoxelError,
};

#[test]
fn extinctions_from_nothing_to_1e5_side_by_side() {
    let object = Object::new(Pitch::j750(), [60, 30, 90], |v| 1 + (hash(v.map(|x| x / 4)) % 5) as u8);
    let rows = [(0.0, 0.0, 0.4), (1e5, 0.0, 0.99), (0.0, 1e5, -0.99), (1e-4, 1e-6, 0.0), (9.0, 0.01, 0.4)];
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(97).collect();
    for options in [matched(64), dielectric(64)] {
        let l = object.radiance(&table(&rows), options, &points);
        assert!(l.iter().all(|&(l, e)| (0.0..=1.0).contains(&l) && e.is_finite()));
        // Both over the absorber and over the scatterer some light comes back.
        assert!(l.iter().any(|&(l, _)| l > 0.3) && l.iter().any(|&(l, _)| l < 0.1));
    }
}

#[test]
fn dense_isotropic_scatterer_is_a_half_space() {
    // 1e5 per mm is 8,500 mean free paths a voxel; albedo 0.98, index-matched.
    let object = Object::new(Pitch::j750(), [20, 10, 20], |_| 1);
    let t = table(&[(0.98e5, 0.02e5, 0.0)]);
    let (l, e) = object.radiance(&t, matched(60_000), &[object.top()])[0];
    assert!((l - 0.671_083_743).abs() < 3.5 * e, "{l} +- {e}");
}

#[test]
fn albedo_zero_and_clear_objects() {
    let object = Object::new(Pitch::j750(), [60, 30, 90], |_| 1);
    let top = [object.top()];
    let (black, _) = object.radiance(&table(&[(0.0, 50.0, 0.0)]), matched(4096), &top)[0];
    assert_eq!(black, 0.0);
    for options in [matched(4096), dielectric(4096)] {
        assert_eq!(object.radiance(&table(&[(0.0, 0.0, 0.0)]), options, &top)[0], (1.0, 0.0));
    }
}

#[test]
fn white_60_mm_solid() {
    let frame = Frame::new([0.0; 3], Pitch::new([0.2; 3]).unwrap(), [300; 3]).unwrap();
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
    let s = grid.size();
    let control = Control::none();
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
    let top = surface.index_of([s[0] / 2, s[1] / 2, s[2] - 1]).unwrap();
    let volume = Volume::new(&grid, &surface, &control).unwrap();
    let materials = MaterialTable::cmykw();
    let tracer = Tracer::new(&volume, &materials, matched(20_000)).unwrap();
    let (mut l, mut e) = ([0.0; 3], [0.0; 3]);
    tracer.radiance_with_error(&[top], 0, &mut l, &mut e, &control).unwrap();
    for c in 0..3 {
        let optics = Optics {
            sigma_s: f64::from(materials.materials()[4].sigma_s[c]),
            sigma_a: f64::from(materials.materials()[4].sigma_a[c]),
            g: 0.4,
        };
        let shape = Shape::Box { min_mm: [-30.0, -30.0, -60.0], max_mm: [30.0, 30.0, 0.0] };
        let scene = AnalyticScene::new(shape, Medium::Homogeneous(0), vec![optics]).unwrap();
        let exact = scene.radiance([0.0; 3], [0.0, 0.0, 1.0], &matched(20_000), &control).unwrap();
        let z = (f64::from(l[c]) - exact.value) / f64::from(e[c]).hypot(exact.std_error);
        assert!(z.abs() < 3.5, "channel {c}: {} for {}, z = {z:.2}", l[c], exact.value);
    }
}

#[test]
fn one_voxel_objects_and_thin_voxels() {
    for pitch in [Pitch::j750(), Pitch::new([1.0, 0.01, 0.5]).unwrap(), Pitch::new([0.01, 1.0, 1.0]).unwrap()]
    {
        let object = Object::new(pitch, [3, 3, 3], |v| u8::from(v == [1, 1, 1]));
        assert_eq!(object.surface.len(), 1);
        for options in [matched(4096), dielectric(4096)] {
            assert_eq!(object.radiance(&table(&[(5.0, 0.0, 0.4)]), options, &[0])[0].0, 1.0);
            let (l, _) = object.radiance(&table(&[(5.0, 5.0, 0.4)]), options, &[0])[0];
            assert!(l > 0.0 && l < 1.0);
        }
        let solid = Object::new(pitch, [40, 40, 40], |_| 1);
        let points: Vec<u32> = (0..solid.surface.len() as u32).step_by(97).collect();
        let l = solid.radiance(&table(&[(5.0, 0.0, 0.4)]), dielectric(16), &points);
        assert!(l.iter().all(|v| v.0 == 1.0));
    }
}

#[test]
fn bad_input_is_refused_by_name() {
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let material = Material { name: "mud".into(), sigma_s: vec![bad], sigma_a: vec![0.0], g: 0.0.into() };
        let error = MaterialTable::new(vec!["x".into()], vec![material]).unwrap_err();
        assert!(matches!(&error, VoxelError::Invalid(fault) if fault.subject.contains("mud")), "{error}");
    }
    let object = Object::new(Pitch::j750(), [20, 10, 20], |v| 1 + (v[0] % 3) as u8);
    let two = table(&[(1.0, 1.0, 0.0), (1.0, 1.0, 0.0)]);
    let error = Tracer::new(&object.volume, &two, matched(1)).err().unwrap();
    assert!(error.to_string().contains("label 3"), "{error}");
    let three = table(&[(1.0, 1.0, 0.0); 3]);
    for options in [
        TraceOptions { spp: 0, ..TraceOptions::default() },
        TraceOptions { roulette: f32::NAN, ..TraceOptions::default() },
    ] {
        assert!(matches!(Tracer::new(&object.volume, &three, options), Err(TraceError::Invalid { .. })));
    }
    let tracer = Tracer::new(&object.volume, &three, matched(1)).unwrap();
    let control = Control::none();
    let past = object.surface.len() as u32;
    assert!(tracer.radiance(&[past], 0, &mut [0.0], &control).is_err());
    assert!(tracer.radiance(&[0], 0, &mut [0.0; 2], &control).is_err());
    let sixteen = Object::new(Pitch::j750(), [16, 16, 16], |v| 1 + (v[0] % 15) as u8);
    let mut grid = sixteen.grid.clone();
    grid.set([0, 0, 0], 16);
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
    assert!(matches!(Volume::new(&grid, &surface, &control), Err(TraceError::Unsupported { .. })));
}

#[test]
fn cancelling_stops_and_says_so() {
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    let object = Object::new(Pitch::j750(), [20, 10, 20], |_| 1);
    let t = table(&[(1.0, 1.0, 0.0)]);
    let tracer = Tracer::new(&object.volume, &t, matched(1 << 20)).unwrap();
    assert!(matches!(tracer.radiance(&[0], 0, &mut [0.0], &control), Err(TraceError::Cancelled)));
    assert!(matches!(Volume::new(&object.grid, &object.surface, &control), Err(TraceError::Cancelled)));
}

#[test]
fn new_labels_give_what_a_new_volume_gives() {
    let mut object = Object::new(Pitch::j750(), [50, 30, 60], |v| 1 + (hash(v) % 5) as u8);
    let mut grid = object.grid.clone();
    for i in 0..3000u32 {
        let s = grid.size();
        grid.set([i * 7 % s[0], i * 11 % s[1], i * 17 % s[2]], 5);
    }
    object.volume.set_labels(&grid, &Control::none()).unwrap();
    let fresh = Object::of(grid.clone());
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(41).collect();
    let materials = MaterialTable::cmykw();
    let a = object.radiance(&materials, dielectric(64), &points);
    assert_eq!(a, fresh.radiance(&materials, dielectric(64), &points));
    // A changed shape is refused, even by one voxel, and leaves the volume as it was.
    for v in [[25, 15, 30], [0, 0, 0], [49, 15, 30]] {
        let mut holed = grid.clone();
        holed.set(v, 0);
        assert!(object.volume.set_labels(&holed, &Control::none()).is_err(), "{v:?}");
    }
    assert_eq!(a, object.radiance(&materials, dielectric(64), &points));
}

#[test]
fn a_stale_surface_is_refused() {
    let object = Object::new(Pitch::j750(), [40, 24, 50], |_| 3);
    let stale = |change: &dyn Fn(&mut LabelGrid)| {
        let mut grid = object.grid.clone();
        change(&mut grid);
        let error = Volume::new(&grid, &object.surface, &Control::none()).err().expect("a stale surface");
        assert!(matches!(error, TraceError::Invalid { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("surface") && text.contains("extract"), "{text}");
        text
    };
    // A hole inside makes walls without normals: the lowest of them is named.
    assert!(stale(&|grid| grid.set([20, 12, 25], 0)).contains("[20, 12, 24]"));
    // So does one across tiles and bricks, and one at the surface, which the list still names.
    assert!(stale(&|grid| grid.set([15, 15, 15], 0)).contains("[15, 15, 14]"));
    assert!(stale(&|grid| grid.set([39, 12, 25], 0)).contains("[39, 12, 25]"));
    // A filled hole leaves walls in the list that are inside now.
    let mut holed = object.grid.clone();
    holed.set([20, 12, 25], 0);
    let surface = Surface::extract(&holed, &SurfaceOptions::default(), &Control::none()).unwrap();
    assert!(Volume::new(&holed, &surface, &Control::none()).is_ok());
    let error = Volume::new(&object.grid, &surface, &Control::none()).err().unwrap().to_string();
    assert!(error.contains("[20, 12, 24]") && error.contains("extract"), "{error}");
}

#[test]
fn a_section_looks_as_it_does_in_the_whole() {
    // Stripes of five materials, 8 mm high; 2 mm are listed, with 2 mm beyond on either side.
    let object = Object::new(Pitch::j750(), [50, 26, 304], |v| 1 + (v[2] / 9 + v[0] / 11) as u8 % 5);
    let control = Control::none();
    let (z, listed) = (48..272, 124..198);
    let section = object.grid.section(z.clone()).unwrap();
    let surface = object.surface.section(z.clone(), listed.clone()).unwrap();
    let volume = Volume::new(&section, &surface, &control).unwrap();
    let materials = MaterialTable::cmykw();
    let points: Vec<u32> = (0..surface.len() as u32).step_by(149).collect();
    let before = object.surface.points_in(listed).start;
    let in_whole: Vec<u32> = points.iter().map(|p| p + before).collect();
    for options in [matched(512), dielectric(512)] {
        let whole = object.radiance(&materials, options, &in_whole);
        let tracer = Tracer::new(&volume, &materials, options).unwrap();
        let [mut l, mut e] = [0; 2].map(|_| vec![0.0; 3 * points.len()]);
        tracer.radiance_with_error(&points, 7, &mut l, &mut e, &control).unwrap();
        let (mut sum, mut variance) = (0.0, 0.0);
        for ((l, e), (whole, its)) in l.iter().zip(&e).zip(&whole) {
            let (l, error) = (f64::from(*l), f64::from(*e).hypot(*its));
            sum += l - whole;
            variance += error * error;
            assert!((l - whole).abs() < 5.0 * error, "{l} {whole} +- {error}");
        }
        // Of all together three standard errors, some 0.2 % of the radiance.
        assert!(sum.abs() < 3.0 * f64::sqrt(variance), "{sum} +- {}", f64::sqrt(variance));
    }
    // A hole among the listed layers is not overlooked.
    let mut holed = section.clone();
    holed.set([20, 12, 120], 0);
    assert!(Volume::new(&holed, &surface, &control).is_err());
}
