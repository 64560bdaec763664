//! Solids of the data set as signed distances.

use serde::{Deserialize, Serialize};

/// A solid about the origin; lengths in mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// An axis-parallel box of the given edges, turned by `turn` (a rotation matrix, rows are the box's
    /// axes). Cubes, rotated cubes, cuboids and slabs.
    Box {
        /// Edges along the box's own axes.
        edges: [f64; 3],
        /// Rows: the box's axes in print space.
        turn: [[f64; 3]; 3],
    },
    /// A ball.
    Sphere {
        /// Diameter.
        diameter: f64,
    },
    /// A ring whose axis is `axis`.
    Torus {
        /// Unit axis.
        axis: [f64; 3],
        /// Radius of the ring's centre line.
        ring: f64,
        /// Radius of the ring's cross-section.
        tube: f64,
    },
    /// A hollow ball.
    Shell {
        /// Outer diameter.
        diameter: f64,
        /// Wall thickness.
        wall: f64,
    },
    /// A ball with a ball-shaped hollow cut into its side.
    Bowl {
        /// Outer diameter.
        diameter: f64,
        /// Diameter of the ball cut away.
        cut: f64,
        /// Unit direction of the cut.
        axis: [f64; 3],
    },
    /// A pipe along `axis`; a wall of at least the radius makes it a rod.
    Pipe {
        /// Unit axis.
        axis: [f64; 3],
        /// Outer diameter.
        diameter: f64,
        /// Wall thickness.
        wall: f64,
        /// Length.
        length: f64,
    },
    /// Rounded limbs from the origin.
    Star {
        /// Ends of the limbs' centre lines.
        limbs: Vec<[f64; 3]>,
        /// Their radius.
        radius: f64,
    },
    /// Tapered limbs that flow into each other, as in bodies of animals.
    Blend {
        /// The limbs.
        limbs: Vec<Limb>,
        /// Reach of the fillets between them.
        fillet: f64,
    },
    /// A ball cut from sheets along a gyroid.
    Gyroid {
        /// Diameter of the ball.
        diameter: f64,
        /// Edge of the gyroid's cubic cell.
        period: f64,
        /// Thickness of the sheets where the surface is steepest; up to 1.5 times as much elsewhere.
        thickness: f64,
    },
    /// A ball whose surface rises and falls with a sum of waves.
    Rock {
        /// Diameter without the waves.
        diameter: f64,
        /// Height of the waves' sum above or below the ball, at the most.
        relief: f64,
        /// The waves.
        waves: Vec<Wave>,
    },
}

/// A plane wave, cos(k p + phase).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wave {
    /// Wave vector k in 1/mm.
    pub k: [f64; 3],
    /// Its phase.
    pub phase: f64,
}

/// A tapered rod with rounded ends; lengths in mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limb {
    /// Ends of the centre line.
    pub ends: [[f64; 3]; 2],
    /// Radii at the ends.
    pub radii: [f64; 2],
}

impl Limb {
    /// A lower bound of the distance outside and of the depth inside: exact without taper.
    fn distance(&self, p: [f64; 3]) -> f64 {
        let [from, to] = self.ends;
        let along: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
        let offset: [f64; 3] = std::array::from_fn(|a| p[a] - from[a]);
        let length2 = dot(along, along).max(f64::MIN_POSITIVE);
        let t = (dot(offset, along) / length2).clamp(0.0, 1.0);
        let d: [f64; 3] = std::array::from_fn(|a| offset[a] - t * along[a]);
        (dot(d, d).sqrt() - self.radii[0] - t * (self.radii[1] - self.radii[0])) / self.steepness()
    }

