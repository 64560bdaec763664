//! glTF 2.0: `.glb`, and `.gltf` with data URIs or files beside it.
//!
//! Read: node transforms, all meshes of the default scene, triangle lists, strips and fans, every
//! index and attribute type, sparse accessors, `KHR_mesh_quantization`, meshopt compression
//! (feature `meshopt`), base-colour factor, texture and `COLOR_0`, `KHR_texture_transform`, samplers,
//! `EXT_texture_webp` (feature `webp`), the diffuse colour of `KHR_materials_pbrSpecularGlossiness`,
//! `KHR_node_visibility`, skins at rest, and morph targets of positions, coordinates and colours at their
//! default weights.
//!
//! Left out with a [note](crate::Model::notes): animations, points and lines, transparency
//! (prints are opaque; with [`ImportOptions::opacity`](crate::ImportOptions::opacity) the alpha of materials whose
//! `alphaMode` is `MASK` or `BLEND` counts), emission (prints do not glow), what a scale of 0 collapses, and inverted
//! hulls: outlines drawn by a single-sided shell around a body that faces inwards. Without a default
//! scene the only scene is taken, or else all root nodes. A material's other extensions (gloss, coat)
//! are ignored.
//!
//! Refused with the object and a remedy: Draco compression, and meshopt's without the feature `meshopt`,
//! other required extensions, textures of other formats, and a texture without coordinates.

mod accessor;
mod buffers;
mod container;
mod extensions;
mod images;
mod materials;
#[cfg(feature = "meshopt")]
mod meshopt;
mod nodes;
mod primitive;
mod schema;
mod skin;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::source::{Source, label};
use super::{Format, ReadAs};
use crate::{MeshError, Model};
use buffers::Buffers;
use materials::Materials;
use primitive::{Assembly, Placement};

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the file is damaged or not valid glTF 2.0; export it again";

/// Reads a model.
pub(super) fn read(source: &Source, bytes: &[u8]) -> Result<Model, MeshError> {
    let container = container::open(source, bytes)?;
    let root = container::parse(source, container.json)?;
    extensions::check_required(source, &root)?;
    if !root.animations.is_empty() {
        source.note("animations", "they are ignored; the model is imported at rest");
    }
    assemble(&Buffers::new(source, &root, container.binary))
}

fn read_as(source: &Source) -> ReadAs {
    source.read_as(Format::Gltf, None)
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
    let model = match source.options.opacity {
        true => model.with_opacity(materials.opacity)?,
        false => model,
    };
    Ok(model.with_read_as(read_as(source)))
}
