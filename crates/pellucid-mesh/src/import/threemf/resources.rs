//! Property groups: base materials, colours, textures, composites and multi-properties.

use super::REEXPORT;
use super::part::{Part, Reader, id};
use super::xml::{Space, Tag, Xml};
use crate::MeshError;
use crate::import::parts;
use crate::import::source::quoted;
use crate::texture::{Filter, Sampler, Wrap};

/// A colour in linear light, and its opacity in 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Color {
    pub rgb: [f32; 3],
    pub alpha: f32,
}

impl Color {
    pub const WHITE: Self = Self { rgb: [1.0; 3], alpha: 1.0 };

    /// `#RRGGBB` or `#RRGGBBAA`, sRGB.
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.trim().strip_prefix('#')?;
        if !matches!(digits.len(), 6 | 8) || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let value = u32::from_str_radix(digits, 16).ok()?;
        let value = if digits.len() == 6 { value << 8 | 0xFF } else { value };
        let [r, g, b, a] = value.to_be_bytes().map(|byte| f64::from(byte) / 255.0);
        Some(Self { rgb: parts::linear([r, g, b]), alpha: a as f32 })
    }
}

/// How a layer of a multi-property lies over those below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Blend {
    Mix,
    Multiply,
}

pub(super) enum Group {
    /// Base materials: one a triangle.
    Base(Vec<Color>),
    /// Colours of corners.
    Colors(Vec<Color>),
    /// Coordinates in a texture, v up.
    Coords { texture: u32, coords: Vec<[f32; 2]> },
    /// Layers of other groups, and of each entry an index a layer.
    Multi { layers: Vec<(u32, Blend)>, entries: Vec<u32> },
}

pub(super) struct Texture2d {
    /// Its name in the package.
    pub path: String,
    pub sampler: Sampler,
}

/// Reads a resource other than an object, if it is a known one.
pub(super) fn read<'i>(
    reader: &mut Reader,
    xml: &mut Xml<'_, '_, 'i>,
    tag: &Tag<'i>,
    part: &mut Part,
) -> Result<bool, MeshError> {
    let kind = match (tag.space, tag.name()) {
        (Space::Core, "basematerials") => "basematerials",
        (Space::Materials, "colorgroup") => "colorgroup",
        (Space::Materials, "texture2d") => "texture2d",
        (Space::Materials, "texture2dgroup") => "texture2dgroup",
        (Space::Materials, "compositematerials") => "compositematerials",
        (Space::Materials, "multiproperties") => "multiproperties",
        _ => return Ok(false),
    };
    let label = format!("{}, {kind} {}", xml.part, quoted(&tag.text("id").unwrap_or_default()));
    reader.count_thing(&label)?;
    let source = reader.source;
    let invalid = |reason: &str| source.invalid(&label, reason, REEXPORT);
    let own = id(tag, "id").ok_or_else(|| invalid("its id is no number above 0"))?;
    let group = match kind {
        "texture2d" => {
            let path = tag.text("path").ok_or_else(|| invalid("it has no path"))?;
            if part.textures.insert(own, Texture2d { path, sampler: sampler(tag) }).is_some() {
                return Err(invalid("there is another texture of that id"));
            }
            return Ok(false);
        }
        "basematerials" => Group::Base(colors(reader, xml, &label, "base", "displaycolor")?),
        "colorgroup" => Group::Colors(colors(reader, xml, &label, "color", "color")?),
        "texture2dgroup" => {
            let texture = id(tag, "texid").ok_or_else(|| invalid("its texid is no number above 0"))?;
            Group::Coords { texture, coords: coords(reader, xml, &label)? }
        }
        "compositematerials" => composites(reader, xml, tag, &label, part)?,
        _ => multi(reader, xml, tag, &label)?,
    };
    if part.groups.insert(own, group).is_some() {
        return Err(invalid("there is another property group of that id"));
    }
    Ok(true)
}

impl Reader<'_, '_> {
    /// One more entry of a property group.
    fn count_property(&mut self, label: &str) -> Result<(), MeshError> {
        parts::admit_vertex(self.source, self.counts.properties, || label.to_owned())?;
        self.counts.properties += 1;
        Ok(())
    }
}

fn sampler(tag: &Tag) -> Sampler {
    let wrap = |name: &str| match tag.text(name).as_deref() {
        Some("mirror") => Wrap::Mirrored,
        // Outside a texture of the style `none` nothing is defined that could be printed.
        Some("clamp" | "none") => Wrap::Clamp,
        _ => Wrap::Repeat,
    };
    let filter = match tag.text("filter").as_deref() {
        Some("nearest") => Filter::Nearest,
        _ => Filter::Linear,
    };
    let (wrap_u, wrap_v) = (wrap("tilestyleu"), wrap("tilestylev"));
    Sampler { wrap_u, wrap_v, magnify: filter, minify: filter, ..Sampler::default() }
}

