//! PLY, the Stanford polygon format: ASCII, and binary in both byte orders.
//!
//! Read: positions of any scalar type; colours `red`, `green`, `blue` (or `r`, `g`, `b`, or with
//! `diffuse_` before) of faces or vertices; texture coordinates of vertices (`s`, `t`; `u`, `v`;
//! `texture_u`, `texture_v`) or of corners (the list `texcoord`, with `texnumber`), for the textures that
//! `comment TextureFile` names; faces of any number of corners and triangle strips (`tristrips`).
//! Other elements and properties are passed over.
//!
//! A face's colour is the most detailed that the file gives: its texture, or else its own colour, or
//! else its vertices', or else [`ImportOptions::color`](crate::ImportOptions::color). Colours are sRGB,
//! 0 to 255 as bytes (and other integers of more than 16 bits), 0 to 65535 as 16 bits, 0 to 1 as
//! floats. Opacity (`alpha`, `a`, `diffuse_alpha`, the alpha of textures) is left out unless
//! [`ImportOptions::opacity`](crate::ImportOptions::opacity) asks for it.
//!
//! Nothing is allocated for what a header claims before that many rows are known to fit into the file.

mod body;
mod header;
mod mesh;

use super::format::without_mark;
use super::source::Source;
use crate::{MeshError, Model};
use body::{Body, Reading};
use header::Header;
use mesh::Mesh;

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the file is damaged or cut short; export it again";

/// Reads a model.
pub(super) fn read(source: &Source, bytes: &[u8]) -> Result<Model, MeshError> {
    let (header, rest) = Header::read(source, without_mark(bytes))?;
    let mut body = Body::new(header.encoding, rest, source.limits.triangles.saturating_add(2));
    let mut mesh = Mesh::new(source, &header.textures);
    for element in &header.elements {
        let least = body.least_bytes(element);
        if u128::from(element.count) * u128::from(least) > body.left() as u128 {
            let reason = format!(
                "it claims {} rows of {least} bytes or more, {} bytes are left",
                element.count,
                body.left()
            );
            return Err(source.invalid(format!("element {}", element.label()), reason, REEXPORT));
        }
        // Rows without properties take no bytes: there is nothing to read.
        let rows = if element.properties.is_empty() { 0 } else { element.count };
        let plan = mesh.plan(element)?;
        let mut row = plan.row(element);
        for number in 0..rows {
            let object = || format!("{} {number}", element.label());
            body.row(element, &mut row).map_err(|failure| match failure {
                Reading::Damaged(reason) => source.invalid(object(), reason, REEXPORT),
                Reading::TooLong(reason) => {
                    source.unsupported(object(), reason, "simplify it or raise ImportLimits::triangles")
                }
            })?;
            mesh.add(&plan, number, &row)?;
        }
    }
    mesh.finish()
}
