//! The node tree: parents, cycles, depth, world transforms, and which nodes are in the scene.

use glam::{DMat4, DQuat, DVec3};

use super::REEXPORT;
use super::schema::{Node, Root};
use crate::MeshError;
use crate::import::source::{Source, label};

/// A checked node tree.
pub(super) struct Nodes {
    /// World transform of every node.
    pub world: Vec<DMat4>,
    /// Nodes of the scene in depth-first order, hidden branches left out.
    pub in_scene: Vec<usize>,
}

/// Checks that the nodes form a forest and works out where each one stands.
pub(super) fn resolve(source: &Source, root: &Root) -> Result<Nodes, MeshError> {
    let parents = parents(source, root)?;
    let mut world = vec![DMat4::IDENTITY; root.nodes.len()];
    let mut reached = vec![false; root.nodes.len()];
    let mut stack: Vec<_> = (0..root.nodes.len()).filter(|&n| parents[n].is_none()).map(|n| (n, 1)).collect();
    while let Some((index, depth)) = stack.pop() {
        let node = &root.nodes[index];
        if depth > source.limits.nesting {
            return Err(source.unsupported(
                name(root, index),
                format!("it is nested deeper than {} nodes", source.limits.nesting),
                "flatten the node tree or raise ImportLimits::nesting",
            ));
        }
        let above = parents[index].map_or(DMat4::IDENTITY, |p| world[p]);
        world[index] = above * local(source, root, index, node)?;
        reached[index] = true;
        stack.extend(node.children.iter().map(|&child| (child, depth + 1)));
    }
    // Every node has at most one parent, so what no root reaches is on a cycle or below one.
    if let Some(index) = reached.iter().position(|r| !r) {
        return Err(source.invalid(name(root, index), "its ancestors form a cycle", REEXPORT));
    }
    let in_scene = scene_nodes(source, root, &parents)?;
    Ok(Nodes { world, in_scene })
}

/// Whether a transform takes every triangle to a line or a point.
pub(super) fn collapses(world: &DMat4) -> bool {
    let [x, y, z] = [world.x_axis, world.y_axis, world.z_axis].map(|axis| axis.truncate());
    let longest2 = [x, y, z].map(|axis| axis.length_squared()).into_iter().fold(0.0, f64::max);
    let areas = [x.cross(y), y.cross(z), z.cross(x)].map(|n| n.length());
    areas.into_iter().all(|area| area <= 1e-15 * longest2)
}

fn name(root: &Root, index: usize) -> String {
    label("node", index, root.nodes.get(index).and_then(|n| n.name.as_deref()))
}

fn parents(source: &Source, root: &Root) -> Result<Vec<Option<usize>>, MeshError> {
    let mut parents = vec![None; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for &child in &node.children {
            let Some(parent) = parents.get_mut(child) else {
                return Err(source.invalid(
                    name(root, index),
                    format!("its child {child} does not exist, there are {} nodes", root.nodes.len()),
                    REEXPORT,
                ));
            };
            if let Some(other) = parent.replace(index) {
                return Err(source.invalid(
                    name(root, child),
                    format!("it has two parents, nodes {other} and {index}"),
                    REEXPORT,
                ));
            }
        }
    }
    Ok(parents)
}

fn local(source: &Source, root: &Root, index: usize, node: &Node) -> Result<DMat4, MeshError> {
    if let Some(matrix) = &node.matrix {
        return Ok(DMat4::from_cols_array(matrix));
    }
    let rotation = match node.rotation.map(DQuat::from_array) {
        None => DQuat::IDENTITY,
        Some(q) if q.length_squared() > 1e-12 && q.length_squared().is_finite() => q.normalize(),
        Some(_) => {
            return Err(source.invalid(name(root, index), "its rotation is not a unit quaternion", REEXPORT));
        }
    };
    Ok(DMat4::from_scale_rotation_translation(
        node.scale.map_or(DVec3::ONE, DVec3::from),
        rotation,
        node.translation.map_or(DVec3::ZERO, DVec3::from),
    ))
}

/// The default scene's nodes; without one, the only scene's or those of all roots.
fn scene_nodes(source: &Source, root: &Root, parents: &[Option<usize>]) -> Result<Vec<usize>, MeshError> {
    let chosen = root.scene.or((root.scenes.len() == 1).then_some(0));
    let mut roots = match chosen {
        Some(index) => {
            let Some(scene) = root.scenes.get(index) else {
                return Err(source.invalid(
                    label("scene", index, None),
                    format!("it does not exist, there are {}", root.scenes.len()),
                    REEXPORT,
                ));
            };
            scene.nodes.clone()
        }
        None => (0..parents.len()).filter(|&n| parents[n].is_none()).collect(),
    };
    if let Some(missing) = roots.iter().find(|&&n| n >= root.nodes.len()) {
        return Err(source.invalid(
            label("scene", chosen.unwrap_or(0), None),
            format!("its node {missing} does not exist, there are {}", root.nodes.len()),
            REEXPORT,
        ));
    }
    if root.scenes.len() > 1 {
        match chosen {
            Some(index) => source.note("scenes", format!("only scene {index}, the default, is imported")),
            None => source.note("scenes", "no scene is the default: all of them are imported"),
        }
    }
    roots.reverse();
    let mut seen = vec![false; root.nodes.len()];
    let mut order = Vec::new();
    while let Some(index) = roots.pop() {
        if std::mem::replace(&mut seen[index], true) {
            continue;
        }
        let node = &root.nodes[index];
        if node.extensions.visibility.as_ref().is_some_and(|v| v.visible == Some(false)) {
            source.note(name(root, index), "it is hidden, so it and its children are left out");
            continue;
        }
        if node.extensions.instancing.is_some() {
            return Err(source.unsupported(
                name(root, index),
                "GPU instances (EXT_mesh_gpu_instancing)",
                "export the instances as ordinary nodes",
            ));
        }
        order.push(index);
        roots.extend(node.children.iter().rev());
    }
    Ok(order)
}
