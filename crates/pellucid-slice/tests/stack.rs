//! Export and read-back through the public API.

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use common::hashed;
use pellucid_core::staging::StagingError;
use pellucid_slice::{
    ExportSettings, Manifest, PrintTarget, Recorded, RowOrder, SliceError, check_materials, export,
    read_stack,
};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Tile};
use proptest::prelude::*;

fn write(grid: &LabelGrid, target: &PrintTarget, dir: &Path) -> Result<Manifest, SliceError> {
    let settings = ExportSettings { seed: u64::MAX, ..Default::default() };
    export(grid, &MaterialTable::cmykw(), target, &settings, dir, &Control::none())
}

/// The J750 with some properties of its profile replaced.
fn target(edits: &[(&str, serde_json::Value)]) -> PrintTarget {
    let mut json = serde_json::to_value(PrintTarget::j750()).unwrap();
    for (key, value) in edits {
        json[key] = value.clone();
    }
    PrintTarget::from_json(&json.to_string()).unwrap()
}

fn files(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path))
        } else {
            all.push((path.clone(), fs::read(path).unwrap()))
        }
    }
    all.sort();
    all
}

fn pixels(path: &Path) -> (png::Info<'static>, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut data).unwrap();
    (reader.info().clone(), data)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn reads_back_the_exact_grid(
        size in [1u32..50, 1u32..40, 1u32..40],
        seed in any::<u64>(),
        lowest in any::<bool>(),
        min_layers in 0u32..40,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let grid = hashed(size, seed, &PrintTarget::j750());
        let order = if lowest { "lowest_y_first" } else { "highest_y_first" };
        let target = target(&[("row_order", order.into()), ("min_layers", min_layers.into())]);
        let written = write(&grid, &target, &out).unwrap();
        let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
        prop_assert!(back == grid);
        prop_assert_eq!(&manifest, &written);
        prop_assert_eq!(manifest.layers, size[2].max(min_layers));
        prop_assert_eq!(files(&out.join("slices")).len(), manifest.layers as usize);
        let counts = grid.histogram();
        prop_assert!(manifest.materials.iter().all(|m| m.voxels == counts[m.label as usize] && m.voxels > 0));
        prop_assert_eq!(manifest.materials.len(), counts[1..].iter().filter(|&&n| n > 0).count());
    }

    #[test]
    fn mutated_images_give_typed_errors_or_the_same_grid(
        layer in 0usize..31,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let grid = hashed([37, 21, 31], 5, &PrintTarget::j750());
        let manifest = write(&grid, &PrintTarget::j750(), &out).unwrap();
        let path = manifest.slice_path(&out, layer as u32);
        let mut bytes = fs::read(&path).unwrap();
        for (at, value) in edits {
            let i = at.index(bytes.len());
            bytes[i] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(&path, bytes).unwrap();
        match read_stack(&out, &Control::none()) {
            Ok((back, _)) => prop_assert!(back == grid),
            Err(SliceError::Invalid(fault)) => prop_assert!(["slice_", "manifest"].iter().any(|s| fault.subject.contains(s))),
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

#[test]
fn images_are_as_seen_from_above_in_palette_colours_with_their_dpi() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let frame = Frame::new([0.0; 3], PrintTarget::j750().pitch(), [5, 3, 30]).unwrap();
    let mut grid = LabelGrid::new(frame);
    grid.set([4, 0, 2], 1); // cyan: right end of the lowest y
    grid.set([0, 2, 2], 4); // black: left end of the highest y
    let manifest = write(&grid, &PrintTarget::j750(), &out).unwrap();
    assert_eq!((manifest.layers, manifest.padding_layers), (30, 0));
    let (info, data) = pixels(&out.join("slices/slice_00002.png"));
    assert_eq!((info.width, info.height), (5, 3));
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
    let dims = info.pixel_dims.unwrap();
    assert_eq!((dims.xppu, dims.yppu, dims.unit), (23622, 11811, png::Unit::Meter));
    let pixel = |row: usize, column: usize| &data[(row * 5 + column) * 4..][..4];
    assert_eq!(pixel(2, 4), [0, 174, 239, 255]);
    assert_eq!(pixel(0, 0), [35, 31, 32, 255]);
    assert_eq!(data.chunks_exact(4).filter(|p| *p == [0; 4]).count(), 13);

    let flipped = dir.path().join("flipped");
    let lowest = target(&[("row_order", "lowest_y_first".into())]);
    let manifest = write(&grid, &lowest, &flipped).unwrap();
    assert_eq!(manifest.row_order, RowOrder::LowestYFirst);
    let (_, data) = pixels(&flipped.join("slices/slice_00002.png"));
    assert_eq!(data[16..20], [0, 174, 239, 255]);
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let grid = hashed([120, 70, 45], 9, &PrintTarget::j750());
    let mut stacks = Vec::new();
    for threads in [1, 2, 5] {
        let out = dir.path().join(format!("out{threads}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write(&grid, &PrintTarget::j750(), &out)).unwrap();
        stacks.push(files(&out).into_iter().map(|(_, bytes)| bytes).collect::<Vec<_>>());
    }
    assert!(stacks[0] == stacks[1] && stacks[0] == stacks[2]);
}

#[test]
fn cancelling_leaves_nothing_and_keeps_what_was_there() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let grid = hashed([60, 40, 64], 3, &PrintTarget::j750());
    let run = |force, stop_at: u64| {
        let stop = AtomicBool::new(false);
        let progress = |done: u64, total: u64| {
            assert_eq!(total, 64);
            stop.store(done >= stop_at, Ordering::Relaxed);
        };
        let control = Control::none().with_progress(&progress).with_cancel(&stop);
        let settings = ExportSettings { force, seed: stop_at, ..Default::default() };
        export(&grid, &MaterialTable::cmykw(), &PrintTarget::j750(), &settings, &out, &control)
    };
    assert!(matches!(run(false, 8), Err(SliceError::Cancelled)));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    run(false, u64::MAX).unwrap();
    assert!(matches!(run(false, u64::MAX), Err(SliceError::Output(StagingError::Exists { .. }))));
    assert!(matches!(run(true, 8), Err(SliceError::Cancelled)));
    assert_eq!(Manifest::load(&out).unwrap().seed, u64::MAX);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    run(true, 1000).unwrap();
    assert_eq!(Manifest::load(&out).unwrap().seed, 1000);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);

    let stop = AtomicBool::new(true);
    assert!(matches!(read_stack(&out, &Control::none().with_cancel(&stop)), Err(SliceError::Cancelled)));
}

#[test]
fn what_the_printer_cannot_do_is_refused_with_a_remedy() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let grid = hashed([40, 40, 40], 3, &PrintTarget::j750());
    let refused = |grid: &LabelGrid, target: &PrintTarget, words: &[&str]| {
        let error = write(grid, target, &out).unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    };
    let j750 = PrintTarget::j750();
    refused(
        &grid,
        &target(&[("build_space_mm", serde_json::json!([490.0, 390.0, 1.0]))]),
        &["490 x 390 x 1 mm", "scale"],
    );
    refused(&grid, &target(&[("max_materials", 4.into())]), &["5 are needed", "cyan", "fewer"]);
    let no_white = serde_json::json!({"cyan": [0, 0, 9, 255], "magenta": [1, 0, 0, 255], "yellow": [2, 0, 0, 255],
        "black": [3, 0, 0, 255]});
    refused(&grid, &target(&[("palette", no_white)]), &["white", "palette", "add"]);
    let mut stray = grid.clone();
    stray.set([1, 2, 3], 77);
    refused(&stray, &j750, &["label 77", "ends at 5"]);
    let coarse = Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [4, 4, 4]).unwrap();
    refused(&LabelGrid::new(coarse), &j750, &["pitch", "voxelise"]);
}

#[test]
fn materials_that_may_be_used_are_checked_before_any_work() {
    let table = MaterialTable::cmykw();
    // Before the halftone all is white, and every printer holds that.
    let white =
        LabelGrid::from_tiles(*hashed([9, 9, 9], 1, &PrintTarget::j750()).frame(), |_| Tile::Constant(5));
    let three = PrintTarget::j750().with_max_materials(3).unwrap();
    assert!(pellucid_slice::check(&white, &table, &three, &ExportSettings::default()).is_ok());
    let error = check_materials(&three, &table, 1..=5).unwrap_err();
    assert!(matches!(error, SliceError::Unsupported(_)));
    let error = error.to_string();
    assert!(
        error.contains("5 are needed (cyan, magenta, yellow, black, white)") && error.contains("takes 3"),
        "{error}"
    );
    assert!(check_materials(&three, &table, [0, 5, 4, 5, 1, 4]).is_ok());

    let palette = PrintTarget::j750().palette().clone().into_iter().filter(|(name, _)| name != "cyan");
    let no_cyan = PrintTarget::j750().with_palette(palette).unwrap();
    let error = check_materials(&no_cyan, &table, 1..=5).unwrap_err();
    assert!(matches!(&error, SliceError::Invalid(fault) if fault.reason.contains("\"cyan\"")), "{error}");
    assert!(check_materials(&no_cyan, &table, 2..=5).is_ok());
    assert!(matches!(check_materials(&no_cyan, &table, [6]), Err(SliceError::Invalid(_))));
}

#[test]
fn files_of_the_user_in_the_output_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let grid = hashed([9, 9, 9], 1, &PrintTarget::j750());
    write(&grid, &PrintTarget::j750(), &out).unwrap();
    fs::write(out.join("model.glb"), "the input").unwrap();
    let settings = ExportSettings { force: true, ..Default::default() };
    let run =
        || export(&grid, &MaterialTable::cmykw(), &PrintTarget::j750(), &settings, &out, &Control::none());
    let error = run().unwrap_err();
    assert!(matches!(&error, SliceError::Output(StagingError::Foreign { .. })), "{error}");
    assert!(error.to_string().contains("model.glb"), "{error}");
    assert_eq!(fs::read(out.join("model.glb")).unwrap(), b"the input");
    fs::remove_file(out.join("model.glb")).unwrap();
    assert!(run().is_ok());
}

