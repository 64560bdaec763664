//! Which glTF extensions are read, which may be left out, and which stop the import.

use super::schema::{Primitive, Root};
use crate::MeshError;
use crate::import::source::{Source, quoted};

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Extensions that are read, or that change nothing of what a print shows.
///
/// Those that compress geometry or textures are not here: a file that requires one is refused
/// where its data is used, so that the error can name the object.
const HARMLESS: [&str; 11] = [
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_xmp_json_ld",
    "EXT_lights_image_based",
    "EXT_lights_ies",
    "MSFT_lod",
    "AGI_articulations",
    "CESIUM_primitive_outline",
];

/// WebP textures, read with the feature `webp`.
pub(super) const WEBP: &str = "EXT_texture_webp";

/// Texture formats other than PNG and JPEG.
const TEXTURE_FORMATS: [&str; 5] =
    ["KHR_texture_basisu", WEBP, "EXT_texture_avif", "MSFT_texture_dds", "EXT_texture_astc"];

pub(super) const UNCOMPRESSED: &str =
    "export it without mesh compression, or decompress it, for example with `gltf-transform copy`";

/// Refuses a file that requires an extension this importer does not know.
pub(super) fn check_required(source: &Source, root: &Root) -> Result<(), MeshError> {
    for name in &root.extensions_required {
        let name = name.as_str();
        // Every material extension adds to the look (gloss, coat, glow) on top of a base colour.
        let known = HARMLESS.contains(&name)
            || name.starts_with("KHR_materials_")
            || name.starts_with("EXT_materials_")
            || TEXTURE_FORMATS.contains(&name)
            || MESHOPT.contains(&name)
            || name == DRACO;
        if !known {
            return Err(source.unsupported(
                format!("extensionsRequired {}", quoted(name)),
                "the file cannot be read without this extension",
                "export the model without it",
            ));
        }
    }
    Ok(())
}

/// Refuses a primitive whose data is Draco-compressed.
pub(super) fn refuse_compressed_primitive(
    source: &Source,
    object: &str,
    primitive: &Primitive,
) -> Result<(), MeshError> {
    match primitive.extensions.draco {
        Some(_) => Err(source.unsupported(object, format!("Draco compression ({DRACO})"), UNCOMPRESSED)),
        None => Ok(()),
    }
}

/// Refuses a buffer view whose data is meshopt-compressed.
#[cfg(not(feature = "meshopt"))]
pub(super) fn refuse_compressed_view(source: &Source, object: &str) -> MeshError {
    let reason = format!("meshopt compression ({}), which this build leaves out", MESHOPT[0]);
    source.unsupported(object, reason, UNCOMPRESSED)
}

/// The error for an accessor without data: a compression extension that the file lists anywhere
/// is the likely reason.
pub(super) fn no_data(source: &Source, root: &Root, object: &str) -> MeshError {
    let listed = root.extensions_used.iter().chain(&root.extensions_required).map(String::as_str);
    match listed.into_iter().find(|name| *name == DRACO || MESHOPT.contains(name)) {
        Some(name) => source.unsupported(
            object,
            format!("it has no data of its own; the file lists compression ({name})"),
            UNCOMPRESSED,
        ),
        None => source.invalid(
            object,
            "it has neither a buffer view nor sparse values",
            "the file holds no geometry there; export it again",
        ),
    }
}

/// The error for a texture without a PNG or JPEG source.
pub(super) fn no_plain_source<'a>(
    source: &Source,
    object: &str,
    mut names: impl Iterator<Item = &'a String>,
) -> MeshError {
    const REMEDY: &str = "export the model with its textures as PNG or JPEG";
    match names.find(|n| TEXTURE_FORMATS.contains(&n.as_str())) {
        Some(name) => source.unsupported(object, format!("its only image is of the format {name}"), REMEDY),
        None => source.invalid(object, "it has no image", REMEDY),
    }
}