    /// Largest slope of the distance to the centre line less the radius.
    fn steepness(&self) -> f64 {
        let along: [f64; 3] = std::array::from_fn(|a| self.ends[1][a] - self.ends[0][a]);
        let taper = self.radii[1] - self.radii[0];
        (1.0 + taper * taper / dot(along, along).max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// The smaller of two distances, rounded off where they differ by less than `reach`; no steeper than they are.
fn smooth_min(a: f64, b: f64, reach: f64) -> f64 {
    let overlap = (reach - (a - b).abs()).max(0.0);
    a.min(b) - 0.25 * overlap * overlap / reach.max(f64::MIN_POSITIVE)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Distance to a box in two dimensions or more, from the coordinates' excess over the half-edges.
fn box_distance(excess: &[f64]) -> f64 {
    let outside: f64 = excess.iter().map(|d| d.max(0.0).powi(2)).sum::<f64>().sqrt();
    let inside = excess.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    outside + inside.min(0.0)
}

impl Shape {
    /// Signed distance in mm to the surface, negative inside; exact but near a bowl's rim, where it is a
    /// lower bound outside and an upper bound of the depth inside, and for tapered limbs, gyroids and rocks, where it
    /// bounds both from below.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        match self {
            Self::Box { edges, turn } => {
                let excess: [f64; 3] = std::array::from_fn(|a| dot(turn[a], p).abs() - 0.5 * edges[a]);
                box_distance(&excess)
            }
            Self::Sphere { diameter } => dot(p, p).sqrt() - 0.5 * diameter,
            Self::Torus { axis, ring, tube } => {
                let along = dot(*axis, p);
                let radial = (dot(p, p) - along * along).max(0.0).sqrt() - ring;
                radial.hypot(along) - tube
            }
            Self::Shell { diameter, wall } => {
                let r = dot(p, p).sqrt();
                (r - 0.5 * diameter).max(0.5 * diameter - wall - r)
            }
            Self::Bowl { diameter, cut, axis } => {
                let c = axis.map(|v| v * 0.5 * diameter);
                let q = [p[0] - c[0], p[1] - c[1], p[2] - c[2]];
                (dot(p, p).sqrt() - 0.5 * diameter).max(0.5 * cut - dot(q, q).sqrt())
            }
            Self::Pipe { axis, diameter, wall, length } => {
                let along = dot(*axis, p);
                let radial = (dot(p, p) - along * along).max(0.0).sqrt();
                let ends = along.abs() - 0.5 * length;
                let outer = box_distance(&[radial - 0.5 * diameter, ends]);
                outer.max(0.5 * diameter - wall - radial)
            }
            Self::Star { limbs, radius } => {
                let to_limb = |limb: &[f64; 3]| {
                    let t = (dot(p, *limb) / dot(*limb, *limb).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                    let d: [f64; 3] = std::array::from_fn(|a| p[a] - t * limb[a]);
                    dot(d, d).sqrt()
                };
                limbs.iter().map(to_limb).fold(f64::INFINITY, f64::min) - radius
            }
            Self::Blend { limbs, fillet } => limbs
                .iter()
                .map(|limb| limb.distance(p))
                .reduce(|a, b| smooth_min(a, b, *fillet))
                .unwrap_or(f64::INFINITY),
            Self::Gyroid { diameter, period, thickness } => {
                let wave = std::f64::consts::TAU / period;
                let (s, c) = (p.map(|v| (v * wave).sin()), p.map(|v| (v * wave).cos()));
                let level = s[0] * c[1] + s[1] * c[2] + s[2] * c[0];
                // No gradient of the level in units of the wave number is longer than the root of 3.
                let sheet = level.abs() / (wave * 3f64.sqrt()) - 0.5 * thickness;
                sheet.max(dot(p, p).sqrt() - 0.5 * diameter)
            }
            Self::Rock { diameter, relief, waves } => {
                let part = relief / waves.len().max(1) as f64;
                let height: f64 = waves.iter().map(|w| part * (dot(w.k, p) + w.phase).cos()).sum();
                let steepness: f64 = waves.iter().map(|w| part * dot(w.k, w.k).sqrt()).sum();
                (dot(p, p).sqrt() - 0.5 * diameter - height) / (1.0 + steepness)
            }
        }
    }

    /// Half the edges of an axis-parallel box about the origin that holds the solid, in mm.
    pub fn reach(&self) -> [f64; 3] {
        match self {
            Self::Box { edges, turn } => {
                std::array::from_fn(|a| (0..3).map(|b| 0.5 * edges[b] * turn[b][a].abs()).sum())
            }
            Self::Sphere { diameter } | Self::Shell { diameter, .. } | Self::Bowl { diameter, .. } => {
                [0.5 * diameter; 3]
            }
            Self::Gyroid { diameter, .. } => [0.5 * diameter; 3],
            Self::Rock { diameter, relief, .. } => [0.5 * diameter + relief; 3],
            Self::Star { limbs, radius } => {
                std::array::from_fn(|a| limbs.iter().map(|limb| limb[a].abs()).fold(0.0, f64::max) + radius)
            }
            Self::Blend { limbs, fillet } => {
                // Each further limb brings the surface out by a quarter of the fillet at the most.
                let bulge = 0.25 * fillet * limbs.len().saturating_sub(1) as f64;
                let reach = |l: &Limb, a: usize| {
                    let end = |i: usize| l.ends[i][a].abs() + l.radii[i];
                    end(0).max(end(1)) + l.steepness() * bulge
                };
                std::array::from_fn(|a| limbs.iter().map(|l| reach(l, a)).fold(0.0, f64::max))
            }
            Self::Torus { axis, ring, tube } => {
                std::array::from_fn(|a| ring * (1.0 - axis[a] * axis[a]).max(0.0).sqrt() + tube)
            }
            Self::Pipe { axis, diameter, length, .. } => std::array::from_fn(|a| {
                0.5 * length * axis[a].abs() + 0.5 * diameter * (1.0 - axis[a] * axis[a]).max(0.0).sqrt()
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::noise::{hash, unit};

    #[test]
    fn distances_are_one_lipschitz_and_solids_fit_their_reach() {
        let a = 0.6f64;
        let turn = [[a, 0.8, 0.0], [-0.8, a, 0.0], [0.0, 0.0, 1.0]];
        let axis = [0.48, 0.6, 0.64];
        let shapes = [
            Shape::Box { edges: [4.0, 1.0, 7.0], turn },
            Shape::Sphere { diameter: 5.0 },
            Shape::Torus { axis, ring: 3.0, tube: 0.7 },
            Shape::Shell { diameter: 6.0, wall: 0.5 },
            Shape::Bowl { diameter: 6.0, cut: 4.0, axis },
            Shape::Pipe { axis, diameter: 3.0, wall: 0.4, length: 5.0 },
            Shape::Star { limbs: vec![[3.0, 1.0, 0.0], [-1.0, 0.5, -4.0]], radius: 0.6 },
            Shape::Blend {
                limbs: vec![
                    Limb { ends: [[0.0, 0.0, 0.5], [1.0, 0.5, -1.0]], radii: [1.4, 1.0] },
                    Limb { ends: [[1.0, 0.5, -1.0], [3.5, 2.0, 1.0]], radii: [0.8, 0.3] },
                    Limb { ends: [[-2.0, 1.0, 0.0], [-2.0, 1.0, 0.0]], radii: [0.9, 0.9] },
                ],
                fillet: 0.7,
            },
            Shape::Gyroid { diameter: 8.0, period: 4.0, thickness: 0.6 },
            Shape::Rock {
                diameter: 6.0,
                relief: 1.0,
                waves: vec![
                    Wave { k: [2.0, 0.5, 0.0], phase: 0.3 },
                    Wave { k: [-1.0, 2.0, 3.0], phase: 1.0 },
                ],
            },
        ];
        for shape in shapes {
            let reach = shape.reach();
            let mut solid = 0;
            for i in 0..20_000 {
                let at = |n| unit(hash(9, i, n, 0)) - 0.5;
                let p = [at(0), at(1), at(2)].map(|v| v * 12.0);
                let q: [f64; 3] = std::array::from_fn(|a| p[a] + at(3 + a as i64) * 0.2);
                let step = (0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f64>().sqrt();
                let (d, e) = (shape.distance(p), shape.distance(q));
                assert!((d - e).abs() <= step + 1e-9, "{shape:?}");
                if d < 0.0 {
                    solid += 1;
                    assert!((0..3).all(|a| p[a].abs() <= reach[a] + 1e-9), "{shape:?} {p:?}");
                }
            }
            assert!(solid > 10, "{shape:?}");
        }
    }
}
