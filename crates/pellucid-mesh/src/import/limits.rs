//! How large a model the importer accepts.

/// Bounds on what a model may ask for, checked before anything is read or allocated.
///
/// Peak memory of an import is about the size of the files read, 1 KiB an item,
/// 250 bytes a vertex, 80 bytes a triangle, `texture_bytes`, and 16 bytes a pixel of the largest
/// texture, none of it more than these limits allow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct ImportLimits {
    /// Bytes of the model file, and of all files and data URIs it refers to together, or of all parts of
    /// a 3MF package that are unpacked. 1 GiB.
    pub file_bytes: u64,
    /// Objects and arrays in the JSON of a glTF; objects, components, items and resources of a 3MF, each
    /// instance counted; materials of an OBJ's libraries. 1,048,576.
    pub items: u64,
    /// Members and elements in the JSON. 16,777,216.
    pub json_values: u64,
    /// Nodes of a glTF from a root to its deepest descendant, components of a 3MF within each other. 1024.
    pub nesting: u32,
    /// Vertices in the file, and in the model with each instance of a mesh counted. 33,554,432.
    pub vertices: u64,
    /// Triangles in the model, each instance of a mesh counted. 33,554,432.
    pub triangles: u64,
    /// Vertices times active morph targets, plus vertices times joint influences. 2^30.
    pub deformations: u64,
    /// Longer side of a texture in pixels. 16,384.
    pub texture_edge: u32,
    /// Pixels of one texture. 134,217,728 (16,384 x 8,192).
    pub texture_pixels: u64,
    /// Bytes of all decoded textures with their mip chains. 2 GiB.
    pub texture_bytes: u64,
}

impl Default for ImportLimits {
    fn default() -> Self {
        Self {
            file_bytes: 1 << 30,
            items: 1 << 20,
            json_values: 1 << 24,
            nesting: 1024,
            vertices: 1 << 25,
            triangles: 1 << 25,
            deformations: 1 << 30,
            texture_edge: 1 << 14,
            texture_pixels: 1 << 27,
            texture_bytes: 2 << 30,
        }
    }
}
