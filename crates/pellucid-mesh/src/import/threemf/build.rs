//! The build: items, components and their transforms, down to triangles.

use std::collections::{BTreeMap, HashMap};

use glam::DMat4;

use super::package::Package;
use super::paint::{self, Paint};
use super::part::{Counts, Instance, Object, Part, Property, Reader, Triangle};
use super::{REEXPORT, matrix};
use crate::import::Format;
use crate::import::parts::Parts;
use crate::import::source::Source;
use crate::{MeshError, Model};

/// An object to place.
struct Task {
    part: usize,
    object: u32,
    transform: DMat4,
    depth: u32,
}

pub(super) struct Build<'s, 'a, 'b> {
    source: &'s Source<'a>,
    package: &'s Package<'s, 'a, 'b>,
    models: Vec<Part>,
    /// Models by their key in the package.
    known: BTreeMap<String, usize>,
    counts: Counts,
    parts: Parts<'s, 'a>,
    /// Materials by model and texture; one without texture.
    materials: BTreeMap<Option<(usize, u32)>, u32>,
    placed: u64,
}

impl<'s, 'a, 'b> Build<'s, 'a, 'b> {
    pub fn new(
        source: &'s Source<'a>,
        package: &'s Package<'s, 'a, 'b>,
        root: &str,
    ) -> Result<Self, MeshError> {
        let mut counts = Counts::default();
        let bytes = package.read("package", root)?;
        let model = Reader { source, counts: &mut counts }.part(root, &bytes)?;
        let read_as = source.read_as(Format::ThreeMf, model.unit);
        Ok(Self {
            source,
            package,
            known: BTreeMap::from([(package.key("package", root)?, 0)]),
            models: vec![model],
            counts,
            parts: Parts::new(source, read_as),
            materials: BTreeMap::new(),
            placed: 0,
        })
    }

    /// Places every item of the build, in order.
    pub fn place_all(&mut self) -> Result<(), MeshError> {
        let items = std::mem::take(&mut self.models[0].items);
        let mut tasks = Vec::new();
        self.push(&mut tasks, 0, &items, DMat4::IDENTITY, 0)?;
        while let Some(task) = tasks.pop() {
            self.place(task, &mut tasks)?;
        }
        Ok(())
    }

    /// Adds instances as tasks; the first is taken first.
    fn push(
        &mut self,
        tasks: &mut Vec<Task>,
        part: usize,
        instances: &[Instance],
        above: DMat4,
        depth: u32,
    ) -> Result<(), MeshError> {
        self.placed += instances.len() as u64;
        let limits = self.source.limits;
        if self.placed > limits.items {
            let reason = format!("it places more than {} objects", limits.items);
            let remedy = "simplify the model or raise ImportLimits::items";
            return Err(self.source.unsupported("build", reason, remedy));
        }
        if depth > limits.nesting {
            let reason = format!("components nest deeper than {} levels, or hold themselves", limits.nesting);
            let remedy = "flatten the components or raise ImportLimits::nesting";
            return Err(self.source.unsupported("build", reason, remedy));
        }
        for Instance { part: path, object, transform } in instances.iter().rev() {
            let part = match path {
                Some(path) => self.model(path)?,
                None => part,
            };
            tasks.push(Task { part, object: *object, transform: above * *transform, depth });
        }
        Ok(())
    }

    /// The model of another part, read the first time.
    fn model(&mut self, path: &str) -> Result<usize, MeshError> {
        let key = self.package.key("build", path)?;
        if let Some(&known) = self.known.get(&key) {
            return Ok(known);
        }
        let bytes = self.package.read("build", path)?;
        let model = Reader { source: self.source, counts: &mut self.counts }.part(path, &bytes)?;
        if model.unit.is_some_and(|unit| Some(unit) != self.models[0].unit) {
            self.source.note(path, "its unit differs from that of the package's first model, which counts");
        }
        self.models.push(model);
        self.known.insert(key, self.models.len() - 1);
        Ok(self.models.len() - 1)
    }

