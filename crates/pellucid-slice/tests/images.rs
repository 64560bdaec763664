//! Stacks of other tools' images: every colour type comes back, and everything that is wrong is named.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use pellucid_slice::{ImageStack, PrintTarget, RowOrder, SliceError, list_images, read_images};
use pellucid_voxel::{Control, Frame, LabelGrid, Material, MaterialTable, Pitch};
use png::{BitDepth, ColorType};
use proptest::prelude::*;

const SIZE: [u32; 3] = [37, 21, 19];
/// Colours of air and labels 1 to 3.
const COLORS: [[u8; 4]; 4] = [[0, 0, 0, 255], [200, 10, 30, 255], [20, 180, 40, 255], [250, 240, 230, 255]];
const GREYS: [u8; 4] = [0, 85, 170, 255];

fn pitch() -> Pitch {
    Pitch::new([0.05, 0.07, 0.03]).unwrap()
}

fn label(x: u32, y: u32, z: u32) -> u8 {
    let h = (u64::from(x) * 73 + u64::from(y) * 151 + u64::from(z) * 283).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    if x > 30 { 2 } else { (h >> 60) as u8 & 3 }
}

fn grid() -> LabelGrid {
    let mut grid = LabelGrid::new(Frame::new([0.0; 3], pitch(), SIZE).unwrap());
    for z in 0..SIZE[2] {
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                grid.set([x, y, z], label(x, y, z));
            }
        }
    }
    grid
}

fn colors() -> ImageStack {
    ImageStack::new(pitch(), COLORS.into_iter().zip(0..)).unwrap()
}

/// Writes one PNG of rows packed by `pixels(row)`.
fn write(path: &Path, size: [u32; 2], kind: (ColorType, BitDepth), rows: impl Fn(u32) -> Vec<u8>) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), size[0], size[1]);
    encoder.set_color(kind.0);
    encoder.set_depth(kind.1);
    if kind.0 == ColorType::Indexed {
        encoder.set_palette(COLORS.iter().flat_map(|c| c[..3].to_vec()).collect::<Vec<_>>());
    }
    let data: Vec<u8> = (0..size[1]).flat_map(rows).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

/// One layer of the grid as samples, packed where a sample has less than a byte.
fn row(kind: (ColorType, BitDepth), z: u32, y: u32) -> Vec<u8> {
    let labels = (0..SIZE[0]).map(|x| label(x, y, z));
    let samples: Vec<u8> = labels
        .flat_map(|l| match kind.0 {
            ColorType::Rgba => COLORS[usize::from(l)].to_vec(),
            ColorType::Rgb => COLORS[usize::from(l)][..3].to_vec(),
            ColorType::Grayscale if kind.1 == BitDepth::Eight => vec![GREYS[usize::from(l)]],
            ColorType::GrayscaleAlpha => vec![GREYS[usize::from(l)], if l == 0 { 0 } else { 255 }],
            _ => vec![l],
        })
        .collect();
    let bits = kind.1 as usize;
    if bits == 8 {
        return samples;
    }
    let pack =
        |chunk: &[u8]| chunk.iter().enumerate().fold(0, |byte, (i, s)| byte | s << (8 - bits * (i + 1)));
    samples.chunks(8 / bits).map(pack).collect()
}

fn stack(folder: &Path, kind: (ColorType, BitDepth), order: RowOrder) -> Vec<PathBuf> {
    for z in 0..SIZE[2] {
        let path = folder.join(format!("layer_{}.png", z + 1));
        write(&path, [SIZE[0], SIZE[1]], kind, |r| row(kind, z, order.y_of_row(r, SIZE[1])));
    }
    list_images(folder, "layer_*.png").unwrap()
}

const RGB: (ColorType, BitDepth) = (ColorType::Rgb, BitDepth::Eight);

#[test]
fn every_colour_type_reads_as_the_grid() {
    let greys = ImageStack::new(pitch(), GREYS.map(|v| [v, v, v, 255]).into_iter().zip(0..)).unwrap();
    for order in [RowOrder::HighestYFirst, RowOrder::LowestYFirst] {
        for (kind, meaning) in [
            (RGB, colors()),
            ((ColorType::Rgba, BitDepth::Eight), colors()),
            ((ColorType::Indexed, BitDepth::Eight), colors()),
            ((ColorType::Indexed, BitDepth::Two), colors()),
            ((ColorType::Grayscale, BitDepth::Eight), greys.clone()),
            ((ColorType::Grayscale, BitDepth::Two), greys.clone()),
            ((ColorType::GrayscaleAlpha, BitDepth::Eight), greys.clone()),
        ] {
            let temp = tempfile::tempdir().unwrap();
            let files = stack(temp.path(), kind, order);
            assert!(files[9].ends_with("layer_10.png"));
            let back = read_images(&files, &meaning.with_row_order(order), &Control::none()).unwrap();
            assert!(back == grid(), "{kind:?} {order:?}");
        }
    }
}

