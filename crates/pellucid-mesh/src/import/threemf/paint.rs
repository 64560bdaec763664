//! What a corner of a triangle looks like: a property resolved to colour and texture.

use super::part::{Part, Property};
use super::resources::{Blend, Color, Group};
use crate::import::source::Source;

/// Multi-properties within multi-properties at most; the format allows none.
const DEEPEST: u32 = 4;

/// A colour, and the texture that it multiplies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Paint {
    pub rgb: [f32; 3],
    /// Opacity, 0 to 1, beside that of the texture.
    pub alpha: f32,
    /// A texture resource and coordinates in it, v up.
    pub texture: Option<(u32, [f32; 2])>,
}

/// A property of a part; the error is the reason.
pub(super) fn resolve(source: &Source, part: &Part, property: Property) -> Result<Paint, String> {
    layered(source, part, property, 0)
}

fn layered(source: &Source, part: &Part, (group, index): Property, depth: u32) -> Result<Paint, String> {
    let missing = || format!("property {index} of group {group} does not exist");
    let at = index as usize;
    match part.groups.get(&group) {
        Some(Group::Base(colors) | Group::Colors(colors)) => {
            let Color { rgb, alpha } = *colors.get(at).ok_or_else(missing)?;
            Ok(Paint { rgb, alpha, texture: None })
        }
        Some(Group::Coords { texture, coords }) => {
            let uv = *coords.get(at).ok_or_else(missing)?;
            Ok(Paint { rgb: Color::WHITE.rgb, alpha: 1.0, texture: Some((*texture, uv)) })
        }
        Some(Group::Multi { layers, entries }) if depth < DEEPEST => {
            let start = at.checked_mul(layers.len()).ok_or_else(missing)?;
            let indices = entries.get(start..).and_then(|e| e.get(..layers.len())).ok_or_else(missing)?;
            let mut result = None;
            for (&(group, blend), &index) in layers.iter().zip(indices) {
                let upper = layered(source, part, (group, index), depth + 1)?;
                result = Some(match result {
                    None => upper,
                    Some(lower) => over(source, lower, upper, blend),
                });
            }
            result.ok_or_else(missing)
        }
        Some(Group::Multi { .. }) => Err(format!("group {group} is nested too deep")),
        None => Err(format!("property group {group} does not exist")),
    }
}

/// A layer over those below it.
fn over(source: &Source, lower: Paint, upper: Paint, blend: Blend) -> Paint {
    let alpha = upper.alpha;
    const OBJECT: &str = "multiproperties";
    match (blend, lower.texture, upper.texture) {
        (Blend::Mix, None, None) => {
            let mix = |c: usize| lower.rgb[c] + alpha * (upper.rgb[c] - lower.rgb[c]);
            let both = lower.alpha + alpha * (1.0 - lower.alpha);
            Paint { rgb: std::array::from_fn(mix), alpha: both, texture: None }
        }
        (Blend::Mix, _, Some(_)) => {
            source.note(OBJECT, "a texture mixed over other layers hides them: its opacity is ignored");
            upper
        }
        (Blend::Mix, Some(_), None) => {
            if alpha > 0.0 && alpha < 1.0 {
                source.note(OBJECT, "a translucent colour over a texture is all or nothing, by its opacity");
            }
            if alpha < 0.5 { lower } else { Paint { alpha: lower.alpha.max(alpha), ..upper } }
        }
        (Blend::Multiply, below, above) => {
            if below.is_some() && above.is_some() {
                source.note(OBJECT, "of two textures multiplied the lower alone is taken");
            }
            let rgb = std::array::from_fn(|c| lower.rgb[c] * upper.rgb[c]);
            Paint { rgb, alpha: lower.alpha * alpha, texture: below.or(above) }
        }
    }
}