    fn place(&mut self, task: Task, tasks: &mut Vec<Task>) -> Result<(), MeshError> {
        let Task { part, object: id, transform, depth } = task;
        let label = format!("{}, object {id}", self.models[part].name);
        // Taken out while its triangles are added: it is not looked at meanwhile.
        let Some(object) = self.models[part].objects.get_mut(&id).map(std::mem::take) else {
            return Err(self.source.invalid(label, "it is placed, but does not exist", REEXPORT));
        };
        let mut added = Ok(());
        if object.printed {
            added = self.add(part, &label, &object, &transform);
            if added.is_ok() {
                added = self.push(tasks, part, &object.components, transform, depth + 1);
            }
        }
        self.models[part].objects.insert(id, object);
        added
    }

    fn add(&mut self, part: usize, label: &str, object: &Object, transform: &DMat4) -> Result<(), MeshError> {
        let mirrored = matrix::mirrors(transform);
        // Vertices by position and property.
        let mut known: HashMap<(u32, Option<Property>), (u32, u32)> = HashMap::new();
        for (number, triangle) in object.triangles.iter().enumerate() {
            let place = || format!("{label}, triangle {number}");
            let properties = self.properties(part, object, triangle);
            let mut vertices = [0; 3];
            let mut material = 0;
            for (k, vertex) in vertices.iter_mut().enumerate() {
                let (index, property) = (triangle.vertices[k], properties[k]);
                let (found, its) = match known.get(&(index, property)) {
                    Some(&both) => both,
                    None => {
                        let Some(&position) = object.vertices.get(index as usize) else {
                            let count = object.vertices.len();
                            let reason = format!("vertex {index} does not exist, there are {count}");
                            return Err(self.source.invalid(place(), reason, REEXPORT));
                        };
                        let paint = match property {
                            Some(property) => paint::resolve(self.source, &self.models[part], property)
                                .map_err(|reason| self.source.invalid(place(), reason, REEXPORT))?,
                            None => Paint { rgb: self.source.options.color, alpha: 1.0, texture: None },
                        };
                        let its = self.material(part, label, paint.texture.map(|t| t.0))?;
                        let uv = paint.texture.map_or([0.0; 2], |(_, [u, v])| [u, 1.0 - v]);
                        let point = matrix::apply(transform, position);
                        if !point.iter().all(|c| c.is_finite()) {
                            let reason = "its transform takes it beyond all numbers";
                            return Err(self.source.invalid(place(), reason, REEXPORT));
                        }
                        let [r, g, b] = paint.rgb;
                        let new = self.parts.vertex(place, point, uv, [r, g, b, paint.alpha])?;
                        known.insert((index, property), (new, its));
                        (new, its)
                    }
                };
                *vertex = found;
                material = its;
            }
            if mirrored {
                vertices.swap(1, 2);
            }
            self.parts.triangle(place, vertices, material)?;
        }
        Ok(())
    }

    /// The property of each corner.
    fn properties(&self, part: usize, object: &Object, triangle: &Triangle) -> [Option<Property>; 3] {
        let group = triangle.group.or(object.property.map(|(group, _)| group));
        match (group, triangle.indices) {
            (Some(group), Some(indices)) => {
                // A base material is never blended with another: the first corner's counts.
                let base =
                    matches!(self.models[part].groups.get(&group), Some(super::resources::Group::Base(_)));
                let indices = if base { [indices[0]; 3] } else { indices };
                indices.map(|index| Some((group, index)))
            }
            _ => [object.property; 3],
        }
    }

    fn material(&mut self, part: usize, label: &str, texture: Option<u32>) -> Result<u32, MeshError> {
        let key = texture.map(|texture| (part, texture));
        if let Some(&known) = self.materials.get(&key) {
            return Ok(known);
        }
        let material = match texture {
            None => self.parts.material("", [1.0; 3], None),
            Some(id) => {
                let object = format!("{}, texture2d {id}", self.models[part].name);
                let Some(texture) = self.models[part].textures.get(&id) else {
                    let reason = format!("texture {id} does not exist");
                    return Err(self.source.invalid(label, reason, REEXPORT));
                };
                let key = self.package.key(&object, &texture.path)?;
                let package = self.package;
                let image = self
                    .parts
                    .texture(&object, &key, texture.sampler, |_| package.read(&object, &texture.path))?;
                self.parts.material(&texture.path, [1.0; 3], Some(image))
            }
        };
        self.materials.insert(key, material);
        Ok(material)
    }

    pub fn finish(self) -> Result<Model, MeshError> {
        self.parts.finish("export a mesh with triangles, and place it on the build plate")
    }
}
