//! Closed forms as meshes, for tests.

use std::collections::HashMap;

use crate::geometry::{Vec3, add, length, scale, sub};
use crate::{BaseColor, Model, Triangle, Vertex};

/// Positions in millimetres and counter-clockwise triangles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    pub fn cuboid(low: Vec3, high: Vec3) -> Self {
        let positions =
            (0..8).map(|i| std::array::from_fn(|a| if i >> a & 1 == 0 { low[a] } else { high[a] })).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Self { positions, triangles }
    }

    /// A parallelogram spanned by two edges, facing along their cross product.
    pub fn sheet(corner: Vec3, u: Vec3, v: Vec3) -> Self {
        let positions = vec![corner, add(corner, u), add(add(corner, u), v), add(corner, v)];
        Self { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] }
    }

    /// An icosahedron, each face divided into 4^levels and blown up to a sphere.
    pub fn sphere(centre: Vec3, radius: f64, levels: u32) -> Self {
        let g = 0.5 * (1.0 + 5f64.sqrt());
        let mut unit: Vec<Vec3> = [[0.0, 1.0, g], [1.0, g, 0.0], [g, 0.0, 1.0]]
            .iter()
            .flat_map(|p| [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(|s| (*p, s)))
            .map(|(p, s)| {
                let mut signs = s.iter();
                p.map(|c: f64| if c == 0.0 { 0.0 } else { c * signs.next().unwrap() })
            })
            .collect();
        let mut triangles = Vec::new();
        for a in 0..12u32 {
            for b in 0..12 {
                for c in 0..12 {
                    let p = [a, b, c].map(|i| unit[i as usize]);
                    let near = |i: usize, j: usize| (length(sub(p[i], p[j])) - 2.0).abs() < 1e-9;
                    let outward = crate::geometry::dot(crate::geometry::area_vector(p), p[0]) > 0.0;
                    if a < b && a < c && near(0, 1) && near(1, 2) && near(2, 0) && outward {
                        triangles.push([a, b, c]);
                    }
                }
            }
        }
        for _ in 0..levels {
            let mut middles = HashMap::new();
            let mut next = Vec::with_capacity(triangles.len() * 4);
            for [a, b, c] in triangles {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j): (u32, u32)| {
                    *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                        let m = scale(add(unit[i as usize], unit[j as usize]), 0.5);
                        unit.push(scale(m, length(unit[0]) / length(m)));
                        unit.len() as u32 - 1
                    })
                });
                next.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
            }
            triangles = next;
        }
        let positions = unit.iter().map(|p| add(centre, scale(*p, radius / length(*p)))).collect();
        Self { positions, triangles }
    }

    /// A torus about z.
    pub fn torus(major: f64, minor: f64, n: u32, m: u32) -> Self {
        let turn = |i: u32, of: u32| f64::from(i) / f64::from(of) * std::f64::consts::TAU;
        let positions = (0..n * m)
            .map(|k| {
                let (u, v) = (turn(k / m, n), turn(k % m, m));
                let r = major + minor * v.cos();
                [r * u.cos(), r * u.sin(), minor * v.sin()]
            })
            .collect();
        let at = |i: u32, j: u32| i % n * m + j % m;
        let triangles = (0..n * m)
            .map(|k| (k / m, k % m))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        Self { positions, triangles }
    }

    pub fn and(mut self, other: &Self) -> Self {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
        self
    }

    pub fn inverted(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// Keeps the triangles for which `keep` holds, by index.
    pub fn keeping(mut self, keep: impl Fn(usize, [Vec3; 3]) -> bool) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| self.positions[v as usize]);
        self.triangles = self
            .triangles
            .iter()
            .enumerate()
            .filter(|(i, t)| keep(*i, corners(t)))
            .map(|(_, t)| *t)
            .collect();
        self
    }

    pub fn moved(mut self, map: impl Fn(Vec3) -> Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = map(*p));
        self
    }

    pub fn corners(&self) -> Vec<[Vec3; 3]> {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize])).collect()
    }

    /// As a model in metres, white.
    pub fn model(&self) -> Model {
        self.colored(|_| [1.0; 3])
    }

    /// As a model with one colour a triangle, no vertex shared.
    pub fn colored(&self, color: impl Fn(usize) -> [f32; 3]) -> Model {
        let vertices = self.corners().into_iter().enumerate().flat_map(|(i, c)| {
            let [r, g, b] = color(i);
            c.map(|p| Vertex { position_m: p.map(|c| c * 1e-3), uv: [0.0; 2], color: [r, g, b, 1.0] })
        });
        let triangles = (0..self.triangles.len() as u32)
            .map(|i| Triangle { vertices: [3 * i, 3 * i + 1, 3 * i + 2], material: 0 })
            .collect();
        let white = BaseColor { name: "white".into(), factor: [1.0; 4], texture: None, double_sided: false };
        Model::new("shape", vertices.collect(), triangles, vec![white], vec![]).unwrap()
    }
}
