//! Model files into a [`Model`]: one folder a format, all under [`ImportLimits`].
//!
//! | format | cargo feature | length unit, up axis | colours |
//! | --- | --- | --- | --- |
//! | glTF 2.0 (`.glb`, `.gltf`) | - | m, y | base colour, texture, vertex colours |
//! | OBJ with MTL (`.obj`) | `obj` | mm, y | `map_Kd`, vertex colours, `Kd` |
//! | 3MF (`.3mf`) | `3mf` | its own, z | base materials, colour groups, textures, their mixtures |
//! | PLY (`.ply`) | `ply` | mm, z | texture, colours of faces and vertices |
//! | STL (`.stl`) | `stl` | mm, z | none: [`ImportOptions::color`] |
//!
//! The format is told by a file's content; its name decides only where the content does not. glTF and
//! 3MF say how long a unit is and which axis is up. The others do not: STL and OBJ for printing are in
//! millimetres by habit; what scans and prints stands on the xy plane, while OBJ comes from modelling
//! programs, which write y up. [`ImportOptions`] says otherwise, and [`Model::read_as`] what was taken.
//!
//! All is opaque, unless [`ImportOptions::opacity`] asks to keep what the file says of it.
//! Textures of glTF are sRGB, as it says. Those of the other formats are what the ICC profile says that they embed, or else
//! [`ImportOptions::icc`], or else sRGB (profiles: cargo feature `icc`).
//!
//! Refused with the place (line, element, object) and a remedy: file names and URIs that leave the
//! model's folder, textures other than PNG and JPEG (and WebP with the feature `webp`), numbers that
//! are not finite, anything past [`ImportLimits`], and every reference or value out of range. What is
//! left out is [noted](Model::notes).

mod format;
pub mod gltf;
mod icc;
mod limits;
#[cfg(feature = "obj")]
pub mod obj;
mod options;
#[cfg(any(feature = "obj", feature = "ply", feature = "stl", feature = "3mf"))]
mod parts;
mod picture;
#[cfg(feature = "ply")]
pub mod ply;
#[cfg(any(feature = "obj", feature = "ply"))]
mod polygon;
mod read_as;
mod source;
#[cfg(feature = "stl")]
pub mod stl;
#[cfg(any(feature = "obj", feature = "ply", feature = "stl"))]
mod text;
#[cfg(feature = "3mf")]
pub mod threemf;
mod uri;

use std::path::Path;

pub use format::Format;
pub use icc::IccProfile;
pub use limits::ImportLimits;
pub use options::ImportOptions;
pub use read_as::{LengthUnit, ReadAs, UpAxis};

use crate::hull::without_hulls;
use crate::{MeshError, Model};
use source::Source;

/// Imports a model file with [`ImportOptions`]' defaults; files it refers to must lie in its folder.
///
/// # Errors
/// [`MeshError::Io`] if a file cannot be read, [`MeshError::Invalid`] if the model breaks its format's
/// rules, [`MeshError::Unsupported`] if it needs something this importer does not handle or
/// passes a limit.
pub fn import_path(path: impl AsRef<Path>, limits: &ImportLimits) -> Result<Model, MeshError> {
    ImportOptions::from(*limits).import_path(path)
}

/// Imports a model from memory with [`ImportOptions`]' defaults; `name` is what errors call it,
/// `base_dir` the folder that holds the files it refers to (none: only data within the model is
/// allowed).
///
/// # Errors
/// As [`import_path`].
///
/// # Examples
/// ```
/// use pellucid_mesh::{ImportLimits, import_slice};
///
/// let gltf = br#"{
///     "asset": {"version": "2.0"},
///     "nodes": [{"mesh": 0}],
///     "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
///     "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1]}}],
///     "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
///     "bufferViews": [{"buffer": 0, "byteLength": 36}],
///     "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]
/// }"#;
/// let model = import_slice("triangle.gltf", gltf, None, &ImportLimits::default())?;
/// // glTF's third corner (0, 1, 0) points up, which is z in print axes.
/// assert_eq!(model.corners_m(0)[2], [0.0, 0.0, 1.0]);
/// assert_eq!(model.color_at(0, [0.2, 0.3, 0.5], 0.0), [1.0, 0.5, 0.0]);
///
/// let error = import_slice("triangle.gltf", &gltf[..99], None, &ImportLimits::default()).unwrap_err();
/// assert!(error.to_string().starts_with("triangle.gltf: JSON: EOF"));
/// # Ok::<(), pellucid_mesh::MeshError>(())
/// ```
pub fn import_slice(
    name: &str,
    bytes: &[u8],
    base_dir: Option<&Path>,
    limits: &ImportLimits,
) -> Result<Model, MeshError> {
    ImportOptions::from(*limits).import_slice(name, bytes, base_dir)
}

