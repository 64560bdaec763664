//! Models, textures and colour profiles.

use std::fs;
use std::path::Path;

use pellucid::mesh::import::IccProfile;
use pellucid::mesh::{ImportLimits, ImportOptions, Model, SpectralImage};

use super::{Outcome, folder};

/// Room for what a few kilobytes may ask for, far below what a fuzzer's process may take.
const LIMITS: ImportLimits = ImportLimits {
    file_bytes: 1 << 20,
    items: 1 << 10,
    json_values: 1 << 20,
    nesting: 64,
    vertices: 100_000,
    triangles: 100_000,
    deformations: 1_000_000,
    texture_edge: 4096,
    texture_pixels: 1 << 20,
    texture_bytes: 16 << 20,
};

/// One textured triangle.
const TRIANGLE: &str =
    "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
const MATERIAL: &str = "newmtl m\nmap_Kd t.png\n";

fn import(name: &str, bytes: &[u8], base: Option<&Path>) -> Outcome {
    let model = ImportOptions::from(LIMITS).import_slice(name, bytes, base)?;
    check(&model);
    Ok(())
}

/// What every model that was taken keeps to.
fn check(model: &Model) {
    assert!(
        model.triangles().len() as u64 <= LIMITS.triangles
            && model.vertices().len() as u64 <= LIMITS.vertices
    );
    for t in 0..model.triangles().len() as u32 {
        assert!(model.corners_m(t).iter().flatten().all(|c| c.is_finite()), "triangle {t} is not finite");
        let color = model.color_at(t, [0.2, 0.3, 0.5], 0.0);
        assert!(color.iter().all(|c| c.is_finite()), "triangle {t} has the colour {color:?}");
    }
}

/// glTF, binary or JSON, with all data within.
pub fn gltf(bytes: &[u8]) -> Outcome {
    import("a.glb", bytes, None)
}

/// 3MF.
pub fn threemf(bytes: &[u8]) -> Outcome {
    import("a.3mf", bytes, None)
}

/// PLY, beside a texture `t.png`.
pub fn ply(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    fs::write(folder.path().join("t.png"), super::slices::first_slice())?;
    import("a.ply", bytes, Some(folder.path()))
}

/// STL, binary or text.
pub fn stl(bytes: &[u8]) -> Outcome {
    import("a.stl", bytes, None)
}

/// OBJ; after a zero byte the material library `m.mtl`, and after another one the texture `t.png`.
pub fn obj(bytes: &[u8]) -> Outcome {
    let mut parts = bytes.splitn(3, |&b| b == 0);
    let model = parts.next().unwrap_or_default();
    let folder = folder()?;
    for (name, part) in ["m.mtl", "t.png"].iter().zip(parts) {
        fs::write(folder.path().join(name), part)?;
    }
    import("a.obj", model, Some(folder.path()))
}

/// A texture: PNG, JPEG or WebP.
pub fn picture(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    fs::write(folder.path().join("m.mtl"), MATERIAL)?;
    fs::write(folder.path().join("t.png"), bytes)?;
    import("a.obj", TRIANGLE.as_bytes(), Some(folder.path()))
}

/// A spectral image in OpenEXR.
pub fn spectral(bytes: &[u8]) -> Outcome {
    let image = SpectralImage::from_exr("a.exr", bytes, &LIMITS)?;
    assert!(
        image.wavelengths_nm().is_sorted() && image.size().iter().all(|&side| side <= LIMITS.texture_edge)
    );
    Ok(())
}

/// An ICC profile, by which a texture is read.
pub fn icc(bytes: &[u8]) -> Outcome {
    let icc = Some(IccProfile::from_bytes("a.icc", bytes)?);
    let folder = folder()?;
    fs::write(folder.path().join("m.mtl"), MATERIAL)?;
    fs::write(folder.path().join("t.png"), super::slices::first_slice())?;
    let options = ImportOptions { icc, ..ImportOptions::from(LIMITS) };
    check(&options.import_slice("a.obj", TRIANGLE.as_bytes(), Some(folder.path()))?);
    Ok(())
}
