//! Skins at rest: joint matrices and the blended transform of a vertex.

use glam::DMat4;

use super::REEXPORT;
use super::accessor::{Accessor, Component, Shape};
use super::buffers::Buffers;
use super::nodes::Nodes;
use super::schema::Primitive;
use crate::MeshError;
use crate::import::source::label;

const MATRICES: Shape = Shape { kinds: &["MAT4"], components: &[Component::F32], zeros: false };
const JOINTS: Shape = Shape { kinds: &["VEC4"], components: &[Component::U8, Component::U16], zeros: false };
const WEIGHTS: Shape =
    Shape { kinds: &["VEC4"], components: &[Component::F32, Component::U8, Component::U16], zeros: false };

/// World transform x inverse bind matrix of every joint, at rest.
pub(super) fn joint_matrices(
    buffers: &Buffers,
    nodes: &Nodes,
    index: usize,
) -> Result<Vec<DMat4>, MeshError> {
    let (source, root) = (buffers.source(), buffers.root());
    let Some(skin) = root.skins.get(index) else {
        let reason = format!("it does not exist, there are {}", root.skins.len());
        return Err(source.invalid(label("skin", index, None), reason, REEXPORT));
    };
    let object = label("skin", index, skin.name.as_deref());
    let inverse_bind = match skin.inverse_bind_matrices {
        Some(accessor) => {
            let what = format!("{object}, inverseBindMatrices");
            let accessor = Accessor::open(buffers, &what, accessor, &MATRICES)?;
            if accessor.count() < skin.joints.len() {
                let reason = format!("{} matrices for {} joints", accessor.count(), skin.joints.len());
                return Err(source.invalid(what, reason, REEXPORT));
            }
            Some(accessor)
        }
        None => None,
    };
    let joint = |(k, &joint): (usize, &usize)| {
        let Some(world) = nodes.world.get(joint) else {
            let reason = format!("its joint {joint} does not exist, there are {} nodes", nodes.world.len());
            return Err(source.invalid(&object, reason, REEXPORT));
        };
        let bind = inverse_bind.as_ref().map_or(DMat4::IDENTITY, |a| DMat4::from_cols_array(&a.get(k, 0.0)));
        Ok(*world * bind)
    };
    skin.joints.iter().enumerate().map(joint).collect()
}

/// `JOINTS_n` and `WEIGHTS_n` of a primitive, with the matrices they blend.
pub(super) struct Influences<'b> {
    sets: Vec<(Accessor<'b>, Accessor<'b>)>,
    matrices: &'b [DMat4],
}

impl<'b> Influences<'b> {
    /// Opens every set; each must have `count` elements.
    pub fn open(
        buffers: &'b Buffers,
        object: &str,
        primitive: &Primitive,
        matrices: &'b [DMat4],
        count: usize,
    ) -> Result<Self, MeshError> {
        let mut sets = Vec::new();
        loop {
            let names = ["JOINTS", "WEIGHTS"].map(|kind| format!("{kind}_{}", sets.len()));
            let [joints, weights] = names.each_ref().map(|name| primitive.attributes.get(name));
            let (Some(&joints), Some(&weights)) = (joints, weights) else {
                return Ok(Self { sets, matrices });
            };
            let open = |name: &str, accessor, shape: &Shape| {
                let what = format!("{object}, {name}");
                let accessor = Accessor::open(buffers, &what, accessor, shape)?;
                if accessor.count() == count {
                    return Ok(accessor);
                }
                let reason = format!("{} elements for {count} positions", accessor.count());
                Err(buffers.source().invalid(what, reason, REEXPORT))
            };
            let set = (open(&names[0], joints, &JOINTS)?, open(&names[1], weights, &WEIGHTS)?.normalized());
            sets.push(set);
        }
    }

    /// Matrices blended for a vertex.
    pub fn per_vertex(&self) -> u64 {
        4 * self.sets.len() as u64
    }

    /// The blended matrix of a vertex, `None` if it hangs on no joint; the error is the reason.
    pub fn transform(&self, vertex: usize) -> Result<Option<DMat4>, String> {
        let (mut blend, mut total) = (DMat4::ZERO, 0.0);
        for (joints, weights) in &self.sets {
            let (joints, weights) = (joints.get::<4>(vertex, 0.0), weights.get::<4>(vertex, 0.0));
            for (joint, weight) in joints.into_iter().zip(weights) {
                if weight == 0.0 {
                    continue;
                }
                if !weight.is_finite() {
                    return Err(format!("vertex {vertex} has a joint weight that is NaN or infinite"));
                }
                let Some(&matrix) = self.matrices.get(joint as usize) else {
                    return Err(format!(
                        "vertex {vertex} hangs on joint {joint}, the skin has {}",
                        self.matrices.len()
                    ));
                };
                blend += matrix * weight;
                total += weight;
            }
        }
        Ok((total > 0.0).then(|| blend * (1.0 / total)))
    }
}
