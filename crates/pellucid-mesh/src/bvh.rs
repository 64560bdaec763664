//! A bounding volume hierarchy over boxes: triangles, boundary edges, shells.

use crate::geometry::{Bounds, Vec3};

/// Most items in a leaf.
const LEAF: usize = 4;
/// Bins along the split axis (Wald 2007, binned surface-area heuristic).
const BINS: usize = 16;
/// Deeper nodes split at the median, which bounds the depth at this + 32.
const MAX_SAH_DEPTH: usize = 48;

/// A node over `order[start..start + count]`. The left child of an inner node follows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub bounds: Bounds,
    pub start: u32,
    pub count: u32,
    /// Index of the right child; 0 in a leaf.
    pub right: u32,
}

impl Node {
    pub fn is_leaf(&self) -> bool {
        self.right == 0
    }

    /// Positions in [`Bvh::order`] of the items below.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.start as usize..(self.start + self.count) as usize
    }
}

/// A binary tree of boxes, built by the surface-area heuristic; the same input gives the same tree.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Bvh {
    /// Builds the tree over item boxes.
    pub fn build(items: &[Bounds]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..items.len() as u32).collect() };
        if !items.is_empty() {
            let centres: Vec<Vec3> = items.iter().map(Bounds::centre).collect();
            tree.split(items, &centres, 0, items.len(), 0);
        }
        tree
    }

    /// Depth-first nodes; the root is the first, children follow their parent.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Items in leaf order.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    fn split(&mut self, items: &[Bounds], centres: &[Vec3], start: usize, end: usize, depth: usize) {
        let index = self.nodes.len();
        let bounds = self.order[start..end].iter().fold(Bounds::EMPTY, |b, &i| b.joined(&items[i as usize]));
        self.nodes.push(Node { bounds, start: start as u32, count: (end - start) as u32, right: 0 });
        if end - start <= LEAF {
            return;
        }
        let middle = self.partition(items, centres, start, end, depth);
        self.split(items, centres, start, middle, depth + 1);
        self.nodes[index].right = self.nodes.len() as u32;
        self.split(items, centres, middle, end, depth + 1);
    }

    /// Reorders `order[start..end]` and returns the position of the split, strictly inside.
    fn partition(
        &mut self,
        items: &[Bounds],
        centres: &[Vec3],
        start: usize,
        end: usize,
        depth: usize,
    ) -> usize {
        let span = Bounds::of(self.order[start..end].iter().map(|&i| centres[i as usize]));
        let extent = span.extent();
        let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
        if depth < MAX_SAH_DEPTH && extent[axis] > 0.0 {
            let factor = BINS as f64 / extent[axis];
            let bin =
                |i: u32| (((centres[i as usize][axis] - span.min[axis]) * factor) as usize).min(BINS - 1);
            let mut bins = [(Bounds::EMPTY, 0usize); BINS];
            for &i in &self.order[start..end] {
                let b = &mut bins[bin(i)];
                *b = (b.0.joined(&items[i as usize]), b.1 + 1);
            }
            if let Some(cut) = best_cut(&bins) {
                let part = &mut self.order[start..end];
                // A stable partition keeps the tree independent of how ties are met.
                let (low, high): (Vec<u32>, Vec<u32>) = part.iter().partition(|&&i| bin(i) < cut);
                part[..low.len()].copy_from_slice(&low);
                part[low.len()..].copy_from_slice(&high);
                return start + low.len();
            }
        }
        let middle = (end - start) / 2;
        self.order[start..end].select_nth_unstable_by(middle, |&i, &j| {
            let (a, b) = (centres[i as usize][axis], centres[j as usize][axis]);
            a.total_cmp(&b).then(i.cmp(&j))
        });
        start + middle
    }

    /// Visits leaf items near `p`, nearest boxes first: `visit` gets an item and the present
    /// squared radius and returns the new one. Boxes at exactly that distance are still visited,
    /// so ties can be resolved by the caller.
    pub fn nearest(&self, p: Vec3, radius2: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let Some(root) = self.nodes.first() else {
            return;
        };
        let mut best = radius2;
        let mut stack = [(0u32, 0.0f64); MAX_SAH_DEPTH + 48];
        stack[0] = (0, root.bounds.distance2_to(p));
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, d2) = stack[top];
            if d2 > best {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.is_leaf() {
                for &item in &self.order[node.range()] {
                    best = visit(item, best);
                }
                continue;
            }
            let children = [index + 1, node.right];
            let distances = children.map(|c| self.nodes[c as usize].bounds.distance2_to(p));
            let near = usize::from(distances[1] < distances[0]);
            for k in [1 - near, near] {
                if distances[k] <= best {
                    stack[top] = (children[k], distances[k]);
                    top += 1;
                }
            }
        }
    }

    /// Calls `visit` for items in leaves whose box the segment from `from` to `from + way` meets, in
    /// a fixed order.
    pub fn along(&self, from: Vec3, way: Vec3, mut visit: impl FnMut(u32)) {
        let meets = |b: &Bounds| {
            let (mut enter, mut leave) = (0.0f64, 1.0f64);
            for k in 0..3 {
                if way[k] == 0.0 {
                    if from[k] < b.min[k] || from[k] > b.max[k] {
                        return false;
                    }
                    continue;
                }
                let (a, c) = ((b.min[k] - from[k]) / way[k], (b.max[k] - from[k]) / way[k]);
                enter = enter.max(a.min(c));
                leave = leave.min(a.max(c));
            }
            // A flat box may be missed by rounding.
            enter <= leave + 1e-9
        };
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let Some(node) = self.nodes.get(index as usize).filter(|n| meets(&n.bounds)) else {
                continue;
            };
            if node.is_leaf() {
                self.order[node.range()].iter().for_each(|&item| visit(item));
            } else {
                stack.extend([node.right, index + 1]);
            }
        }
    }

    /// Calls `visit` for items in leaves whose box overlaps `area` until it returns true; says
    /// whether it did. The caller tests the item's own box where that matters.
    pub fn any_overlapping(&self, area: &Bounds, mut visit: impl FnMut(u32) -> bool) -> bool {
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let Some(node) = self.nodes.get(index as usize) else {
                return false;
            };
            if !node.bounds.overlaps(area) {
                continue;
            }
            if node.is_leaf() {
                if self.order[node.range()].iter().any(|&item| visit(item)) {
                    return true;
                }
            } else {
                stack.extend([node.right, index + 1]);
            }
        }
        false
    }
}

