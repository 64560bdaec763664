//! Primitives: topology, attributes, morph targets, skin and placement of each vertex.

use glam::{DMat3, DMat4, DVec3};

use super::REEXPORT;
use super::accessor::{Accessor, Component, Shape};
use super::buffers::Buffers;
use super::extensions;
use super::materials::Resolved;
use super::schema::Primitive;
use super::skin::Influences;
use crate::import::ReadAs;
use crate::{MeshError, Triangle, Vertex};

use Component::{F32, I8, I16, U8, U16, U32};

const INDICES: Shape = Shape { kinds: &["SCALAR"], components: &[U8, U16, U32], zeros: false };
/// Integers are KHR_mesh_quantization's.
const POSITION: Shape = Shape { kinds: &["VEC3"], components: &[F32, I8, U8, I16, U16], zeros: false };
const DISPLACEMENT: Shape = Shape { zeros: true, ..POSITION };
const TEX_COORD_SHIFT: Shape = Shape { zeros: true, ..TEX_COORD };
const COLOR_SHIFT: Shape =
    Shape { kinds: &["VEC3", "VEC4"], components: &[F32, U8, U16, I8, I16], zeros: true };
const TEX_COORD: Shape = Shape { kinds: &["VEC2"], components: &[F32, U8, U16, I8, I16], zeros: false };
const COLOR: Shape = Shape { kinds: &["VEC3", "VEC4"], components: &[F32, U8, U16], zeros: false };

/// How a node places the primitives of its mesh.
pub(super) struct Placement<'a> {
    pub world: DMat4,
    /// Morph weights, one a target; missing ones are 0.
    pub weights: &'a [f64],
    /// The skin's joint matrices.
    pub joints: Option<&'a [DMat4]>,
}

/// The mesh as it grows.
#[derive(Default)]
pub(super) struct Assembly {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<Triangle>,
    deformations: u64,
}

#[derive(Clone, Copy, PartialEq)]
enum Topology {
    List,
    Strip,
    Fan,
}

impl Topology {
    fn triangles(self, corners: usize) -> usize {
        match self {
            Self::List => corners / 3,
            Self::Strip | Self::Fan => corners.saturating_sub(2),
        }
    }

    /// Positions in the index list of triangle `i`'s corners.
    fn corners(self, i: usize) -> [usize; 3] {
        match self {
            Self::List => [3 * i, 3 * i + 1, 3 * i + 2],
            Self::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
            Self::Fan => [i + 1, i + 2, 0],
        }
    }
}

impl Assembly {
    /// Adds a primitive; `object` is what errors call it.
    pub fn add(
        &mut self,
        buffers: &Buffers,
        object: &str,
        primitive: &Primitive,
        placement: &Placement,
        material: impl FnOnce() -> Result<Resolved, MeshError>,
    ) -> Result<(), MeshError> {
        let source = buffers.source();
        extensions::refuse_compressed_primitive(source, object, primitive)?;
        let topology = match primitive.mode.unwrap_or(4) {
            0..=3 => {
                source.note(object, "points and lines are left out");
                return Ok(());
            }
            4 => Topology::List,
            5 => Topology::Strip,
            6 => Topology::Fan,
            other => return Err(source.invalid(object, format!("mode {other} does not exist"), REEXPORT)),
        };
        let Some(&position) = primitive.attributes.get("POSITION") else {
            source.note(object, "it has no positions and is left out");
            return Ok(());
        };
        let positions = Accessor::open(buffers, &format!("{object}, POSITION"), position, &POSITION)?;
        let faces = self.faces(buffers, object, primitive, topology, positions.count())?;
        if faces.is_empty() {
            return Ok(());
        }
        let used = used_vertices(&faces);
        let material = material()?;
        let reader = Reader::open(buffers, object, primitive, placement, positions, material)?;
        self.admit(buffers, object, &reader, used.len())?;

        let base = self.vertices.len();
        let mut mirrored = Vec::with_capacity(used.len());
        self.vertices.reserve(used.len());
        for &index in &used {
            let (vertex, mirror) = reader
                .vertex(index as usize)
                .map_err(|reason| source.invalid(object, reason, "repair the mesh and export it again"))?;
            self.vertices.push(vertex);
            mirrored.push(mirror);
        }
        self.triangles.reserve(faces.len());
        for face in faces {
            // Every index of a face is among the used ones, which ascend.
            let local = face.map(|v| used.partition_point(|&u| u < v));
            let mirror = local.iter().filter(|&&v| mirrored[v]).count() >= 2;
            let [a, b, c] = local.map(|v| (base + v) as u32);
            let vertices = if mirror { [a, c, b] } else { [a, b, c] };
            self.triangles.push(Triangle { vertices, material: material.index });
        }
        Ok(())
    }

