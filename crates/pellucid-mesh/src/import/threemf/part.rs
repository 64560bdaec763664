//! A model part: its unit, resources and build items.

use std::collections::BTreeMap;

use glam::DMat4;

use super::resources::{Group, Texture2d};
use super::xml::{Space, Tag, Token, Xml};
use super::{REEXPORT, matrix, resources, unit};
use crate::MeshError;
use crate::import::LengthUnit;
use crate::import::parts::{admit_triangle, admit_vertex};
use crate::import::source::{Source, quoted};

/// A property group and an index in it.
pub(super) type Property = (u32, u32);

pub(super) struct Triangle {
    pub vertices: [u32; 3],
    /// Its own property group; the object's without it.
    pub group: Option<u32>,
    /// Its own index a corner; the object's without them.
    pub indices: Option<[u32; 3]>,
}

/// An object within another, or an item of the build.
pub(super) struct Instance {
    /// The part that holds the object; this one without it.
    pub part: Option<String>,
    pub object: u32,
    pub transform: DMat4,
}

#[derive(Default)]
pub(super) struct Object {
    /// It is a part of the model, and no support or the like.
    pub printed: bool,
    pub property: Option<Property>,
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<Triangle>,
    pub components: Vec<Instance>,
}

#[derive(Default)]
pub(super) struct Part {
    pub name: String,
    pub unit: Option<LengthUnit>,
    pub groups: BTreeMap<u32, Group>,
    pub textures: BTreeMap<u32, Texture2d>,
    pub objects: BTreeMap<u32, Object>,
    pub items: Vec<Instance>,
}

/// What all parts together may hold.
#[derive(Default)]
pub(super) struct Counts {
    pub vertices: usize,
    pub triangles: usize,
    /// Entries of property groups.
    pub properties: usize,
    /// Objects, components, items, groups and textures.
    pub things: u64,
}

/// Reads parts, counting what they hold.
pub(super) struct Reader<'s, 'a> {
    pub source: &'s Source<'a>,
    pub counts: &'s mut Counts,
}

impl Reader<'_, '_> {
    pub fn part(&mut self, name: &str, bytes: &[u8]) -> Result<Part, MeshError> {
        let source = self.source;
        let mut xml = Xml::new(source, name, bytes)?;
        let mut part = Part { name: name.to_owned(), ..Part::default() };
        match xml.token()? {
            Token::Open(tag) if tag.is_core("model") => {
                check_required(source, name, &tag)?;
                if let Some(text) = tag.text("unit") {
                    let unknown =
                        || source.invalid(name, format!("unit {} does not exist", quoted(&text)), REEXPORT);
                    part.unit = Some(unit(&text).ok_or_else(unknown)?);
                }
            }
            _ => return Err(source.invalid(name, "it is no 3MF model (core, 2015/02)", REEXPORT)),
        }
        xml.children(|xml, tag| {
            if tag.is_core("resources") {
                xml.children(|xml, tag| self.resource(xml, tag, &mut part))?;
            } else if tag.is_core("build") {
                xml.children(|xml, tag| {
                    if tag.is_core("item") {
                        let item = self.instance(xml, tag, "build item")?;
                        part.items.push(item);
                    }
                    Ok(false)
                })?;
            } else {
                return Ok(false);
            }
            Ok(true)
        })?;
        Ok(part)
    }

    /// One more object, component or the like.
    pub fn count_thing(&mut self, object: &str) -> Result<(), MeshError> {
        self.counts.things += 1;
        if self.counts.things <= self.source.limits.items {
            return Ok(());
        }
        let reason = format!("there are more than {} objects and resources", self.source.limits.items);
        Err(self.source.unsupported(object, reason, "simplify the model or raise ImportLimits::items"))
    }

