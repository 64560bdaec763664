//! ASCII STL: `facet normal`, `outer loop`, three times `vertex`, `endloop`, `endfacet`.

use super::{REEXPORT, Solid, text};
use crate::MeshError;
use crate::import::source::quoted;

pub(super) fn read(solid: &mut Solid, bytes: &[u8]) -> Result<(), MeshError> {
    let source = solid.parts.source;
    let mut corners: Vec<[f32; 3]> = Vec::with_capacity(3);
    let (mut last, mut open) = (0, false);
    for (line, content) in text::Lines::new(bytes) {
        last = line;
        let object = || format!("line {line}");
        let mut words = text::words(content);
        let Some(word) = words.next() else { continue };
        match word.to_ascii_lowercase().as_slice() {
            // A name may follow, and a file may hold several.
            b"solid" | b"endsolid" | b"facet" | b"endfacet" => {}
            b"outer" => {
                corners.clear();
                open = true;
            }
            b"vertex" if open => {
                let mut position = [0.0f32; 3];
                for c in &mut position {
                    let value = words.next().and_then(text::number).map(|value| value as f32);
                    *c = value.filter(|value| value.is_finite()).ok_or_else(|| {
                        source.invalid(object(), "a vertex needs three finite numbers", REEXPORT)
                    })?;
                }
                if corners.len() == 3 {
                    let reason = "a loop of more than three vertices";
                    return Err(source.invalid(object(), reason, "triangulate the mesh"));
                }
                corners.push(position);
            }
            b"endloop" if open => {
                let Ok(triangle) = <[[f32; 3]; 3]>::try_from(corners.as_slice()) else {
                    let reason = format!("the loop has {} vertices, not three", corners.len());
                    return Err(source.invalid(object(), reason, REEXPORT));
                };
                solid.triangle(object, triangle)?;
                open = false;
            }
            _ => {
                let reason = format!("{} is out of place in an STL", quoted(&text::string(word)));
                return Err(source.invalid(object(), reason, REEXPORT));
            }
        }
    }
    if open {
        return Err(source.invalid(format!("line {last}"), "the file ends within a facet", REEXPORT));
    }
    Ok(())
}
