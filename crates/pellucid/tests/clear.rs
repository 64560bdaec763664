//! See-through parts in clear resin: the whole job, on small models.

mod common;

use pellucid::core::Control;
use pellucid::job::ProofFiles;
use pellucid::mesh::opacity::HALF;
use pellucid::mesh::{BaseColor, Image, Model, Opacity, Sampler, Texture, Triangle, Vertex, Wrap};
use pellucid::slice::{PrintTarget, read_stack};
use pellucid::voxel::{AIR, LabelGrid};
use pellucid::{Monitor, Prepared, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

use common::quick;

fn settings() -> PrintSettings {
    PrintSettings { clear_from_alpha: true, ..quick() }
}

/// Boxes from corner to corner in mm, each of a colour with an alpha; a texture of opacities lies on their x and z.
fn boxes(boxes: &[([f64; 3], [f64; 3], [f32; 4])], opacity: Option<Image>) -> Model {
    let (mut vertices, mut triangles, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    for (low, high, factor) in boxes {
        let first = vertices.len() as u32;
        for i in 0..8 {
            let side = [i & 1, i >> 1 & 1, i >> 2];
            let mm: [f64; 3] = std::array::from_fn(|a| if side[a] == 1 { high[a] } else { low[a] });
            let uv = [side[0] as f32, side[2] as f32];
            vertices.push(Vertex { position_m: mm.map(|c| c / 1000.0), uv, color: [1.0; 4] });
        }
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let material = materials.len() as u32;
        for [a, b, c, d] in sides.map(|side| side.map(|v| v + first)) {
            triangles.extend([[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, material }));
        }
        materials.push(BaseColor {
            name: String::new(),
            factor: *factor,
            texture: None,
            double_sided: false,
        });
    }
    let clamped = Sampler { wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp, ..Sampler::default() };
    let texture = opacity.is_some().then_some(0);
    let textures = opacity.map(|image| Texture::new(image.into(), clamped)).into_iter().collect();
    let opacities = vec![Some(Opacity { texture, threshold: HALF }); materials.len()];
    Model::new("boxes", vertices, triangles, materials, textures)
        .and_then(|model| model.with_opacity(opacities))
        .unwrap()
}

const RED: [f32; 4] = [0.7, 0.1, 0.08, 1.0];
const GLASS: [f32; 4] = [0.1, 0.2, 0.9, 0.2];

/// A red cube with a clear one on its right.
fn two() -> Model {
    boxes(&[([0.0; 3], [1.2; 3], RED), ([1.2, 0.0, 0.0], [2.4, 1.2, 1.2], GLASS)], None)
}

fn prepare(settings: PrintSettings, model: &Model) -> Prepared {
    let job = PrintJob::new(settings).unwrap();
    job.prepare(model, &Workspace::none(), &Monitor::silent()).unwrap()
}

/// The voxels of a grid within a box in mm, by label.
fn within(grid: &LabelGrid, low: [f64; 3], high: [f64; 3]) -> [u64; 7] {
    let mut counts = [0; 7];
    let [nx, ny, nz] = grid.size();
    for voxel in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))) {
        let mm = grid.frame().centre_mm(voxel.map(i64::from));
        if (0..3).all(|a| (low[a]..high[a]).contains(&mm[a])) {
            counts[usize::from(grid.get(voxel))] += 1;
        }
    }
    counts
}