    /// Corner indices of the triangles, each below `count`; those with a repeated index dropped.
    fn faces(
        &self,
        buffers: &Buffers,
        object: &str,
        primitive: &Primitive,
        topology: Topology,
        count: usize,
    ) -> Result<Vec<[u32; 3]>, MeshError> {
        let source = buffers.source();
        let indices = match primitive.indices {
            Some(index) => Some(Accessor::open(buffers, &format!("{object}, indices"), index, &INDICES)?),
            None => None,
        };
        let corners = indices.as_ref().map_or(count, Accessor::count);
        let number = topology.triangles(corners);
        if self.triangles.len() as u64 + number as u64 > source.limits.triangles {
            return Err(source.unsupported(
                object,
                format!("the model has more than {} triangles", source.limits.triangles),
                "simplify it or raise ImportLimits::triangles",
            ));
        }
        if topology == Topology::List && corners % 3 != 0 {
            source.note(object, "its corners are no multiple of three; the last are left out");
        }
        let mut faces = Vec::with_capacity(number);
        for i in 0..number {
            let mut face = [0; 3];
            for (out, corner) in face.iter_mut().zip(topology.corners(i)) {
                let vertex = indices.as_ref().map_or(corner, |a| a.get::<1>(corner, 0.0)[0] as usize);
                if vertex >= count {
                    return Err(source.invalid(
                        format!("{object}, indices"),
                        format!("index {vertex} at {corner} is out of range, there are {count} vertices"),
                        REEXPORT,
                    ));
                }
                *out = u32::try_from(vertex).map_err(|_| {
                    source.unsupported(object, "it has more than 2^32 vertices", "split the mesh")
                })?;
            }
            if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
                faces.push(face);
            }
        }
        if topology == Topology::List && faces.len() < number {
            source.note(object, format!("{} triangles without area are left out", number - faces.len()));
        }
        Ok(faces)
    }

    /// Checks the vertices to come against the limits.
    fn admit(
        &mut self,
        buffers: &Buffers,
        object: &str,
        reader: &Reader,
        vertices: usize,
    ) -> Result<(), MeshError> {
        let source = buffers.source();
        if self.vertices.len() as u64 + vertices as u64 > source.limits.vertices.min(u64::from(u32::MAX)) {
            return Err(source.unsupported(
                object,
                format!("the model has more than {} vertices", source.limits.vertices),
                "simplify it or raise ImportLimits::vertices",
            ));
        }
        let each = reader.targets() as u64 + reader.influences.as_ref().map_or(0, Influences::per_vertex);
        self.deformations = self.deformations.saturating_add(each.saturating_mul(vertices as u64));
        if self.deformations > source.limits.deformations {
            return Err(source.unsupported(
                object,
                format!("its morphs and skins take more than {} steps", source.limits.deformations),
                "apply them before export or raise ImportLimits::deformations",
            ));
        }
        Ok(())
    }
}

fn used_vertices(faces: &[[u32; 3]]) -> Vec<u32> {
    let mut used = faces.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    used
}

/// What a morph target adds to an attribute, and how much of it.
struct Shift<'b> {
    weight: f64,
    accessor: Accessor<'b>,
}

/// An attribute's value with its morph targets added.
fn morphed<const N: usize>(mut value: [f64; N], shifts: &[Shift], index: usize) -> [f64; N] {
    for Shift { weight, accessor } in shifts {
        let shift: [f64; N] = accessor.get(index, 0.0);
        value.iter_mut().zip(shift).for_each(|(v, s)| *v += s * weight);
    }
    value
}

/// A primitive's attributes.
struct Reader<'b> {
    positions: Accessor<'b>,
    tex_coords: Option<Accessor<'b>>,
    colors: Option<Accessor<'b>>,
    /// What the active morph targets add to positions.
    displacements: Vec<Shift<'b>>,
    /// What they add to the texture coordinates in use.
    tex_coord_shifts: Vec<Shift<'b>>,
    /// What they add to colours.
    color_shifts: Vec<Shift<'b>>,
    influences: Option<Influences<'b>>,
    material: Resolved,
    world: DMat4,
    read_as: ReadAs,
}