fn colors(
    reader: &mut Reader,
    xml: &mut Xml,
    label: &str,
    element: &str,
    attribute: &str,
) -> Result<Vec<Color>, MeshError> {
    let mut colors = Vec::new();
    xml.children(|_, tag| {
        if tag.name() == element {
            reader.count_property(label)?;
            let text = tag.text(attribute).unwrap_or_default();
            let color = Color::parse(&text).ok_or_else(|| {
                let object = format!("{label}, {element} {}", colors.len());
                reader.source.invalid(object, format!("{} is no colour #RRGGBB", quoted(&text)), REEXPORT)
            })?;
            if color.alpha < 1.0 && !reader.source.options.opacity {
                reader.source.note(label, "its transparency is ignored: prints are opaque");
            }
            colors.push(color);
        }
        Ok(false)
    })?;
    Ok(colors)
}

fn coords(reader: &mut Reader, xml: &mut Xml, label: &str) -> Result<Vec<[f32; 2]>, MeshError> {
    let mut coords = Vec::new();
    xml.children(|_, tag| {
        if tag.name() == "tex2coord" {
            reader.count_property(label)?;
            let value = |name: &str| tag.text(name)?.trim().parse().ok().filter(|v: &f32| v.is_finite());
            let (Some(u), Some(v)) = (value("u"), value("v")) else {
                let object = format!("{label}, tex2coord {}", coords.len());
                return Err(reader.source.invalid(object, "u and v are not two finite numbers", REEXPORT));
            };
            coords.push([u, v]);
        }
        Ok(false)
    })?;
    Ok(coords)
}

/// Composites as colours: the mean of their base materials by their shares.
fn composites(
    reader: &mut Reader,
    xml: &mut Xml,
    tag: &Tag,
    label: &str,
    part: &Part,
) -> Result<Group, MeshError> {
    let source = reader.source;
    let invalid = |reason: String| source.invalid(label, reason, REEXPORT);
    let Some(Group::Base(base)) = id(tag, "matid").and_then(|id| part.groups.get(&id)) else {
        return Err(invalid("its matid is no group of base materials before it".into()));
    };
    let numbers = |text: String| -> Option<Vec<f64>> {
        text.split_ascii_whitespace().map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect()
    };
    let indices: Option<Vec<&Color>> = tag
        .text("matindices")
        .and_then(numbers)
        .and_then(|list| list.into_iter().map(|i| base.get(i as usize).filter(|_| i >= 0.0)).collect());
    let indices = indices.ok_or_else(|| invalid("its matindices are no indices of base materials".into()))?;
    let mut colors = Vec::new();
    xml.children(|_, tag| {
        if tag.name() == "composite" {
            reader.count_property(label)?;
            let shares = tag.text("values").and_then(numbers).unwrap_or_default();
            let shares: Vec<f64> = shares.into_iter().map(|share| share.max(0.0)).collect();
            let sum: f64 = shares.iter().take(indices.len()).sum();
            if sum.is_nan() || sum <= 0.0 || sum.is_infinite() {
                let object = format!("{label}, composite {}", colors.len());
                return Err(source.invalid(object, "its values are no shares", REEXPORT));
            }
            let mean = |c: usize| -> f64 {
                shares.iter().zip(&indices).map(|(s, i)| s / sum * f64::from(i.rgb[c])).sum()
            };
            let rgb: [f64; 3] = std::array::from_fn(mean);
            let alpha: f64 = shares.iter().zip(&indices).map(|(s, i)| s / sum * f64::from(i.alpha)).sum();
            colors.push(Color { rgb: rgb.map(|c| c as f32), alpha: alpha as f32 });
        }
        Ok(false)
    })?;
    Ok(Group::Colors(colors))
}

fn multi(reader: &mut Reader, xml: &mut Xml, tag: &Tag, label: &str) -> Result<Group, MeshError> {
    let source = reader.source;
    let numbers = |text: String| -> Option<Vec<u32>> {
        text.split_ascii_whitespace().map(|word| word.parse().ok()).collect()
    };
    let groups = tag.text("pids").and_then(numbers).filter(|groups| (1..=64).contains(&groups.len()));
    let Some(groups) = groups else {
        return Err(source.invalid(label, "its pids are not 1 to 64 property groups", REEXPORT));
    };
    let methods = tag.text("blendmethods").unwrap_or_default();
    // The lowest layer has none.
    let mut methods = methods.split_ascii_whitespace();
    let layers: Vec<(u32, Blend)> = groups
        .into_iter()
        .enumerate()
        .map(|(k, group)| match (k > 0).then(|| methods.next()).flatten() {
            Some("multiply") => (group, Blend::Multiply),
            _ => (group, Blend::Mix),
        })
        .collect();
    let mut entries = Vec::new();
    xml.children(|_, tag| {
        if tag.name() == "multi" {
            let indices = tag.text("pindices").and_then(numbers).ok_or_else(|| {
                let object = format!("{label}, multi {}", entries.len() / layers.len());
                source.invalid(object, "its pindices are no indices", REEXPORT)
            })?;
            for layer in 0..layers.len() {
                reader.count_property(label)?;
                // Missing ones are 0.
                entries.push(indices.get(layer).copied().unwrap_or(0));
            }
        }
        Ok(false)
    })?;
    Ok(Group::Multi { layers, entries })
}
