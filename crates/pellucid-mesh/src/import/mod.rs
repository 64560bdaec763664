//! glTF 2.0 import.
//!
//! `.glb`, and `.gltf` with data URIs or files beside it. Read: node transforms, all meshes of the
//! default scene, triangle lists, strips and fans, every index and attribute type, sparse
//! accessors, `KHR_mesh_quantization`, base-colour factor, texture and `COLOR_0`,
//! `KHR_texture_transform`, samplers, the diffuse colour of
//! `KHR_materials_pbrSpecularGlossiness`, `KHR_node_visibility`, skins at rest, and morph targets
//! of positions, coordinates and colours at their default weights.
//!
//! Left out with a [note](crate::Model::notes): animations, points and lines, transparency
//! (prints are opaque), emission (prints do not glow), what a scale of 0 collapses, and inverted
//! hulls: outlines drawn by a single-sided shell around a body that faces inwards. Without a default
//! scene the only scene is taken, or else all root nodes. A material's other extensions (gloss, coat)
//! are ignored.
//!
//! Refused with the object and a remedy: Draco and meshopt compression, other required
//! extensions, textures other than PNG and JPEG, a texture without coordinates, URIs that leave
//! the model's folder, anything past [`ImportLimits`], and every reference or value out of range.

mod accessor;
mod buffers;
mod container;
mod extensions;
mod limits;
mod materials;
mod nodes;
mod picture;
mod primitive;
mod schema;
mod skin;
mod source;
mod uri;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

pub use limits::ImportLimits;

use crate::hull::without_hulls;
use crate::{MeshError, Model};
use buffers::Buffers;
use materials::Materials;
use primitive::{Assembly, Placement};
use source::{REEXPORT, Source, label};

/// Imports a model file; files it refers to must lie in its folder.
///
/// # Errors
/// [`MeshError::Io`] if a file cannot be read, [`MeshError::Invalid`] if the model breaks glTF's
/// rules, [`MeshError::Unsupported`] if it needs something this importer does not handle or
/// passes a limit.
pub fn import_path(path: impl AsRef<Path>, limits: &ImportLimits) -> Result<Model, MeshError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let folder = path.parent();
    let bytes = uri::read_bounded(&Source::new(&name, folder, limits), "file", path, limits.file_bytes)?;
    import_slice(&name, &bytes, folder, limits)
}

/// Imports a model from memory; `name` is what errors call it, `base_dir` the folder that holds
/// the files it refers to (none: only data URIs and the GLB's own data are allowed).
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
    let source = Source::new(name, base_dir, limits);
    let container = container::open(&source, bytes)?;
    let root = container::parse(&source, container.json)?;
    extensions::check_required(&source, &root)?;
    if !root.animations.is_empty() {
        source.note("animations", "they are ignored; the model is imported at rest");
    }
    let buffers = Buffers::new(&source, &root, container.binary);
    let model = assemble(&buffers)?;
    drop(buffers);
    Ok(model.with_notes(source.into_notes()))
}

fn assemble(buffers: &Buffers) -> Result<Model, MeshError> {
    let (source, root) = (buffers.source(), buffers.root());
    let nodes = nodes::resolve(source, root)?;
    let mut materials = Materials::new(buffers);
    let mut assembly = Assembly::default();
    let mut skins = BTreeMap::new();
    for &index in &nodes.in_scene {
        let node = &root.nodes[index];
        let Some(mesh_index) = node.mesh else { continue };
        let Some(mesh) = root.meshes.get(mesh_index) else {
            return Err(source.invalid(
                label("node", index, node.name.as_deref()),
                format!("mesh {mesh_index} does not exist, there are {}", root.meshes.len()),
                REEXPORT,
            ));
        };
        let joints = match node.skin {
            Some(skin) => {
                let matrices = match skins.entry(skin) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(new) => new.insert(skin::joint_matrices(buffers, &nodes, skin)?),
                };
                Some(matrices.as_slice())
            }
            None => None,
        };
        if joints.is_none() && nodes::collapses(&nodes.world[index]) {
            let text = "its scale makes it a line or a point, so it is left out";
            source.note(label("node", index, node.name.as_deref()), text);
            continue;
        }
        let placement = Placement {
            world: nodes.world[index],
            weights: node.weights.as_deref().unwrap_or(&mesh.weights),
            joints,
        };
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let object = format!("{}, primitive {k}", label("mesh", mesh_index, mesh.name.as_deref()));
            let material = || materials.resolve(&object, primitive.material);
            assembly.add(buffers, &object, primitive, &placement, material)?;
        }
    }
    if assembly.triangles.is_empty() {
        return Err(source.invalid(
            "model",
            "its scene has no triangles (points, lines and empty meshes do not count)",
            "export a mesh with faces",
        ));
    }
    let model = Model::new(
        source.file,
        assembly.vertices,
        assembly.triangles,
        materials.base_colors,
        materials.textures,
    )?;
    note_strays(source, &model);
    let (model, notes) = without_hulls(model);
    notes.into_iter().for_each(|note| source.note(note.object, note.text));
    Ok(model)
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