impl<'b> Reader<'b> {
    fn open(
        buffers: &'b Buffers,
        object: &str,
        primitive: &Primitive,
        placement: &Placement<'b>,
        positions: Accessor<'b>,
        material: Resolved,
    ) -> Result<Self, MeshError> {
        let source = buffers.source();
        let count = positions.count();
        let open = |what: String, index: usize, shape: &Shape| {
            let what = format!("{object}, {what}");
            let accessor = Accessor::open(buffers, &what, index, shape)?;
            if accessor.count() == count {
                return Ok(accessor);
            }
            let reason = format!("{} elements for {count} positions", accessor.count());
            Err(source.invalid(what, reason, REEXPORT))
        };
        let tex_coords = match material.tex_coord {
            None => None,
            Some(tex_coord) => {
                let name = format!("TEXCOORD_{}", tex_coord.set);
                let Some(&index) = primitive.attributes.get(&name) else {
                    return Err(source.invalid(
                        object,
                        format!("its material has a texture, but it has no {name}"),
                        "unwrap the mesh, or give it a material without a texture",
                    ));
                };
                Some(open(name, index, &TEX_COORD)?)
            }
        };
        let colors = match primitive.attributes.get("COLOR_0") {
            Some(&index) => Some(open("COLOR_0".into(), index, &COLOR)?.normalized()),
            None => None,
        };
        let shifts = |name: &str, base: bool, shape: &Shape| {
            let mut shifts = Vec::new();
            for (k, (target, &weight)) in primitive.targets.iter().zip(placement.weights).enumerate() {
                let Some(&index) = target.get(name).filter(|_| weight != 0.0) else { continue };
                if base {
                    let accessor = open(format!("morph target {k}, {name}"), index, shape)?;
                    shifts.push(Shift { weight, accessor });
                } else {
                    let reason =
                        format!("morph target {k} changes {name}, which it has not; that is left out");
                    source.note(object, reason);
                }
            }
            Ok::<_, MeshError>(shifts)
        };
        let displacements = shifts("POSITION", true, &DISPLACEMENT)?;
        let tex_coord_shifts = match material.tex_coord {
            Some(tex_coord) => shifts(&format!("TEXCOORD_{}", tex_coord.set), true, &TEX_COORD_SHIFT)?,
            None => Vec::new(),
        };
        let color_shifts = shifts("COLOR_0", colors.is_some(), &COLOR_SHIFT)?
            .into_iter()
            .map(|s| Shift { accessor: s.accessor.normalized(), ..s })
            .collect();
        let influences = match placement.joints {
            Some(matrices) => Some(Influences::open(buffers, object, primitive, matrices, count)?),
            None => None,
        };
        Ok(Self {
            positions,
            tex_coords,
            colors,
            displacements,
            tex_coord_shifts,
            color_shifts,
            influences,
            material,
            world: placement.world,
            read_as: super::read_as(source),
        })
    }

    /// Morph targets' attributes that each vertex takes.
    fn targets(&self) -> usize {
        self.displacements.len() + self.tex_coord_shifts.len() + self.color_shifts.len()
    }

    /// The colour of a vertex, clamped to 0..1 if morphed, as glTF asks.
    fn color(&self, base: &Accessor, index: usize) -> [f32; 4] {
        let color = morphed(base.get(index, 1.0), &self.color_shifts, index);
        let clamped = |c: f64| if c.is_finite() { c.clamp(0.0, 1.0) } else { c };
        color.map(|c| if self.color_shifts.is_empty() { c } else { clamped(c) } as f32)
    }

    /// Vertex `index` in print axes, and whether its transform mirrors; the error is the reason.
    fn vertex(&self, index: usize) -> Result<(Vertex, bool), String> {
        let position = DVec3::from(morphed(self.positions.get(index, 0.0), &self.displacements, index));
        let skinned = match &self.influences {
            Some(influences) => influences.transform(index)?,
            None => None,
        };
        let transform = skinned.unwrap_or(self.world);
        let placed = transform.transform_point3(position);
        if !(position.is_finite() && placed.is_finite()) {
            return Err(format!("the position of vertex {index} is NaN or infinite"));
        }
        let uv = match (&self.tex_coords, self.material.tex_coord) {
            (Some(accessor), Some(map)) => {
                map.apply(morphed(accessor.get(index, 0.0), &self.tex_coord_shifts, index)).map(|c| c as f32)
            }
            _ => [0.0; 2],
        };
        let color = self.colors.as_ref().map_or([1.0; 4], |a| self.color(a, index));
        if !uv.iter().chain(&color).all(|c| c.is_finite()) {
            return Err(format!("the texture coordinate or colour of vertex {index} is NaN or infinite"));
        }
        let position_m = self.read_as.to_print_m(placed.into());
        Ok((Vertex { position_m, uv, color }, DMat3::from_mat4(transform).determinant() < 0.0))
    }
}
