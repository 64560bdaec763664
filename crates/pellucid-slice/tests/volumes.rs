//! Volumes for other tools: they come back exactly, say what is wrong with them, and take no memory on a claim.
#![cfg(all(feature = "nrrd", feature = "npy"))]

mod common;

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use common::{ORIGIN, hashed};
use pellucid_slice::container::{npy, nrrd};
use pellucid_slice::{Container, ExportSettings, Manifest, PrintTarget, SliceError, export, read_stack};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Tile};
use proptest::prelude::*;

const BOTH: [Container; 2] = [Container::Nrrd, Container::Npy];

fn write(grid: &LabelGrid, format: Container, dir: &Path, control: &Control) -> Result<Manifest, SliceError> {
    let settings = ExportSettings { format, seed: 5, ..Default::default() };
    export(grid, &MaterialTable::cmykw(), &PrintTarget::j750(), &settings, dir, control)
}

fn read(format: Container, path: &Path) -> Result<LabelGrid, SliceError> {
    match format {
        Container::Nrrd => nrrd::read(path, &Control::none()).map(|(grid, _)| grid),
        _ => npy::read(path, PrintTarget::j750().pitch(), ORIGIN, &Control::none()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn volumes_come_back_exactly(size in [1u32..50, 1u32..40, 1u32..40], seed in any::<u64>()) {
        let dir = tempfile::tempdir().unwrap();
        let grid = hashed(size, seed, &PrintTarget::j750());
        for format in BOTH {
            let out = dir.path().join(format.name());
            let written = write(&grid, format, &out, &Control::none()).unwrap();
            // Volumes are not padded to what the printer wants.
            prop_assert_eq!((written.layers, written.padding_layers), (size[2], 0));
            prop_assert_eq!(fs::read_dir(&out).unwrap().count(), 2);
            let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
            prop_assert!(back == grid);
            prop_assert_eq!(&manifest, &written);

            let alone = read(format, &out.join(format.files())).unwrap();
            prop_assert_eq!(alone.frame().pitch(), grid.frame().pitch());
            let [near, exact] = [alone.frame().origin_mm(), ORIGIN];
            prop_assert!((0..3).all(|a| (near[a] - exact[a]).abs() < 1e-14), "{:?}", near);
            let mut labels = [vec![9; grid.frame().voxels() as usize], vec![9; grid.frame().voxels() as usize]];
            alone.to_dense(&mut labels[0]).unwrap();
            grid.to_dense(&mut labels[1]).unwrap();
            prop_assert!(labels[0] == labels[1]);
        }
        let (_, materials) = nrrd::read(dir.path().join("nrrd/labels.nrrd"), &Control::none()).unwrap();
        prop_assert_eq!(materials, Manifest::load(&dir.path().join("nrrd")).unwrap().materials);
    }

    #[test]
    fn damaged_volumes_give_typed_errors(
        nrrd in any::<bool>(),
        header in any::<bool>(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let format = BOTH[usize::from(nrrd)];
        write(&hashed([37, 21, 31], 5, &PrintTarget::j750()), format, &out, &Control::none()).unwrap();
        let path = out.join(format.files());
        let mut bytes = fs::read(&path).unwrap();
        for (at, value) in edits {
            let end = if header { 500.min(bytes.len()) } else { bytes.len() };
            bytes[at.index(end)] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(&path, bytes).unwrap();
        match read(format, &path) {
            Ok(back) => prop_assert!(back.frame().voxels() <= 1 << 20),
            Err(SliceError::Invalid(fault) | SliceError::Unsupported(fault)) => prop_assert!(!fault.reason.is_empty()),
            Err(other) => prop_assert!(false, "{other}"),
        }
        // The manifest's counts find what the file's form does not show, but for voxels that changed places.
        if let Err(other) = read_stack(&out, &Control::none()) {
            prop_assert!(matches!(other, SliceError::Invalid(_) | SliceError::Unsupported(_)), "{other}");
        }
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let grid = hashed([120, 70, 45], 9, &PrintTarget::j750());
    for format in BOTH {
        let files = [1, 3].map(|threads| {
            let out = dir.path().join(format!("{}{threads}", format.name()));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| write(&grid, format, &out, &Control::none())).unwrap();
            fs::read(out.join(format.files())).unwrap()
        });
        assert!(files[0] == files[1], "{format:?}");
    }
}

#[test]
fn writing_tells_its_progress_and_stops_when_asked() {
    let dir = tempfile::tempdir().unwrap();
    for format in BOTH {
        let out = dir.path().join("out");
        let (stop, most) = (AtomicBool::new(false), AtomicU64::new(0));
        let progress = |done: u64, total: u64| {
            assert_eq!(total, 64);
            most.fetch_max(done, Ordering::Relaxed);
            stop.store(done >= 8, Ordering::Relaxed);
        };
        let control = Control::none().with_progress(&progress).with_cancel(&stop);
        let result = write(&hashed([30, 20, 64], 3, &PrintTarget::j750()), format, &out, &control);
        assert!(matches!(result, Err(SliceError::Cancelled)));
        assert!(most.load(Ordering::Relaxed) >= 8);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}

#[test]
fn the_array_is_as_numpy_has_it() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut grid = LabelGrid::new(Frame::new([0.0; 3], PrintTarget::j750().pitch(), [5, 3, 2]).unwrap());
    grid.set([4, 0, 1], 3);
    write(&grid, Container::Npy, &out, &Control::none()).unwrap();
    let bytes = fs::read(out.join("labels.npy")).unwrap();
    assert_eq!(bytes[..10], *b"\x93NUMPY\x01\0v\0");
    assert!(bytes[10..].starts_with(b"{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3, 5), }  "));
    assert_eq!((bytes[127], bytes.len()), (b'\n', 128 + 30));
    assert_eq!(bytes[128 + 15 + 4], 3);
}

fn npy_bytes(dictionary: &str, data: usize) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((dictionary.len() as u16).to_le_bytes());
    bytes.extend(dictionary.bytes());
    bytes.extend(vec![1; data]);
    bytes
}

#[test]
fn wrong_arrays_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    let good = "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3, 4)}";
    let cases = [
        (npy_bytes(good, 23), "cannot"),
        (npy_bytes(good, 25), "is not an array of [4, 3, 2] voxels"),
        (npy_bytes(&good.replace("|u1", "<f8"), 24), "is of type '<f8'"),
        (npy_bytes(&good.replace("False", "True"), 24), "Fortran"),
        (npy_bytes(&good.replace("(2, 3, 4)", "(24,)"), 24), "1 axes"),
        (npy_bytes(&good.replace("2, 3", "-2, 3"), 24), "\"-2\", which is no size"),
        (npy_bytes(&good.replace("2, 3", "99999999999, 3"), 24), "which is no size"),
        (npy_bytes(&good.replace("2, 3", "1048576, 1048576"), 24), "is not an array of"),
        (npy_bytes(&good.replace("shape", "form"), 24), "no 'shape'"),
        (b"\x93NUMPY\x09\0\0\0\0\0".to_vec(), "version 9"),
        (b"\x93NUMPY\x02\0\xff\xff\xff\xff".to_vec(), "header of 4294967295 bytes"),
        (b"\x93NUMPY\x01\0\xff\xff{}".to_vec(), "ends within the header"),
        (b"PK and so on".to_vec(), "is not a NumPy array"),
    ];
    for (bytes, words) in cases {
        fs::write(&path, bytes).unwrap();
        let error = read(Container::Npy, &path).unwrap_err().to_string();
        let words = words.replace("cannot", "is not an array");
        assert!(error.contains(&words) && error.contains("a.npy"), "{words}: {error}");
    }
    fs::write(&path, npy_bytes(good, 24)).unwrap();
    assert_eq!(read(Container::Npy, &path).unwrap().size(), [4, 3, 2]);
    assert!(matches!(read(Container::Npy, &dir.path().join("none.npy")), Err(SliceError::Io(_))));
}

const HEADER: &str = "NRRD0004\n# by hand\ntype: unsigned char\ndimension: 3\nspace: left-posterior-superior\n\
    sizes: 4 3 2\nspace directions: (0.5,0,0) (0,0.25,0) (0,0,2)\nkinds: domain domain domain\nencoding: raw\n\
    space origin: (0.25, 0.125, 1)\nmaterial 1:=a \\\\ b\nrgba 1:=1 2 3 255\n\n";

#[test]
fn volumes_of_other_tools_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.nrrd");
    let labels: Vec<u8> = (0..24).map(|i| i % 2).collect();
    fs::write(&path, [HEADER.as_bytes(), &labels[..]].concat()).unwrap();
    let (grid, materials) = nrrd::read(&path, &Control::none()).unwrap();
    let frame = Frame::new([0.0; 3], Pitch::new([0.5, 0.25, 2.0]).unwrap(), [4, 3, 2]).unwrap();
    assert!(grid == LabelGrid::from_dense(frame, &labels).unwrap());
    assert_eq!((materials[0].name.as_str(), materials[0].voxels), ("a \\ b", 12));

    // Spacings without a place; gzip in two members.
    let mut zipped = HEADER
        .replace("space directions: (0.5,0,0) (0,0.25,0) (0,0,2)", "spacings: 0.5 0.25 2")
        .replace("space origin: (0.25, 0.125, 1)\n", "")
        .replace("encoding: raw", "encoding: gzip\r")
        .into_bytes();
    for half in labels.chunks(12) {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(half).unwrap();
        zipped.extend(encoder.finish().unwrap());
    }
    fs::write(&path, zipped).unwrap();
    assert!(nrrd::read(&path, &Control::none()).unwrap().0 == grid);
}

#[test]
fn wrong_volumes_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.nrrd");
    for (from, to, words) in [
        ("NRRD0004", "NRRD0099", "is not a NRRD file"),
        ("unsigned char", "float", "type: \"float\"; labels are uint8"),
        ("dimension: 3", "dimension: 4", "axes x, y, z"),
        ("sizes: 4 3 2", "sizes: 4 3", "three numbers"),
        ("sizes: 4 3 2", "sizes: 4 3 -2", "whole numbers"),
        ("sizes: 4 3 2", "sizes: 4 3 3", "cannot be a volume of [4, 3, 3] voxels"),
        ("sizes: 4 3 2", "sizes: 4000000000 4000000000 4000000000", "cannot be a volume"),
        ("sizes: 4 3 2\n", "", "no field \"sizes\""),
        ("(0,0.25,0)", "(0,0.25,0.1)", "not turned"),
        ("(0,0,2)", "none", "not turned"),
        ("(0,0,2)", "(0,0,-2)", "pitch"),
        ("(0.25, 0.125, 1)", "(1,2)", "one vector"),
        ("encoding: raw", "encoding: bzip2", "raw or gzip"),
        ("encoding: raw", "encoding: gzip", "damaged at layer 0"),
        ("encoding: raw", "encoding: raw\ndata file: b.raw", "one file"),
        ("encoding: raw", "encoding: raw\nbyte skip: -1", "without"),
        ("encoding: raw", "encoding: raw\nspace units: \"mm\" \"mm\" \"inch\"", "mm"),
        ("encoding: raw", "encoding: raw\nencoding: raw", "said twice"),
        ("encoding: raw", "encoding: raw\nstray", "is no field"),
        ("1 2 3 255", "1 2 3", "four numbers"),
    ] {
        assert!(HEADER.contains(from), "{from}");
        fs::write(&path, [HEADER.replacen(from, to, 1).as_bytes(), &[1; 24]].concat()).unwrap();
        let error = read(Container::Nrrd, &path).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("a.nrrd"), "{words}: {error}");
    }
    // A header without an end.
    fs::write(&path, [b"NRRD0004\n".to_vec(), vec![b'#'; 1 << 17]].concat()).unwrap();
    assert!(read(Container::Nrrd, &path).unwrap_err().to_string().contains("no empty line"));
}