#[test]
fn a_targets_slices_read_without_their_manifest() {
    let (target, table) = (PrintTarget::j750(), MaterialTable::cmykw());
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let frame = Frame::new([1.0, -2.0, 0.0], target.pitch(), [20, 18, 33]).unwrap();
    let mut grid = LabelGrid::new(frame);
    for i in 0..33 {
        grid.set([i % 20, i % 18, i], 1 + (i % 5) as u8);
    }
    let settings = pellucid_slice::ExportSettings::default();
    pellucid_slice::export(&grid, &table, &target, &settings, &out, &Control::none()).unwrap();
    let files = list_images(out.join("slices"), "*.png").unwrap();
    let stack = ImageStack::for_target(&target, &table).unwrap().with_origin_mm([1.0, -2.0, 0.0]);
    assert!(read_images(&files, &stack, &Control::none()).unwrap() == grid);
    // A table that has none of the printer's materials could give air only.
    let resin = Material { name: "resin".into(), sigma_s: vec![1.0], sigma_a: vec![0.1], g: 0.4.into() };
    let strange = MaterialTable::new(vec!["grey".into()], vec![resin]).unwrap();
    assert!(ImageStack::for_target(&target, &strange).is_err());
}

fn message(files: &[PathBuf], stack: &ImageStack) -> String {
    let error = read_images(files, stack, &Control::none()).unwrap_err();
    assert!(matches!(error, SliceError::Invalid(_) | SliceError::Unsupported(_)), "{error}");
    error.to_string()
}