/// The cut with the least surface-area cost: items in bins below it go left. `None` when all items
/// fall into one bin.
fn best_cut(bins: &[(Bounds, usize); BINS]) -> Option<usize> {
    let mut right = [(Bounds::EMPTY, 0usize); BINS + 1];
    for b in (0..BINS).rev() {
        right[b] = (right[b + 1].0.joined(&bins[b].0), right[b + 1].1 + bins[b].1);
    }
    let mut left = (Bounds::EMPTY, 0usize);
    let mut best = None;
    let mut least = f64::INFINITY;
    for cut in 1..BINS {
        left = (left.0.joined(&bins[cut - 1].0), left.1 + bins[cut - 1].1);
        if left.1 == 0 || right[cut].1 == 0 {
            continue;
        }
        let cost = left.0.half_area() * left.1 as f64 + right[cut].0.half_area() * right[cut].1 as f64;
        if cost < least {
            least = cost;
            best = Some(cut);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = Vec<Bounds>> {
        // Coarse coordinates plant equal centres and touching boxes.
        let coordinate = prop_oneof![(-3..4i32).prop_map(f64::from), -3.0..3.0f64];
        prop::collection::vec((prop::array::uniform3(coordinate), prop::array::uniform3(0.0..1.0f64)), 0..120)
            .prop_map(|v| {
                v.into_iter()
                    .map(|(p, e)| Bounds { min: p, max: std::array::from_fn(|k| p[k] + e[k].round()) })
                    .collect()
            })
    }

    proptest! {
        #[test]
        fn queries_agree_with_brute_force(items in boxes(), p in prop::array::uniform3(-4.0..4.0f64)) {
            let tree = Bvh::build(&items);
            let mut seen = tree.order().to_vec();
            seen.sort_unstable();
            prop_assert_eq!(seen, (0..items.len() as u32).collect::<Vec<_>>());

            let mut found = (f64::INFINITY, u32::MAX);
            tree.nearest(p, f64::INFINITY, |i, best| {
                let d = items[i as usize].distance2_to(p);
                if (d, i) < found {
                    found = (d, i);
                }
                best.min(d)
            });
            let expected = (0..items.len() as u32)
                .map(|i| (items[i as usize].distance2_to(p), i))
                .fold((f64::INFINITY, u32::MAX), |a, b| if b < a { b } else { a });
            prop_assert_eq!(found, expected);

            let area = Bounds { min: p, max: p.map(|c| c + 1.0) };
            let mut hits = Vec::new();
            tree.any_overlapping(&area, |i| {
                if items[i as usize].overlaps(&area) {
                    hits.push(i);
                }
                false
            });
            hits.sort_unstable();
            let expected: Vec<u32> =
                (0..items.len() as u32).filter(|&i| items[i as usize].overlaps(&area)).collect();
            prop_assert_eq!(hits, expected);
        }
    }

    proptest! {
        #[test]
        fn a_segment_meets_every_box_it_passes(
            items in boxes(),
            from in prop::array::uniform3(-4.0..4.0f64),
            way in prop::array::uniform3(prop_oneof![Just(0.0), -4.0..4.0f64]),
        ) {
            let tree = Bvh::build(&items);
            let mut met = vec![false; items.len()];
            tree.along(from, way, |i| met[i as usize] = true);
            for (item, met) in items.iter().zip(met) {
                let passes = (0..=200).any(|k| {
                    let p = std::array::from_fn(|a| from[a] + way[a] * f64::from(k) / 200.0);
                    item.distance2_to(p) == 0.0
                });
                prop_assert!(met || !passes);
            }
        }
    }

    #[test]
    fn many_equal_and_exponentially_spaced_boxes_stay_shallow() {
        let at = |x: f64| Bounds { min: [x, 0.0, 0.0], max: [x, 0.0, 0.0] };
        for items in [vec![at(1.0); 3000], (0..1000).map(|i| at(0.5f64.powi(i))).collect::<Vec<_>>()] {
            let tree = Bvh::build(&items);
            let mut visited = 0;
            tree.nearest([0.0; 3], f64::INFINITY, |_, best| {
                visited += 1;
                best
            });
            assert_eq!(visited, items.len());
        }
    }
}
