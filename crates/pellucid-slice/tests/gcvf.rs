//! GCVFs: they come back exactly, hold what the printer's software shows, and hostile ones cost little.
#![cfg(feature = "gcvf")]

mod common;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use common::hashed;
use pellucid_slice::container::gcvf::{self, Config};
use pellucid_slice::{
    Container, ExportSettings, Manifest, PrintTarget, RowOrder, SliceError, export, read_stack,
};
use pellucid_voxel::{AIR, Control, Frame, LabelGrid, MaterialTable, Pitch};
use proptest::prelude::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Files of an archive by name.
type Entries = BTreeMap<String, Vec<u8>>;

fn vivid() -> PrintTarget {
    PrintTarget::by_name("j750-high-quality-vivid").unwrap()
}

fn write(grid: &LabelGrid, target: &PrintTarget, format: Container, dir: &Path) -> Manifest {
    let settings = ExportSettings { format, seed: 5, ..Default::default() };
    export(grid, &MaterialTable::cmykw(), target, &settings, dir, &Control::none()).unwrap()
}

/// Entries of an archive by name.
fn entries(path: &Path) -> Entries {
    let mut archive = ZipArchive::new(File::open(path).unwrap()).unwrap();
    (0..archive.len())
        .map(|i| {
            let mut entry = archive.by_index(i).unwrap();
            let mut bytes = Vec::new();
            entry.read_to_end(&mut bytes).unwrap();
            (entry.name().unwrap().into_owned(), bytes)
        })
        .collect()
}

