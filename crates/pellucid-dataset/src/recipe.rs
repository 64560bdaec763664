//! What a data set consists of: a small JSON file from which every volume follows.

use pellucid_voxel::Pitch;
use rand_core::Rng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::DatasetError;
use crate::noise::{hash, unit};
use crate::shape::Shape;
use crate::texture::{Dither, Pattern, Texture, random_mixture};

/// Families of solids. The first four are the paper's (section 4.1), the others what it lists as limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShapeClass {
    /// An axis-parallel cube.
    Cube,
    /// A cube turned at random.
    RotatedCube,
    /// A ball.
    Sphere,
    /// A thin cuboid, 1 to 2.5 mm.
    Cuboid,
    /// A slab of 0.2 to 1 mm, axis-parallel or turned.
    Slab,
    /// A ring: a closed loop.
    Torus,
    /// A hollow ball.
    Hollow,
    /// A ball with a hollow cut into it.
    Concave,
    /// A pipe or a rod.
    Tube,
}

/// A use of the data set with volumes of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Such as `train`, `validation`, `thin`.
    pub name: String,
    /// Number of volumes.
    pub volumes: u32,
    /// Surface points drawn from each volume.
    pub points: u32,
    /// Paths a point and channel of the labels.
    pub spp: u32,
    /// Shape families and their weights.
    pub shapes: Vec<(ShapeClass, f64)>,
    /// Factor on all coefficients: 4 and 0.25 are the paper's Figure 11.
    pub density: f64,
}

/// A data set. The same recipe gives the same volumes everywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// The set's name.
    pub name: String,
    /// Seed of everything.
    pub seed: u64,
    /// Voxel edges.
    pub pitch: Pitch,
    /// Smallest and largest edge or diameter of most solids in mm.
    pub size_mm: [f64; 2],
    /// Largest edge or diameter of the others in mm: they go from [`Recipe::size_mm`]'s end up to here.
    pub large_mm: f64,
    /// Part of the volumes that are large, within 0..=1.
    pub large_share: f64,
    /// Refractive index of the boundary.
    pub refractive_index: f64,
    /// The uses.
    pub splits: Vec<Split>,
}

impl Recipe {
    /// Checks the ranges of a recipe.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] naming the field.
    pub fn check(&self) -> Result<(), DatasetError> {
        let invalid =
            |field: String, reason: &str| Err(DatasetError::Invalid { field, reason: reason.into() });
        let [low, high] = self.size_mm;
        if !(1.0..=100.0).contains(&low) || !(low..=100.0).contains(&high) {
            return invalid("size_mm".into(), "must ascend within 1 to 100 mm");
        }
        if !(high..=100.0).contains(&self.large_mm) {
            return invalid("large_mm".into(), "must lie between the end of size_mm and 100");
        }
        if !(0.0..=1.0).contains(&self.large_share) {
            return invalid("large_share".into(), "must lie within 0 to 1");
        }
        if !(1.0..=4.0).contains(&self.refractive_index) {
            return invalid("refractive_index".into(), "must lie within 1 to 4");
        }
        for (i, split) in self.splits.iter().enumerate() {
            let field = |name: &str| format!("splits[{i}] {:?}, {name}", split.name);
            if self.splits[..i].iter().any(|s| s.name == split.name) {
                return invalid(field("name"), "is used twice");
            }
            if split.volumes == 0 || split.points == 0 || split.spp == 0 {
                return invalid(field("volumes, points and spp"), "must be at least 1");
            }
            let weights_fine = split.shapes.iter().all(|(_, w)| w.is_finite() && *w > 0.0);
            if split.shapes.is_empty() || !weights_fine {
                return invalid(field("shapes"), "needs at least one family, weights above 0");
            }
            if !(1e-6..=1e6).contains(&split.density) {
                return invalid(field("density"), "must lie within 1e-6 to 1e6");
            }
        }
        Ok(())
    }