#[test]
fn unknown_colours_are_counted_and_placed() {
    let temp = tempfile::tempdir().unwrap();
    let mut files = stack(temp.path(), RGB, RowOrder::HighestYFirst);
    let paint = |z: u32, spots: &[([u32; 2], [u8; 3])]| {
        write(&files[z as usize], [SIZE[0], SIZE[1]], RGB, |r| {
            let mut line = row(RGB, z, SIZE[1] - 1 - r);
            for (at, rgb) in spots.iter().filter(|(at, _)| at[1] == r) {
                line[at[0] as usize * 3..][..3].copy_from_slice(rgb);
            }
            line
        });
    };
    paint(4, &[([9, 3], [7, 7, 7]), ([3, 8], [7, 7, 7]), ([1, 2], [1, 2, 3])]);
    paint(17, &[([0, 0], [7, 7, 7])]);
    let text = message(&files, &colors());
    for words in [
        "4 pixels have colours that stand for nothing",
        "[7, 7, 7, 255] 3 times, first in",
        "layer_5.png at pixel (9, 3)",
        "[1, 2, 3, 255] 1 times",
        "layer_5.png at pixel (1, 2)",
        "tolerance",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(!text.contains("more colours"));

    // Every pixel another colour: told, not listed without end.
    let wild = temp.path().join("wild.png");
    write(&wild, [64, 64], RGB, |r| (0..64).flat_map(|x| [x as u8, r as u8, 77]).collect());
    files = vec![wild];
    let text = message(&files, &colors());
    assert!(text.contains("4096 pixels") && text.contains("and more colours") && text.len() < 2000, "{text}");
}

#[test]
fn a_tolerance_takes_near_colours_and_none_that_could_be_two() {
    let temp = tempfile::tempdir().unwrap();
    let files = stack(temp.path(), RGB, RowOrder::HighestYFirst);
    for (z, path) in files.iter().enumerate() {
        write(path, [SIZE[0], SIZE[1]], RGB, |r| {
            let line = row(RGB, z as u32, SIZE[1] - 1 - r);
            line.iter().enumerate().map(|(i, &v)| v.saturating_add((i % 4) as u8)).collect()
        });
    }
    assert!(message(&files, &colors()).contains("stand for nothing"));
    let near = colors().with_tolerance(6).unwrap();
    assert!(read_images(&files, &near, &Control::none()).unwrap() == grid());

    let close = [([0, 0, 0, 255], 0), ([10, 0, 0, 255], 1), ([0, 9, 0, 255], 1), ([255; 4], 2)];
    let stack = ImageStack::new(pitch(), close).unwrap();
    let error = stack.clone().with_tolerance(5).unwrap_err().to_string();
    assert!(error.contains("overlap") && error.contains("at most 4"), "{error}");
    assert!(stack.with_tolerance(4).is_ok());
}

#[test]
fn colours_that_cannot_be_told_apart_are_refused() {
    let refused = |colors: &[([u8; 4], u8)], word: &str| {
        let error = ImageStack::new(pitch(), colors.iter().copied()).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(&[], "none stands for a material");
    refused(&[([0; 4], 0)], "none stands for a material");
    refused(&[([1, 2, 3, 255], 1), ([1, 2, 3, 255], 2)], "label 1 and label 2");
    refused(&[([1, 2, 3, 0], 1)], "alpha 0");
    assert!(ImageStack::new(pitch(), [([1, 2, 3, 255], 1), ([1, 2, 3, 255], 1)]).is_ok());
}

#[test]
fn wrong_images_are_named() {
    let temp = tempfile::tempdir().unwrap();
    let mut files = stack(temp.path(), RGB, RowOrder::HighestYFirst);
    let good = fs::read(&files[7]).unwrap();
    let with = |bytes: &[u8], words: &[&str]| {
        fs::write(&files[7], bytes).unwrap();
        let text = message(&files, &colors());
        assert!(words.iter().chain(&["layer_8.png"]).all(|w| text.contains(w)), "{text}");
    };
    with(b"", &["not a readable PNG"]);
    with(b"GIF89a and so on", &["not a readable PNG"]);
    with(&good[..good.len() / 2], &[]);
    let mut broken = good.clone();
    broken[good.len() / 2] ^= 0x55;
    with(&broken, &[]);
    // A header that claims more than the file can hold; its checksum is right.
    let mut huge = good.clone();
    huge[16..20].copy_from_slice(&0x4000_0000u32.to_be_bytes());
    let sum = crc(&huge[12..29]);
    huge[29..33].copy_from_slice(&sum.to_be_bytes());
    with(&huge, &["cannot be an image of 1073741824 x 21 pixels"]);

    let as_bytes = |size: [u32; 2], kind, interlaced: bool| {
        let path = temp.path().join("other");
        write(&path, size, kind, |_| vec![0; size[0] as usize * kind.0.samples() * kind.1 as usize / 8]);
        let mut bytes = fs::read(&path).unwrap();
        if interlaced {
            bytes[28] = 1;
            let sum = crc(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        }
        bytes
    };
    let [w, h, _] = SIZE;
    with(&as_bytes([w, h + 1], RGB, false), &["is 37 x 22 pixels", "layer_1.png 37 x 21"]);
    with(&as_bytes([w, h], (ColorType::Rgb, BitDepth::Sixteen), false), &["16 bits", "save it with 8"]);
    with(&as_bytes([w, h], RGB, true), &["interlaced"]);

    fs::write(&files[7], &good).unwrap();
    assert!(message(&[], &colors()).contains("there are none"));
    assert!(message(&files, &colors().with_origin_mm([f64::NAN; 3])).contains("origin"));
    files[3] = temp.path().join("gone.png");
    match read_images(&files, &colors(), &Control::none()) {
        Err(SliceError::Io(error)) => assert!(error.path.ends_with("gone.png")),
        other => panic!("{:?}", other.err()),
    }
}

/// The checksum of PNG's chunks.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn reading_tells_its_progress_and_stops_when_asked() {
    let temp = tempfile::tempdir().unwrap();
    let files = stack(temp.path(), RGB, RowOrder::HighestYFirst);
    let most = AtomicU64::new(0);
    let progress = |done: u64, total: u64| {
        assert_eq!(total, u64::from(SIZE[2]));
        most.fetch_max(done, Ordering::Relaxed);
    };
    read_images(&files, &colors(), &Control::none().with_progress(&progress)).unwrap();
    assert_eq!(most.into_inner(), u64::from(SIZE[2]));
    let stop = AtomicBool::new(true);
    let stopped = read_images(&files, &colors(), &Control::none().with_cancel(&stop));
    assert!(matches!(stopped, Err(SliceError::Cancelled)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_images_give_typed_errors(
        layer in 0usize..19,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        fix_header in any::<bool>(),
    ) {
        let temp = tempfile::tempdir().unwrap();
        let files = stack(temp.path(), (ColorType::Indexed, BitDepth::Two), RowOrder::HighestYFirst);
        let mut bytes = fs::read(&files[layer]).unwrap();
        for (at, value) in edits {
            let i = if fix_header { 16 + at.index(13) } else { at.index(bytes.len()) };
            bytes[i] = value;
        }
        if fix_header {
            // So that what the header claims is believed.
            let sum = crc(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        }
        fs::write(&files[layer], bytes).unwrap();
        match read_images(&files, &colors(), &Control::none()) {
            Ok(back) => prop_assert_eq!(back.size(), SIZE),
            Err(SliceError::Invalid(fault) | SliceError::Unsupported(fault)) => {
                prop_assert!(fault.to_string().contains(".png"), "{}", fault)
            }
            Err(other) => prop_assert!(false, "{}", other),
        }
    }
}