#[test]
fn a_clear_body_is_printed_clear_and_the_rest_as_without_it() {
    let prepared = prepare(settings(), &two());
    let clear = prepared.record.settings.materials.label_of("clear").unwrap();
    assert_eq!(clear, 6);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    let report = prepared.write_with(ProofFiles::built(), &out, false, &Monitor::silent()).unwrap();
    let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
    let [left, right] = [[0.0, 1.2], [1.2, 2.4]].map(|[a, b]| within(&back, [a, 0.0, 0.0], [b, 1.2, 1.2]));
    assert!(left[6] == 0 && left[0] == 0, "the red cube is opaque: {left:?}");
    assert!(right[1..6] == [0; 5] && right[0] == 0, "the other is clear: {right:?}");
    let found = report.clear.unwrap();
    assert_eq!((found.voxels, found.body_triangles, found.window_voxels), (right[6], 12, 0));
    assert!((found.share - 0.5).abs() < 0.02, "{found:?}");
    let material = manifest.materials.iter().find(|m| m.name == "clear").unwrap();
    assert_eq!((material.label, material.voxels), (clear, right[6]));
    assert!(report.resins.materials.iter().any(|m| m.name == "clear" && m.volume_cm3 > 0.0));
    // The refinement never saw it, and made of the red cube what it makes of that alone.
    assert_eq!(prepared.refined.labels.histogram()[6], 0);
    let alone = boxes(&[([0.0; 3], [1.2; 3], RED)], None);
    let alone = prepare(PrintSettings { clear_from_alpha: false, ..settings() }, &alone);
    assert_eq!(alone.refined.labels.histogram()[1..6], prepared.refined.labels.histogram()[1..6]);
    assert_eq!(alone.judged.evaluation, prepared.judged.evaluation);

    // The slices' own proof looks through it as well.
    let job = PrintJob::new(prepared.record.settings.clone()).unwrap();
    let proof = job.prove("print", back, manifest, &Monitor::silent()).unwrap();
    assert_eq!(proof.object.surface().len(), prepared.aimed.object.surface().len());
    let again =
        proof.write(ProofFiles::built(), &folder.path().join("look"), false, &Monitor::silent()).unwrap();
    assert_eq!(again.solid_voxels, report.solid_voxels);
}

#[test]
fn what_a_clear_body_encloses_is_printed() {
    let model = boxes(&[([0.0; 3], [2.0; 3], GLASS), ([0.5; 3], [1.5; 3], RED)], None);
    let prepared = prepare(settings(), &model);
    let printed = prepared.aimed.with_clear(&prepared.refined.labels);
    let inside = within(&printed, [0.55; 3], [1.45; 3]);
    assert!(inside[0] == 0 && inside[6] == 0, "{inside:?}");
    let all: u64 = printed.histogram()[1..].iter().sum();
    assert!(prepared.aimed.clear.as_ref().unwrap().report.share > 0.8);
    assert_eq!(all, printed.histogram()[6] + prepared.refined.labels.solid_count());
    // Its colour is that of the cube within, not of the glass around it.
    let mean = |c: usize| prepared.aimed.target.iter().map(|t| t[c]).sum::<f32>();
    assert!(mean(0) > 3.0 * mean(2));
}

#[test]
fn a_see_through_place_of_a_wall_is_a_window() {
    // A plate of 1 mm, see-through in the right half.
    let texels = (0..32 * 32).map(|i| if i % 32 < 16 { 255 } else { 0 }).collect();
    let image = Image::from_linear_grey8(32, 32, texels).unwrap();
    let model = boxes(&[([0.0; 3], [3.0, 1.0, 3.0], RED)], Some(image));
    let prepared = prepare(settings(), &model);
    let printed = prepared.aimed.with_clear(&prepared.refined.labels);
    let [left, right] = [[0.1, 1.3], [1.7, 2.6]].map(|[a, b]| within(&printed, [a, 0.0, 0.4], [b, 1.0, 2.6]));
    assert!(left[6] == 0 && left[1..].iter().sum::<u64>() > 1000, "{left:?}");
    assert!(right[6] > 1000 && right[..6] == [0; 6], "see-through from side to side: {right:?}");
    let report = prepared.aimed.clear.as_ref().unwrap().report;
    assert!(report.window_voxels > 100 && report.body_triangles == 0);
    // What the window lays open has the colour of the opaque part.
    assert!(prepared.aimed.target.iter().all(|t| t[0] > 2.0 * t[2]));
}