    /// The split of a name.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] listing the names there are.
    pub fn split(&self, name: &str) -> Result<&Split, DatasetError> {
        self.splits.iter().find(|s| s.name == name).ok_or_else(|| DatasetError::Invalid {
            field: format!("split {name:?}"),
            reason: format!(
                "the recipe has {}",
                self.splits.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ")
            ),
        })
    }

    /// Solid and arrangement of a volume of a split, for `materials` materials of which the last is white.
    pub fn draw(&self, split: &Split, volume: u32, materials: usize) -> (Shape, Texture) {
        let mut rng = self.rng(split, volume, 0);
        let shape = self.draw_shape(split, &mut rng);
        (shape, draw_texture(&mut rng, materials))
    }

    /// The random numbers of a volume; `purpose` tells independent uses apart.
    pub(crate) fn rng(&self, split: &Split, volume: u32, purpose: u64) -> Pcg64 {
        // Splits must not share volumes: the name decides the stream.
        let name = split
            .name
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        rng(self.seed ^ hash(name, 0, 0, 0), purpose, u64::from(volume))
    }

    fn draw_shape(&self, split: &Split, rng: &mut Pcg64) -> Shape {
        let total: f64 = split.shapes.iter().map(|(_, w)| w).sum();
        let mut left = total * uniform(rng);
        let mut class = split.shapes[0].0;
        for (c, w) in &split.shapes {
            class = *c;
            left -= w;
            if left < 0.0 {
                break;
            }
        }
        let [low, high] =
            if uniform(rng) < self.large_share { [self.size_mm[1], self.large_mm] } else { self.size_mm };
        let size = low * (high / low).powf(uniform(rng));
        let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let turned = random_rotation(rng);
        let axis = turned[0];
        match class {
            ShapeClass::Cube => Shape::Box { edges: [size; 3], turn: upright },
            ShapeClass::RotatedCube => Shape::Box { edges: [size * 0.7; 3], turn: turned },
            ShapeClass::Sphere => Shape::Sphere { diameter: size },
            ShapeClass::Cuboid | ShapeClass::Slab => {
                let thickness = match class {
                    ShapeClass::Cuboid => between(rng, 1.0, 2.5),
                    _ => 0.2 * 5f64.powf(uniform(rng)),
                };
                let mut edges = [size; 3];
                edges[(uniform(rng) * 3.0) as usize % 3] = thickness;
                let turn = if uniform(rng) < 0.7 { upright } else { turned };
                Shape::Box { edges, turn }
            }
            ShapeClass::Torus => {
                let tube = (size * between(rng, 0.05, 0.2)).max(0.15);
                Shape::Torus { axis, ring: 0.5 * size - tube, tube }
            }
            ShapeClass::Hollow => {
                Shape::Shell { diameter: size, wall: between(rng, 0.3, 1.5).min(0.4 * size) }
            }
            ShapeClass::Concave => Shape::Bowl { diameter: size, cut: size * between(rng, 0.4, 0.9), axis },
            ShapeClass::Tube => {
                let diameter = between(rng, 0.6, 4.0).min(size);
                Shape::Pipe {
                    axis,
                    diameter,
                    wall: (diameter * between(rng, 0.15, 0.6)).max(0.2),
                    length: size,
                }
            }
        }
    }
}

/// Random numbers addressed by seed, purpose and item.
pub(crate) fn rng(seed: u64, purpose: u64, item: u64) -> Pcg64 {
    let word = |i| u128::from(hash(seed, purpose as i64, item as i64, i));
    Pcg64::new(word(0) << 64 | word(1), word(2) << 64 | word(3))
}

fn uniform(rng: &mut Pcg64) -> f64 {
    unit(rng.next_u64())
}

fn between(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(rng)
}