#[test]
fn a_bomb_costs_no_more_than_its_tiles() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.nrrd");
    // 256 MiB of one label in a quarter of a megabyte; and the same claim where the data ends early.
    let header = HEADER.replace("4 3 2", "1024 1024 256").replace("raw", "gzip");
    let mut encoder = flate2::write::GzEncoder::new(header.into_bytes(), flate2::Compression::best());
    let block = vec![1; 1 << 20];
    (0..256).for_each(|_| encoder.write_all(&block).unwrap());
    let bytes = encoder.finish().unwrap();
    fs::write(&path, &bytes).unwrap();
    let (grid, materials) = nrrd::read(&path, &Control::none()).unwrap();
    assert!(grid.tiles().iter().all(|tile| matches!(tile, Tile::Constant(1))));
    assert_eq!(materials[0].voxels, 1 << 28);
    fs::write(&path, [&bytes[..bytes.len() - 9], &[0; 9]].concat()).unwrap();
    assert!(matches!(nrrd::read(&path, &Control::none()), Err(SliceError::Invalid(_))));
    let more = String::from_utf8_lossy(&bytes).contains("1024 1024 256");
    assert!(more);
    let longer = [b"NRRD0004\n".to_vec(), bytes[9..].to_vec()].concat();
    let text = String::from_utf8_lossy(&longer[..300]).replace("1024 1024 256", "1024 1024 255");
    let end = text.find("\n\n").unwrap() + 2;
    fs::write(&path, [&text.as_bytes()[..end], &longer[end..]].concat()).unwrap();
    let error = nrrd::read(&path, &Control::none()).unwrap_err().to_string();
    assert!(error.contains("more than its header says"), "{error}");
}

#[test]
fn a_volume_that_is_not_the_manifests_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    for format in BOTH {
        let [out, other] = ["out", "other"].map(|name| dir.path().join(format!("{name}-{}", format.name())));
        write(&hashed([20, 10, 30], 1, &PrintTarget::j750()), format, &out, &Control::none()).unwrap();
        write(&hashed([20, 10, 31], 1, &PrintTarget::j750()), format, &other, &Control::none()).unwrap();
        fs::copy(other.join(format.files()), out.join(format.files())).unwrap();
        let error = read_stack(&out, &Control::none()).unwrap_err().to_string();
        assert!(error.contains(format.files()) && error.contains("the manifest"), "{error}");
        write(
            &hashed([20, 10, 30], 2, &PrintTarget::j750()),
            format,
            &dir.path().join("same"),
            &Control::none(),
        )
        .unwrap();
        fs::rename(dir.path().join("same").join(format.files()), out.join(format.files())).unwrap();
        fs::remove_dir_all(dir.path().join("same")).unwrap();
        let error = read_stack(&out, &Control::none()).unwrap_err().to_string();
        assert!(error.contains("export again") || error.contains("manifest"), "{error}");
    }
}