#[test]
fn all_settings_of_another_program_come_back() {
    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    struct Job {
        spp: u32,
        scale: f64,
        weights: Option<String>,
        stages: Vec<(String, f32)>,
        target: PrintTarget,
    }
    let job = Job {
        spp: 16,
        scale: 1.0 / 3.0,
        weights: None,
        stages: vec![("refine".into(), 0.1)],
        target: PrintTarget::j750(),
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let settings = ExportSettings { settings: Recorded::of(&job).unwrap(), ..Default::default() };
    export(
        &hashed([9, 5, 3], 1, &PrintTarget::j750()),
        &MaterialTable::cmykw(),
        &PrintTarget::j750(),
        &settings,
        &out,
        &Control::none(),
    )
    .unwrap();
    let manifest = Manifest::load(&out).unwrap();
    assert_eq!(manifest.settings.read::<Job>().unwrap(), job);
    assert_eq!(manifest.pitch_mm[2], 0.027);
}

#[test]
fn corrupted_stacks_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let fresh = |name: &str| {
        let out = dir.path().join(name);
        write(&hashed([40, 20, 10], 3, &PrintTarget::j750()), &PrintTarget::j750(), &out).unwrap();
        out
    };
    let message = |out: &Path| read_stack(out, &Control::none()).unwrap_err().to_string();
    let edit = |out: &Path, key: &str, value: serde_json::Value| {
        let path = out.join("manifest.json");
        let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        *json.pointer_mut(key).unwrap() = value;
        fs::write(path, json.to_string()).unwrap();
    };

    let out = fresh("missing");
    fs::remove_file(out.join("slices/slice_00004.png")).unwrap();
    assert!(
        matches!(read_stack(&out, &Control::none()), Err(SliceError::Io(pellucid_core::FileError { path, .. })) if path.ends_with("slice_00004.png"))
    );
    assert!(matches!(read_stack(dir.path(), &Control::none()), Err(SliceError::Io { .. })));

    let out = fresh("swapped");
    fs::copy(out.join("slices/slice_00003.png"), out.join("slices/slice_00012.png")).unwrap();
    assert!(message(&out).contains("above the object"));
    fs::copy(out.join("slices/slice_00029.png"), out.join("slices/slice_00012.png")).unwrap();
    fs::copy(out.join("slices/slice_00029.png"), out.join("slices/slice_00003.png")).unwrap();
    assert!(message(&out).contains("export again"));

    let cases = [
        ("/size/0", serde_json::json!(41), "slice_"),
        ("/size/0", serde_json::json!(1 << 20), "cannot be an image"),
        ("/size/1", serde_json::json!(0), "empty axis"),
        ("/layers", serde_json::json!(31), "padding_layers"),
        ("/layers", serde_json::json!("30"), "manifest, layers: found text \"30\" where a whole number"),
        ("/materials/0/rgba/3", serde_json::json!(-1), "manifest, materials[0].rgba[3]: found the number -1"),
        ("/files", serde_json::json!("../../secret_%05d.png"), "files"),
        ("/format", serde_json::json!("other"), "format"),
        ("/format_version", serde_json::json!(2), "format_version"),
        ("/pitch_mm/2", serde_json::json!(0.0), "pitch"),
        ("/materials/1/rgba", serde_json::json!([0, 174, 239, 255]), "colour in use"),
        ("/materials/1/rgba", serde_json::json!([9, 9, 9, 255]), "no material's colour"),
        ("/materials/1/label", serde_json::json!(0), "ascend"),
        ("/materials/1/voxels", serde_json::json!(u64::MAX), "more voxels"),
    ];
    for (key, value, word) in cases {
        let out = fresh(&format!("edit{}{value}", key.replace('/', "-")).replace(['/', '"', '.', ' '], ""));
        edit(&out, key, value);
        let text = message(&out);
        assert!(text.contains(word), "{key}: {text}");
    }

    let out = fresh("gray");
    let file = fs::File::create(out.join("slices/slice_00001.png")).unwrap();
    let mut encoder = png::Encoder::new(file, 40, 20);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[7; 800]).unwrap();
    assert!(message(&out).contains("must be Rgba with 8 bits"));
}