    fn resource<'i>(
        &mut self,
        xml: &mut Xml<'_, '_, 'i>,
        tag: &Tag<'i>,
        part: &mut Part,
    ) -> Result<bool, MeshError> {
        if !tag.is_core("object") {
            return resources::read(self, xml, tag, part);
        }
        let label = format!("{}, object {}", xml.part, quoted(&tag.text("id").unwrap_or_default()));
        self.count_thing(&label)?;
        let Some(id) = id(tag, "id") else {
            return Err(self.source.invalid(label, "its id is no number above 0", REEXPORT));
        };
        let printed = match tag.text("type").as_deref() {
            None | Some("model" | "surface") => true,
            Some(other) => {
                self.source.note(&label, format!("it is of the type {} and left out", quoted(other)));
                false
            }
        };
        let mut object = Object { property: id_pair(tag, "pid", "pindex"), printed, ..Object::default() };
        xml.children(|xml, tag| {
            if tag.is_core("mesh") {
                self.mesh(xml, &label, &mut object)?;
            } else if tag.is_core("components") {
                xml.children(|xml, tag| {
                    if tag.is_core("component") {
                        let component = self.instance(xml, tag, &label)?;
                        object.components.push(component);
                    }
                    Ok(false)
                })?;
            } else {
                return Ok(false);
            }
            Ok(true)
        })?;
        if part.objects.insert(id, object).is_some() {
            return Err(self.source.invalid(label, "there is another object of that id", REEXPORT));
        }
        Ok(true)
    }

    fn instance(&mut self, xml: &Xml, tag: &Tag, object: &str) -> Result<Instance, MeshError> {
        self.count_thing(object)?;
        let invalid = |reason: &str| self.source.invalid(object, reason, REEXPORT);
        let transform = match tag.text("transform") {
            None => DMat4::IDENTITY,
            Some(text) => matrix::parse(&text).ok_or_else(|| {
                invalid(&format!("transform {} is not twelve finite numbers", quoted(&text)))
            })?,
        };
        let id = id(tag, "objectid").ok_or_else(|| invalid("its objectid is no number above 0"))?;
        Ok(Instance { part: xml.attribute(tag, Space::Production, "path"), object: id, transform })
    }

    fn mesh<'i>(
        &mut self,
        xml: &mut Xml<'_, '_, 'i>,
        label: &str,
        object: &mut Object,
    ) -> Result<(), MeshError> {
        let source = self.source;
        xml.children(|xml, tag| {
            if tag.is_core("vertices") {
                xml.children(|_, tag| {
                    if tag.is_core("vertex") {
                        let place = || format!("{label}, vertex {}", object.vertices.len());
                        admit_vertex(source, self.counts.vertices, place)?;
                        self.counts.vertices += 1;
                        let position = position(tag).ok_or_else(|| {
                            source.invalid(place(), "x, y and z are not three finite numbers", REEXPORT)
                        })?;
                        object.vertices.push(position);
                    }
                    Ok(false)
                })?;
            } else if tag.is_core("triangles") {
                let mut painted = false;
                xml.children(|_, tag| {
                    if tag.is_core("triangle") {
                        let place = || format!("{label}, triangle {}", object.triangles.len());
                        admit_triangle(source, self.counts.triangles, place)?;
                        self.counts.triangles += 1;
                        let (triangle, paint) = triangle(tag).ok_or_else(|| {
                            source.invalid(place(), "its vertices or properties are no indices", REEXPORT)
                        })?;
                        painted |= paint;
                        object.triangles.push(triangle);
                    }
                    Ok(false)
                })?;
                if painted {
                    source.note(label, "a slicer's painting is left out; export colours as materials");
                }
            } else {
                if tag.space == Space::Other {
                    source.note(label, format!("{} in its mesh is left out", quoted(tag.name())));
                }
                return Ok(false);
            }
            Ok(true)
        })
    }
}

/// Refuses a package that requires an extension that is not read.
fn check_required(source: &Source, name: &str, model: &Tag) -> Result<(), MeshError> {
    let required = model.text("requiredextensions").unwrap_or_default();
    for prefix in required.split_ascii_whitespace() {
        let uri = model.text(&format!("xmlns:{prefix}")).unwrap_or_default();
        if Space::of(&uri) == Space::Other {
            let reason =
                format!("it requires the extension {}", quoted(if uri.is_empty() { prefix } else { &uri }));
            return Err(source.unsupported(name, reason, "export the model without it"));
        }
    }
    Ok(())
}

/// A resource's number, above 0.
pub(super) fn id(tag: &Tag, name: &str) -> Option<u32> {
    tag.text(name)?.trim().parse().ok().filter(|&id| id > 0)
}

fn id_pair(tag: &Tag, group: &str, index: &str) -> Option<Property> {
    Some((id(tag, group)?, tag.text(index).and_then(|i| i.trim().parse().ok()).unwrap_or(0)))
}

fn position(tag: &Tag) -> Option<[f64; 3]> {
    let mut position = [f64::NAN; 3];
    tag.each(|name, text| {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return,
        };
        position[axis] = text.trim().parse().unwrap_or(f64::NAN);
    });
    position.iter().all(|c| c.is_finite()).then_some(position)
}

/// A triangle, and whether a slicer painted it.
fn triangle(tag: &Tag) -> Option<(Triangle, bool)> {
    // v1, v2, v3, pid, p1, p2, p3
    let mut values: [Option<u32>; 7] = [None; 7];
    let (mut sound, mut painted) = (true, false);
    tag.each(|name, text| {
        let field = match name {
            "v1" => 0,
            "v2" => 1,
            "v3" => 2,
            "pid" => 3,
            "p1" => 4,
            "p2" => 5,
            "p3" => 6,
            _ => {
                painted |= name.ends_with("mmu_segmentation") || name == "paint_color";
                return;
            }
        };
        values[field] = text.trim().parse().ok();
        sound &= values[field].is_some();
    });
    let [Some(a), Some(b), Some(c), group, p1, p2, p3] = values else { return None };
    let indices = p1.map(|first| [first, p2.unwrap_or(first), p3.unwrap_or(first)]);
    sound.then_some((Triangle { vertices: [a, b, c], group, indices }, painted))
}
