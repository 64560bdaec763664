//! Binary STL: 80 bytes of header, a count, and 50 bytes a triangle.

use super::{BINARY_START, BINARY_STRIDE, REEXPORT, Solid, binary_triangles};
use crate::MeshError;

pub(super) fn read(solid: &mut Solid, bytes: &[u8]) -> Result<(), MeshError> {
    let source = solid.parts.source;
    let Some(count) = binary_triangles(bytes) else {
        let reason = format!("it has {} bytes, an STL at least {BINARY_START}", bytes.len());
        return Err(source.invalid("file", reason, REEXPORT));
    };
    let body = &bytes[BINARY_START as usize..];
    let there = body.len() as u64 / BINARY_STRIDE;
    if there < count {
        let reason = format!("it claims {count} triangles, {there} are there");
        return Err(source.invalid("header", reason, REEXPORT));
    }
    if body.len() as u64 > BINARY_STRIDE * count {
        source.note("file", "what follows the last triangle is left out");
    }
    let mut attributes = false;
    let (records, _) = body.as_chunks::<{ BINARY_STRIDE as usize }>();
    for (number, record) in (0..count).zip(records) {
        let object = || format!("triangle {number}");
        // The normal comes first.
        let corners: [[f32; 3]; 3] = std::array::from_fn(|corner| {
            std::array::from_fn(|axis| {
                let at = 12 + 12 * corner + 4 * axis;
                f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
            })
        });
        if !corners.as_flattened().iter().all(|c| c.is_finite()) {
            let reason = "a coordinate is NaN or infinite";
            return Err(source.invalid(object(), reason, "repair the mesh and export it again"));
        }
        attributes |= record[48..] != [0; 2];
        solid.triangle(object, corners)?;
    }
    if attributes {
        let text = "its attribute bytes, where some programs keep colours, are left out; colours come from \
                    glTF, OBJ, 3MF or PLY";
        source.note("triangles", text);
    }
    Ok(())
}
