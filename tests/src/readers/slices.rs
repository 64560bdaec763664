//! Slices and volumes, manifests.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use pellucid::slice::container::{gcvf as archive, npy as array, nrrd as volume};
use pellucid::slice::{ExportSettings, ImageStack, Manifest, PrintTarget, export, read_images, read_stack};
use pellucid::voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch};

use super::{Outcome, folder};

/// A print of two layers of 8 x 4 voxels, all inks in it: the bytes of its manifest and of its first slice and the second.
struct Print {
    manifest: Vec<u8>,
    slices: [Vec<u8>; 2],
}

/// The J750 without its least number of layers.
pub fn any_height() -> PrintTarget {
    PrintTarget::j750().with_min_layers(1).expect("one layer is enough")
}

fn print() -> &'static Print {
    static PRINT: OnceLock<Print> = OnceLock::new();
    PRINT.get_or_init(|| {
        let folder = tempfile::tempdir().expect("there is room for a folder");
        let out = folder.path().join("print");
        let target = any_height();
        let frame = Frame::new([0.0; 3], target.pitch(), [8, 4, 2]).expect("the frame is valid");
        let grid = LabelGrid::from_fn(frame, |[x, y, _]| (x.min(y + 2)) as u8);
        let settings = ExportSettings::default();
        export(&grid, &MaterialTable::cmykw(), &target, &settings, &out, &Control::none())
            .expect("the print is written");
        let read = |name: &str| fs::read(out.join(name)).expect("the print is there");
        Print {
            manifest: read("manifest.json"),
            slices: ["slices/slice_00000.png", "slices/slice_00001.png"].map(read),
        }
    })
}

/// A PNG.
pub fn first_slice() -> &'static [u8] {
    &print().slices[0]
}

fn write(folder: &Path, manifest: &[u8], first: &[u8]) -> std::io::Result<()> {
    fs::create_dir(folder.join("slices"))?;
    fs::write(folder.join("manifest.json"), manifest)?;
    fs::write(folder.join("slices/slice_00000.png"), first)?;
    fs::write(folder.join("slices/slice_00001.png"), &print().slices[1])
}

fn file(bytes: &[u8], name: &str) -> Result<(tempfile::TempDir, PathBuf), Box<dyn std::error::Error>> {
    let folder = folder()?;
    let path = folder.path().join(name);
    fs::write(&path, bytes)?;
    Ok((folder, path))
}

/// The first slice of a print with a manifest, and an image of a stack without one.
pub fn png_stack(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    write(folder.path(), &print().manifest, bytes)?;
    let stated = read_stack(folder.path(), &Control::none());
    let stack = ImageStack::for_target(&PrintTarget::j750(), &MaterialTable::cmykw())?;
    read_images(&[folder.path().join("slices/slice_00000.png")], &stack, &Control::none())?;
    stated?;
    Ok(())
}

/// A print's manifest beside its two slices.
pub fn manifest(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    write(folder.path(), bytes, &print().slices[0])?;
    let manifest = Manifest::load(folder.path())?;
    let (grid, again) = read_stack(folder.path(), &Control::none())?;
    assert_eq!(grid.size(), manifest.size);
    assert!(manifest == again);
    Ok(())
}

/// A GCVF.
pub fn gcvf(bytes: &[u8]) -> Outcome {
    let (_folder, path) = file(bytes, "a.gcvf")?;
    let (grid, config) = archive::read(path, &Control::none())?;
    let [width, height, layers] = grid.size();
    assert!(config.slice_size == [width, height] && config.slices == layers);
    Ok(())
}

/// An NRRD volume.
pub fn nrrd(bytes: &[u8]) -> Outcome {
    let (_folder, path) = file(bytes, "a.nrrd")?;
    volume::read(path, &Control::none())?;
    Ok(())
}

/// A NumPy array.
pub fn npy(bytes: &[u8]) -> Outcome {
    let (_folder, path) = file(bytes, "a.npy")?;
    array::read(path, Pitch::j750(), [0.0; 3], &Control::none())?;
    Ok(())
}