/// A rotation drawn uniformly, from a unit quaternion (Shoemake 1992).
fn random_rotation(rng: &mut Pcg64) -> [[f64; 3]; 3] {
    use std::f64::consts::TAU;
    let (u, a, b) = (uniform(rng), TAU * uniform(rng), TAU * uniform(rng));
    let (x, y) = ((1.0 - u).sqrt() * a.sin(), (1.0 - u).sqrt() * a.cos());
    let (z, w) = (u.sqrt() * b.sin(), u.sqrt() * b.cos());
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn draw_texture(rng: &mut Pcg64, materials: usize) -> Texture {
    let mut core = vec![0.0; materials];
    core[materials - 1] = 1.0;
    // Two families: what a refined print looks like, and arrangements of every kind (paper, section 4.1).
    let print = uniform(rng) < 0.5;
    let kind = (uniform(rng) * 10.0) as u32;
    let pattern = match (print, kind) {
        (true, 0..=5) | (false, 5..=6) => Pattern::Blend,
        (true, 6..=7) | (false, 2..=4) => Pattern::Bands,
        (false, 0) => Pattern::Constant,
        (false, 1) => Pattern::Speckle,
        _ => Pattern::Cells,
    };
    let colors = 2 + (uniform(rng) * 5.0) as usize;
    let palette = (0..colors).map(|_| random_mixture(rng, materials)).collect();
    let depth_mm = match (print, (uniform(rng) * 10.0) as u32) {
        (true, _) => 0.05 * 40f64.powf(uniform(rng)),
        // The whole volume, a thin coat of some voxels, or an extrusion of varied depth.
        (false, 0..=2) => f64::INFINITY,
        (false, 3..=4) => 0.03 * 8f64.powf(uniform(rng)),
        _ => 0.25 * 12f64.powf(uniform(rng)),
    };
    if !print && uniform(rng) < 0.15 {
        core = random_mixture(rng, materials);
    }
    let dither = uniform(rng);
    Texture {
        seed: rng.next_u64(),
        pattern,
        scale_mm: if print { 0.3 * 30f64.powf(uniform(rng)) } else { 0.08 * 60f64.powf(uniform(rng)) },
        octaves: 1 + (uniform(rng) * 3.0) as u32,
        palette,
        depth_mm,
        relief: if uniform(rng) < 0.5 { 0.0 } else { uniform(rng) },
        fade: print && uniform(rng) < 0.5,
        core,
        dither: match print {
            true if dither < 0.7 => Dither::Blue,
            _ if dither < 0.8 => Dither::Recurrence,
            _ => Dither::White,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn recipe() -> Recipe {
        let split = |name: &str| Split {
            name: name.into(),
            volumes: 4,
            points: 100,
            spp: 16,
            shapes: vec![(ShapeClass::Cube, 1.0), (ShapeClass::Slab, 1.0), (ShapeClass::Tube, 2.0)],
            density: 1.0,
        };
        Recipe {
            name: "test".into(),
            seed: 5,
            pitch: Pitch::j750(),
            size_mm: [2.0, 4.0],
            large_mm: 5.0,
            large_share: 0.1,
            refractive_index: 1.5,
            splits: vec![split("train"), split("test")],
        }
    }

    #[test]
    fn volumes_follow_from_the_recipe_and_differ() {
        let r = recipe();
        let a = r.draw(&r.splits[0], 0, 5);
        assert_eq!(a, r.draw(&r.splits[0], 0, 5));
        assert_ne!(a, r.draw(&r.splits[0], 1, 5));
        assert_ne!(a, r.draw(&r.splits[1], 0, 5));
        let json = serde_json::to_string(&r).unwrap();
        assert_eq!(serde_json::from_str::<Recipe>(&json).unwrap(), r);
    }

    #[test]
    fn rotations_are_orthonormal() {
        let mut rng = Pcg64::new(3, 4);
        for _ in 0..100 {
            let m = random_rotation(&mut rng);
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|a| m[i][a] * m[j][a]).sum();
                    assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn names_the_bad_field() {
        let mut r = recipe();
        r.splits[1].density = 0.0;
        assert!(r.check().unwrap_err().to_string().contains("\"test\", density"));
        r.splits[1] = r.splits[0].clone();
        assert!(r.check().unwrap_err().to_string().contains("used twice"));
        assert!(r.split("nowhere").unwrap_err().to_string().contains("train"));
    }
}