#[test]
fn without_the_request_all_is_opaque() {
    let plain = prepare(PrintSettings { clear_from_alpha: false, ..settings() }, &two());
    assert!(plain.aimed.clear.is_none() && plain.record.settings.materials.label_of("clear").is_none());
    let printed = plain.aimed.with_clear(&plain.refined.labels);
    assert!(*printed == plain.refined.labels);
    let right = within(&printed, [1.2, 0.0, 0.0], [2.4, 1.2, 1.2]);
    assert!(right[0] == 0 && right[1..6].iter().sum::<u64>() > 0);
    let json = serde_json::to_string(&plain.record.settings).unwrap();
    assert!(!json.contains("clear_from_alpha"), "records are as they were");
}

#[test]
fn the_same_print_for_any_number_of_threads_and_on_both_strategies() {
    let with = |strategy, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| prepare(PrintSettings { strategy, ..settings() }, &two()).refined.labels)
    };
    for strategy in [StrategyKind::SurfaceFirst, StrategyKind::Descent] {
        assert!(with(strategy, 1) == with(strategy, 2));
    }
}

#[test]
fn what_cannot_be_printed_clear_is_refused_before_any_work() {
    let refused =
        |settings: PrintSettings| PrintJob::new(settings).err().map(|e| e.to_string()).unwrap_or_default();
    let without = PrintTarget::j750();
    let palette: Vec<_> = without.palette().iter().filter(|(name, _)| *name != "clear").collect();
    let palette: Vec<(&str, [u8; 4])> =
        palette.into_iter().map(|(name, rgba)| (name.as_str(), *rgba)).collect();
    let printer = without.clone().with_palette(palette).unwrap();
    let text = refused(PrintSettings { printer, ..settings() });
    assert!(text.contains("no colour for material \"clear\"") && text.contains("add one"), "{text}");
    let printer = PrintTarget::by_name("j750-high-speed-vivid").unwrap();
    let text = refused(PrintSettings { printer, ..settings() });
    assert!(text.contains("6 are needed") && text.contains("takes 3"), "{text}");
    let text = refused(PrintSettings { strategy: StrategyKind::SurfaceColor, ..settings() });
    assert!(text.contains("clear_from_alpha") && text.contains("slices"), "{text}");

    let job = PrintJob::new(settings()).unwrap();
    let glass = boxes(&[([0.0; 3], [1.0; 3], GLASS)], None);
    let error = job.place(&glass, &Monitor::silent()).unwrap_err();
    assert!(matches!(error, PrintError::Unsupported(_)), "{error}");
    assert!(error.to_string().contains("all of it would be clear"), "{error}");
}

#[test]
fn far_below_a_window_the_body_is_white() {
    // A cube of 12 mm that is see-through from below.
    let texels = (0..64).map(|i| if i < 2 { 0 } else { 255 }).collect();
    let image = Image::from_linear_grey8(1, 64, texels).unwrap();
    let model = boxes(&[([0.0; 3], [12.0; 3], RED)], Some(image));
    let placed = PrintJob::new(settings()).unwrap().place(&model, &Monitor::silent()).unwrap();
    let frame = placed.solid.frame();
    let column = |z: f64| frame.checked(frame.voxel_at([6.0, 6.0, z])).unwrap();
    assert_eq!(placed.solid.get(column(4.9)), AIR);
    assert_eq!(placed.clear.as_ref().unwrap().grid.get(column(4.9)), 6);
    let floor = placed.surface.index_of(column(5.036)).expect("clear to a depth of 5 mm");
    assert_eq!(placed.texture[floor as usize], [1.0; 3]);
    let side = placed.surface.voxels().iter().zip(&placed.texture).find(|(v, _)| v[2] > 300).unwrap();
    assert!(side.1[0] > 3.0 * side.1[2], "{side:?}");
}