/// An archive of entries, deflated.
fn pack(path: &Path, entries: &Entries) {
    let mut zip = ZipWriter::new(File::create(path).unwrap());
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    for (name, bytes) in entries {
        zip.start_file(name.as_str(), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
}

fn dense(grid: &LabelGrid) -> Vec<u8> {
    let mut labels = vec![9; grid.frame().voxels() as usize];
    grid.to_dense(&mut labels).unwrap();
    labels
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn archives_come_back_exactly(
        size in [1u32..50, 1u32..40, 1u32..40],
        seed in any::<u64>(),
        lowest in any::<bool>(),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let order = if lowest { RowOrder::LowestYFirst } else { RowOrder::HighestYFirst };
        let target = vivid().with_row_order(order);
        let grid = hashed(size, seed, &target);
        let written = write(&grid, &target, Container::Gcvf, &out);
        let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
        prop_assert!(back == grid);
        prop_assert_eq!(&manifest, &written);
        prop_assert_eq!((manifest.layers, manifest.background), (size[2].max(30), [0, 0, 0, 255]));
        prop_assert!(manifest.materials.iter().all(|m| m.resin.as_ref().unwrap().starts_with('V')));

        // The archive alone has the padding, numbers its materials by their order, and does not say which way is up.
        let (alone, config) = gcvf::read(out.join("slices.gcvf"), &Control::none()).unwrap();
        prop_assert_eq!(alone.frame().pitch(), target.pitch());
        let names = config.materials.iter().map(|m| (m.name.clone(), m.rgba, m.voxels));
        prop_assert!(names.eq(manifest.materials.iter().map(|m| (m.resin.clone().unwrap(), m.rgba, m.voxels))));
        prop_assert_eq!((config.slices, config.max_colors), (manifest.layers, 6));
        if !lowest {
            let labels: Vec<u8> = std::iter::once(AIR).chain(manifest.materials.iter().map(|m| m.label)).collect();
            let mut padded = dense(&grid);
            padded.resize(alone.frame().voxels() as usize, AIR);
            let own: Vec<u8> = dense(&alone).iter().map(|&l| labels[usize::from(l)]).collect();
            prop_assert!(own == padded);
        }
    }

    #[test]
    fn damaged_archives_give_typed_errors(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        directory in any::<bool>(),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let grid = hashed([37, 21, 31], 5, &vivid());
        write(&grid, &vivid(), Container::Gcvf, &out);
        let path = out.join("slices.gcvf");
        let mut bytes = fs::read(&path).unwrap();
        for (at, value) in edits {
            // The directory at the end, or anywhere.
            let from = if directory { bytes.len() - 2500 } else { 0 };
            let i = from + at.index(bytes.len() - from);
            bytes[i] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(&path, bytes).unwrap();
        match read_stack(&out, &Control::none()) {
            Ok((back, _)) => prop_assert!(back == grid),
            Err(SliceError::Invalid(fault) | SliceError::Unsupported(fault)) => {
                prop_assert!(fault.to_string().contains("slices.gcvf"), "{}", fault)
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

#[test]
fn the_archive_holds_the_png_stack_and_what_describes_it() {
    let dir = tempfile::tempdir().unwrap();
    let (out, pngs) = (dir.path().join("out"), dir.path().join("pngs"));
    let target = vivid().with_background([0, 0, 0, 255]).unwrap();
    let grid = hashed([40, 20, 35], 3, &target);
    write(&grid, &target, Container::Gcvf, &out);
    write(&grid, &target, Container::Png, &pngs);
    let mut found = entries(&out.join("slices.gcvf"));
    for layer in 0..35 {
        let png = found.remove(&format!("layer_{layer}.png")).unwrap();
        assert!(png == fs::read(pngs.join(format!("slices/slice_{layer:05}.png"))).unwrap(), "{layer}");
    }
    let names: Vec<_> = found.keys().map(String::as_str).collect();
    assert_eq!(names, ["ConfigFile.xml", "Mesh.stl", "MeshBbx.ktn", "Zbuffer.png"]);
    let xml = String::from_utf8(found["ConfigFile.xml"].clone()).unwrap();
    for part in [
        "<XDpi>600</XDpi>",
        "<YDpi>300</YDpi>",
        "<SliceThicknessNanoMeter>14000</SliceThicknessNanoMeter>",
        "<SliceWidth>40</SliceWidth>",
        "<NumberOfSlices>35</NumberOfSlices>",
        "<Name>VUltraWhite</Name>\n      <RGBA>240 240 240 255</RGBA>",
        "<BackGroundMaterialRGBA>0 0 0 255</BackGroundMaterialRGBA>",
    ] {
        assert!(xml.contains(part), "{part}: {xml}");
    }
    // No time of day, and the profile without resins names its materials itself.
    let archive = ZipArchive::new(File::open(out.join("slices.gcvf")).unwrap()).unwrap();
    assert_eq!(archive.comment(), b"");
    let plain = dir.path().join("plain");
    let j750 = PrintTarget::j750();
    write(&hashed([8, 8, 30], 1, &j750), &j750, Container::Gcvf, &plain);
    let (_, config) = gcvf::read(plain.join("slices.gcvf"), &Control::none()).unwrap();
    assert!(config.materials.iter().any(|m| m.name == "cyan" || m.name == "white"), "{config:?}");
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let grid = hashed([120, 70, 45], 9, &vivid());
    let files = [1, 3].map(|threads| {
        let out = dir.path().join(threads.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write(&grid, &vivid(), Container::Gcvf, &out));
        fs::read(out.join("slices.gcvf")).unwrap()
    });
    assert!(files[0] == files[1]);
}

#[test]
fn cancelling_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let progress = |done: u64, _: u64| stop.store(done >= 8, Ordering::Relaxed);
    let control = Control::none().with_progress(&progress).with_cancel(&stop);
    let settings = ExportSettings { format: Container::Gcvf, ..Default::default() };
    let grid = hashed([30, 20, 64], 3, &vivid());
    let result =
        export(&grid, &MaterialTable::cmykw(), &vivid(), &settings, &dir.path().join("out"), &control);
    assert!(matches!(result, Err(SliceError::Cancelled)));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn a_pitch_that_the_format_cannot_state_is_refused() {
    for mm in [[25.4 / 600.5, 0.1, 0.027], [0.1, 0.1, 0.027_000_4]] {
        let target = vivid().with_pitch(Pitch::new(mm).unwrap());
        let error = Container::Gcvf.check(&target).unwrap_err();
        assert!(matches!(error, SliceError::Unsupported(_)) && error.to_string().contains("whole dots"));
        assert!(Container::Png.check(&target).is_ok());
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

#[test]
fn what_is_shown_is_the_object() {
    let dir = tempfile::tempdir().unwrap();
    let (target, size) = (vivid(), [37, 22, 33]);
    let frame = Frame::new([5.0; 3], target.pitch(), size).unwrap();
    // Two steps: the lower one everywhere but at low x, the upper one at high y.
    let solid = |[x, y, z]: [u32; 3]| x >= 3 && (z < 10 || (y >= 15 && z < 31));
    let grid = LabelGrid::from_fn(frame, |voxel| if solid(voxel) { 1 + (voxel[0] % 5) as u8 } else { AIR });
    for order in [RowOrder::HighestYFirst, RowOrder::LowestYFirst] {
        let out = dir.path().join(format!("{order:?}"));
        write(&grid, &target.clone().with_row_order(order), Container::Gcvf, &out);
        let found = entries(&out.join("slices.gcvf"));

        let bounds = floats(&found["MeshBbx.ktn"]);
        assert_eq!(bounds, [3.0, 0.0, 0.0, 37.0, 22.0, 31.0]);

        let mut reader = png::Decoder::new(Cursor::new(&found["Zbuffer.png"])).read_info().unwrap();
        let mut data = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut data).unwrap();
        assert_eq!(
            (reader.info().bit_depth, reader.info().color_type),
            (png::BitDepth::Sixteen, png::ColorType::Grayscale)
        );
        for (i, sample) in data.chunks_exact(2).enumerate() {
            let (x, row) = (i as u32 % size[0], i as u32 / size[0]);
            let y = order.y_of_row(row, size[1]);
            let top = (0..size[2]).rev().find(|&z| solid([x, y, z])).unwrap_or(0);
            assert_eq!(u32::from(sample[0]) << 8 | u32::from(sample[1]), top, "{x} {y}");
        }
        check_stl(&found["Mesh.stl"], &target, size, order);
    }
}

/// A closed surface, turned outwards, with the object's extent: within a block of it, and a block is a voxel here or two.
fn check_stl(stl: &[u8], target: &PrintTarget, size: [u32; 3], order: RowOrder) {
    let count = u32::from_le_bytes(stl[80..84].try_into().unwrap()) as usize;
    assert_eq!(stl.len(), 84 + 50 * count);
    let (mut edges, mut volume) = (BTreeMap::new(), 0.0);
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for triangle in stl[84..].chunks_exact(50) {
        let v = floats(&triangle[..48]);
        let corner = |i: usize| [v[3 + 3 * i], v[4 + 3 * i], v[5 + 3 * i]];
        let [a, b, c] = [0, 1, 2].map(corner);
        let (ab, ac): ([f32; 3], [f32; 3]) =
            (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
        let cross: [f32; 3] =
            std::array::from_fn(|i| ab[(i + 1) % 3] * ac[(i + 2) % 3] - ab[(i + 2) % 3] * ac[(i + 1) % 3]);
        assert!((0..3).map(|i| cross[i] * v[i]).sum::<f32>() > 0.0, "the normal is that of the corners");
        volume += f64::from((0..3).map(|i| cross[i] * a[i]).sum::<f32>()) / 6.0;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            *edges.entry((p.map(f32::to_bits), q.map(f32::to_bits))).or_insert(0) += 1;
        }
        for corner in [a, b, c] {
            low = std::array::from_fn(|i| low[i].min(corner[i]));
            high = std::array::from_fn(|i| high[i].max(corner[i]));
        }
    }
    assert!(edges.iter().all(|(&(p, q), &n)| edges.get(&(q, p)) == Some(&n)), "closed");
    let mm = target.pitch().mm();
    let near = |value: f32, wanted: f64, slack: f64| (f64::from(value) - wanted).abs() < slack + 1e-6;
    // From column 3 to the right edge; from the top row down; from the bottom up to layer 31.
    let extent = |a: usize| f64::from(size[a]) * mm[a];
    let block = 3.0 * mm[2];
    assert!(near(low[0], 3.0 * mm[0], 2.0 * mm[0]) && near(high[0], extent(0), 0.0), "{low:?} {high:?}");
    assert!(near(low[1], -extent(1), 0.0) && near(high[1], 0.0, 0.0), "{low:?} {high:?}");
    assert!(near(low[2], 0.0, 0.0) && near(high[2], 31.0 * mm[2], block), "{low:?} {high:?}");
    let voxels = 34.0 * (22.0 * 10.0 + 7.0 * 21.0);
    let exact = voxels * mm.iter().product::<f64>();
    assert!((volume / exact - 1.0).abs() < 0.2 && volume > 0.0, "{order:?}: {volume} for {exact}");
}

#[test]
fn what_is_wrong_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let grid = hashed([20, 10, 31], 3, &vivid());
    write(&grid, &vivid(), Container::Gcvf, &out);
    let path = out.join("slices.gcvf");
    let good = entries(&path);
    let message = |change: &dyn Fn(&mut Entries)| {
        let mut changed = good.clone();
        change(&mut changed);
        pack(&path, &changed);
        let error = gcvf::read(&path, &Control::none()).unwrap_err();
        assert!(matches!(error, SliceError::Invalid(_) | SliceError::Unsupported(_)), "{error}");
        error.to_string()
    };
    let xml = |from: &str, to: &str| {
        let (from, to) = (from.to_owned(), to.to_owned());
        message(&move |e| {
            let text = String::from_utf8(e["ConfigFile.xml"].clone()).unwrap();
            assert!(text.contains(&from));
            e.insert("ConfigFile.xml".into(), text.replace(&from, &to).into_bytes());
        })
    };
    assert!(message(&|e| drop(e.remove("ConfigFile.xml"))).contains("ConfigFile.xml: is missing"));
    assert!(message(&|e| drop(e.remove("layer_7.png"))).contains("layer_7.png: is missing"));
    let swapped = message(&|e| {
        let other = e["layer_8.png"].clone();
        e.insert("layer_9.png".into(), other);
    });
    assert!(swapped.contains("its images hold"), "{swapped}");
    assert!(
        message(&|e| drop(e.insert("layer_7.png".into(), vec![7; 500])))
            .contains("layer_7.png: is not a readable PNG")
    );
    assert!(message(&|e| drop(e.insert("ConfigFile.xml".into(), vec![b' '; 2 << 20]))).contains("are read"));
    assert!(message(&|e| drop(e.insert("ConfigFile.xml".into(), vec![0xff; 9]))).contains("no UTF-8"));
    assert!(xml("<SliceWidth>20", "<SliceWidth>21").contains("20 x 10 pixels"));
    assert!(xml("<NumberOfSlices>31", "<NumberOfSlices>0").contains("empty axis"));
    assert!(xml("<NumberOfSlices>31", "<NumberOfSlices>4000000000").contains("voxels"));
    assert!(xml("<NumberOfSlices>31", "<NumberOfSlices>1000000").contains("is missing"));
    assert!(xml("240 240 240 255", "240 240 241 255").contains("no material's colour"));
    assert!(xml("<XDpi>600", "<XDpi>0").contains("pitch"));
    assert!(xml("<ImageFilePrefix>layer_", "<ImageFilePrefix>../../layer_").contains("is missing"));
    // Claims that the archive cannot hold.
    let sizes = |w: u32, h: u32| format!("<SliceWidth>{w}</SliceWidth>\n    <SliceHeight>{h}</SliceHeight>");
    assert!(xml(&sizes(20, 10), &sizes(60_000, 60_000)).contains("claims"));
    let wide = xml("<SliceWidth>20</SliceWidth>", "<SliceWidth>60000</SliceWidth>");
    assert!(wide.contains("cannot be an image"), "{wide}");

    fs::write(&path, b"PK\x03\x04 and so on").unwrap();
    assert!(gcvf::read(&path, &Control::none()).unwrap_err().to_string().contains("not a readable zip"));
    assert!(matches!(gcvf::read(dir.path().join("none.gcvf"), &Control::none()), Err(SliceError::Io(_))));
}

#[test]
fn entries_that_share_bytes_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    write(&hashed([20, 10, 31], 3, &vivid()), &vivid(), Container::Gcvf, &out);
    let path = out.join("slices.gcvf");
    let found = entries(&path);
    let mut zip = ZipWriter::new(File::create(&path).unwrap());
    for (name, bytes) in found.iter().filter(|(name, _)| name.as_str() != "layer_5.png") {
        zip.start_file(name.as_str(), SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    // One layer's bytes under a second name, as a bomb has them under thousands.
    zip.shallow_copy_file("layer_4.png", "layer_5.png").unwrap();
    zip.finish().unwrap();
    let error = gcvf::read(&path, &Control::none()).unwrap_err().to_string();
    assert!(error.contains("share bytes"), "{error}");
}

#[test]
fn a_bomb_within_a_bomb_costs_no_more_than_its_tiles() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    write(&hashed([20, 10, 31], 3, &vivid()), &vivid(), Container::Gcvf, &out);
    let path = out.join("slices.gcvf");
    let mut found = entries(&path);
    found.retain(|name, _| name == "ConfigFile.xml");
    // 31 black images of 10,000 x 1,000 that deflate twice: 310 M voxels in some kilobytes.
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 10_000, 1000);
    encoder.set_color(png::ColorType::Rgba);
    let row: Vec<u8> = [0, 0, 0, 255].repeat(10_000);
    let mut writer = encoder.write_header().unwrap();
    let mut stream = writer.stream_writer().unwrap();
    (0..1000).for_each(|_| stream.write_all(&row).unwrap());
    stream.finish().unwrap();
    drop(writer);
    (0..31).for_each(|layer| drop(found.insert(format!("layer_{layer}.png"), png.clone())));
    let text = String::from_utf8(found["ConfigFile.xml"].clone()).unwrap();
    let text = text
        .replace("<SliceWidth>20<", "<SliceWidth>10000<")
        .replace("<SliceHeight>10<", "<SliceHeight>1000<");
    found.insert("ConfigFile.xml".into(), text.into_bytes());
    pack(&path, &found);
    assert!(fs::metadata(&path).unwrap().len() < 50_000);
    let error = gcvf::read(&path, &Control::none()).unwrap_err().to_string();
    assert!(error.contains("its images hold 0"), "{error}");
}

#[test]
fn an_archive_that_is_not_the_manifests_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let [out, other] = ["out", "other"].map(|name| dir.path().join(name));
    write(&hashed([20, 10, 31], 3, &vivid()), &vivid(), Container::Gcvf, &out);
    write(&hashed([20, 10, 31], 4, &vivid()), &vivid(), Container::Gcvf, &other);
    fs::copy(other.join("slices.gcvf"), out.join("slices.gcvf")).unwrap();
    let error = read_stack(&out, &Control::none()).unwrap_err().to_string();
    assert!(error.contains("slices.gcvf") && error.contains("than the manifest says"), "{error}");
}

#[test]
fn archives_of_other_writers_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gcvf");
    let xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- a comment -->\n<GCVF><Version>2</Version><Resolution>\
        <XDpi>600</XDpi><YDpi>300</YDpi><SliceThicknessNanoMeter>27000</SliceThicknessNanoMeter></Resolution>\
        <SliceDimensions><SliceWidth>3</SliceWidth><SliceHeight>2</SliceHeight></SliceDimensions>\
        <SliceRange><StartIndex>4</StartIndex><NumberOfSlices>1</NumberOfSlices></SliceRange><BitDepth>4</BitDepth>\
        <MaxNumberOfColors>6</MaxNumberOfColors><ImageFilePrefix>slice-</ImageFilePrefix><MaterialList>\
        <BackGroundMaterialRGBA>0 0 0 255</BackGroundMaterialRGBA><Material><Name>VeroCyan</Name>\
        <RGBA>0 255 255 255</RGBA><VoxelCount>2</VoxelCount></Material></MaterialList></GCVF>";
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 3, 2);
    encoder.set_color(png::ColorType::Rgba);
    let (air, cyan) = ([0, 0, 0, 255], [0, 255, 255, 255]);
    let pixels = [cyan, air, air, air, air, cyan].concat();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    pack(&path, &BTreeMap::from([("ConfigFile.xml".into(), xml.into()), ("slice-4.png".into(), png)]));
    let (grid, config): (_, Config) = gcvf::read(&path, &Control::none()).unwrap();
    assert_eq!((grid.get([0, 1, 0]), grid.get([2, 0, 0]), grid.solid_count()), (1, 1, 2));
    assert_eq!(grid.frame().pitch(), PrintTarget::j750().pitch());
    assert_eq!((config.start, config.materials[0].name.as_str()), (4, "VeroCyan"));
}
