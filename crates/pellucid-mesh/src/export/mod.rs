//! Textured meshes as files: GLB, OBJ with MTL and PNG, 3MF.

mod glb;
mod obj;
#[cfg(feature = "3mf")]
mod threemf;

use std::io;
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use pellucid_core::FileError;
use pellucid_core::files::write_whole_bytes;

use crate::bake::TexturedMesh;
use crate::import::Format;

/// What a textured mesh is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum MeshFormat {
    /// glTF 2.0 in one file, in metres, +Y up.
    Glb,
    /// Wavefront OBJ with an MTL file and a PNG beside it, in millimetres, +Y up.
    Obj,
    /// 3MF, in millimetres, +Z up (cargo feature `3mf`).
    #[cfg_attr(feature = "serde", serde(rename = "3mf"))]
    ThreeMf,
}

impl MeshFormat {
    /// Every format, also those that this build cannot write.
    pub const ALL: [Self; 3] = [Self::Glb, Self::Obj, Self::ThreeMf];

    /// Its name: `glb`, `obj` or `3mf`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Glb => "glb",
            Self::Obj => "obj",
            Self::ThreeMf => "3mf",
        }
    }

    /// The format that a model of `read` goes back to; GLB for those without textures.
    pub fn of(read: Format) -> Self {
        match read {
            Format::Obj => Self::Obj,
            Format::ThreeMf => Self::ThreeMf,
            _ => Self::Glb,
        }
    }

    /// Whether this build can write it.
    pub fn is_available(self) -> bool {
        self != Self::ThreeMf || cfg!(feature = "3mf")
    }

    /// The files that [`write`](fn@write) makes of a mesh called `stem`.
    pub fn files(self, stem: &str) -> Vec<String> {
        match self {
            Self::Obj => ["obj", "mtl", "png"].map(|end| format!("{stem}.{end}")).to_vec(),
            other => vec![format!("{stem}.{}", other.name())],
        }
    }
}

/// Writes a textured mesh into a folder as [`MeshFormat::files`] of `stem`, each whole or not at all. What is written
/// is read back by [`import_path`](crate::import_path) as the same mesh in print axes.
///
/// # Errors
/// [`FileError`]; of kind `Unsupported` for a format that this build cannot write.
pub fn write(mesh: &TexturedMesh, format: MeshFormat, folder: &Path, stem: &str) -> Result<(), FileError> {
    let first = folder.join(&format.files(stem)[0]);
    let failed = |error: io::Error| FileError::at("write", &first)(error);
    let png = png(mesh).map_err(failed)?;
    match format {
        MeshFormat::Glb => write_whole_bytes(&first, &glb::to_glb(mesh, &png).map_err(failed)?),
        MeshFormat::Obj => {
            write_whole_bytes(folder.join(format!("{stem}.png")), &png)?;
            write_whole_bytes(folder.join(format!("{stem}.mtl")), obj::to_mtl(stem).as_bytes())?;
            write_whole_bytes(&first, obj::to_obj(mesh, stem).as_bytes())
        }
        #[cfg(feature = "3mf")]
        MeshFormat::ThreeMf => write_whole_bytes(&first, &threemf::to_3mf(mesh, &png).map_err(failed)?),
        #[cfg(not(feature = "3mf"))]
        MeshFormat::ThreeMf => {
            let reason = "this build cannot write 3MF; build with the cargo feature 3mf";
            Err(failed(io::Error::new(io::ErrorKind::Unsupported, reason)))
        }
    }
}

fn png(mesh: &TexturedMesh) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(mesh.texels.as_flattened(), mesh.size[0], mesh.size[1], ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests;