impl ImportOptions {
    /// Imports a model file; files it refers to must lie in its folder.
    ///
    /// # Errors
    /// As [`import_path`]; [`MeshError::Invalid`] too for a colour outside 0..1, [`MeshError::Unsupported`] for an ICC
    /// profile beside a glTF.
    pub fn import_path(&self, path: impl AsRef<Path>) -> Result<Model, MeshError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let folder = path.parent();
        let source = Source::new(&name, folder, self);
        let bytes = uri::read_bounded(&source, "file", path, self.limits.file_bytes)?;
        self.import_slice(&name, &bytes, folder)
    }

    /// Imports a model from memory, as [`import_slice`] does.
    ///
    /// # Errors
    /// As [`ImportOptions::import_path`].
    ///
    /// # Examples
    /// ```
    /// use pellucid_mesh::{ImportOptions, import::{LengthUnit, UpAxis}};
    ///
    /// let gltf = br#"{
    ///     "asset": {"version": "2.0"},
    ///     "nodes": [{"mesh": 0}],
    ///     "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    ///     "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
    ///     "bufferViews": [{"buffer": 0, "byteLength": 36}],
    ///     "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]
    /// }"#;
    /// // A file that breaks glTF's rules: written in inches, with z up.
    /// let options = ImportOptions { unit: Some(LengthUnit::Inch), up: Some(UpAxis::Z), ..Default::default() };
    /// let model = options.import_slice("triangle.gltf", gltf, None)?;
    /// assert_eq!(model.corners_m(0)[2], [0.0, 0.0254, 0.0]);
    /// assert_eq!(model.read_as().unwrap().unit, LengthUnit::Inch);
    /// # Ok::<(), pellucid_mesh::MeshError>(())
    /// ```
    pub fn import_slice(
        &self,
        name: &str,
        bytes: &[u8],
        base_dir: Option<&Path>,
    ) -> Result<Model, MeshError> {
        let source = Source::new(name, base_dir, self);
        self.check(&source)?;
        if bytes.len() as u64 > self.limits.file_bytes {
            return Err(source.unsupported(
                "file",
                format!("it has {} bytes, the limit is {}", bytes.len(), self.limits.file_bytes),
                "simplify the model or raise ImportLimits::file_bytes",
            ));
        }
        let format = Format::detect(&source, bytes)?;
        if self.icc.is_some() && format == Format::Gltf {
            return Err(source.unsupported(
                "ImportOptions::icc",
                "glTF says that textures are sRGB, whatever profile they have",
                "leave the profile out, or convert the textures to sRGB",
            ));
        }
        let model = match format {
            Format::Gltf => gltf::read(&source, bytes)?,
            #[cfg(feature = "obj")]
            Format::Obj => obj::read(&source, bytes)?,
            #[cfg(feature = "ply")]
            Format::Ply => ply::read(&source, bytes)?,
            #[cfg(feature = "stl")]
            Format::Stl => stl::read(&source, bytes)?,
            #[cfg(feature = "3mf")]
            Format::ThreeMf => threemf::read(&source, bytes)?,
            #[allow(unreachable_patterns, reason = "with every feature there is no other format")]
            other => {
                return Err(source.unsupported(
                    "file",
                    format!("it is a model of the format {}, which this build leaves out", other.label()),
                    format!("build pellucid-mesh with its feature `{}`, or give a .glb", other.name()),
                ));
            }
        };
        note_strays(&source, &model);
        let (model, notes) = without_hulls(model);
        notes.into_iter().for_each(|note| source.note(note.object, note.text));
        Ok(model.with_notes(source.into_notes()))
    }
}

/// Says that triangles without area do not count where they reach beyond the rest.
fn note_strays(source: &Source, model: &Model) {
    let [low, high] = model.bounds_m();
    let outside = |p: [f64; 3]| (0..3).any(|a| p[a] < low[a] || p[a] > high[a]);
    let strays = (0..model.triangles().len() as u32).filter(|&t| model.corners_m(t).into_iter().any(outside));
    let count = strays.count();
    if count > 0 {
        let text = format!("{count} triangles without area reach beyond the rest and are left out");
        source.note("model", text);
    }
}
