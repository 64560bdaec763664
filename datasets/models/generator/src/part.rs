//! Closed triangle meshes and the checks every model passes.

use std::collections::HashMap;

use crate::vec3::{V3, cross, dot, sub};

/// A mesh in print millimetres, z up.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Vertex positions.
    pub positions: Vec<V3>,
    /// Texture coordinates, (0, 0) at the image's top left corner.
    pub uv: Vec<[f64; 2]>,
    /// Corner indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Part {
    /// Appends another mesh.
    pub fn append(&mut self, other: Part) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.uv.extend(other.uv);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|i| i + base)));
    }

    /// Signed volume: positive when triangles face outwards.
    pub fn volume_mm3(&self) -> f64 {
        let corner = |i: u32| self.positions[i as usize];
        self.triangles.iter().map(|t| dot(corner(t[0]), cross(corner(t[1]), corner(t[2])))).sum::<f64>() / 6.0
    }

    /// The mesh with its triangles facing outwards.
    pub fn outward(mut self) -> Part {
        if self.volume_mm3() < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }

    /// Lower and upper corner of the bounding box.
    pub fn bounds(&self) -> (V3, V3) {
        let mut lo = [f64::INFINITY; 3];
        let mut hi = [f64::NEG_INFINITY; 3];
        for p in &self.positions {
            for a in 0..3 {
                lo[a] = lo[a].min(p[a]);
                hi[a] = hi[a].max(p[a]);
            }
        }
        (lo, hi)
    }

    /// Index of the first vertex at the same place, for every vertex. Places are compared as the
    /// file stores them.
    pub fn welded(&self) -> Vec<u32> {
        let mut first = HashMap::new();
        let key = |p: &V3| p.map(|v| (crate::glb::metres(v)).to_bits());
        self.positions.iter().enumerate().map(|(i, p)| *first.entry(key(p)).or_insert(i as u32)).collect()
    }

    /// Why the mesh is not closed and consistently oriented, or `None`: every directed edge
    /// between welded vertices must occur once and its reverse once.
    pub fn defect(&self) -> Option<String> {
        let weld = self.welded();
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for t in &self.triangles {
            let t = t.map(|i| weld[i as usize]);
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                return Some(format!("degenerate triangle at {:?}", self.positions[t[0] as usize]));
            }
            for k in 0..3 {
                *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
            }
        }
        for (&(a, b), &n) in &edges {
            if n != 1 || edges.get(&(b, a)) != Some(&1) {
                let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
                return Some(format!("edge {p:?} to {q:?} has {n} triangles on this side"));
            }
        }
        (self.volume_mm3() <= 0.0).then(|| "inside out".to_owned())
    }

    /// Unit normals, smooth over welded vertices, for the pictures.
    pub fn normals(&self) -> Vec<V3> {
        let weld = self.welded();
        let mut sums = vec![[0.0; 3]; self.positions.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let n = cross(sub(b, a), sub(c, a));
            for &i in t {
                let sum = &mut sums[weld[i as usize] as usize];
                *sum = crate::vec3::add(*sum, n);
            }
        }
        weld.iter().map(|&w| crate::vec3::unit(sums[w as usize])).collect()
    }
}
