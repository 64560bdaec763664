//! The draw of each volume from a recipe: shape, size, material arrangement.

use std::f64::consts::TAU;

use pellucid_voxel::{Material, MaterialTable, VoxelError};
use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::volume::noise::{hash, unit};
use crate::volume::shape::{Limb, Shape, Wave};
use crate::volume::texture::{Dither, Pattern, Texture, random_mixture, tint};
use crate::{Recipe, ShapeClass, Split};

/// Purposes of a volume's random numbers beside its draw (0) and its points (1).
const OTHER_INKS: u64 = 6;
/// And the one after it.
pub(crate) const NEIGHBOURS: u64 = 7;
const PALE: u64 = 9;

impl Recipe {
    /// Solid and arrangement of a volume of a split, for `materials` materials of which the last is white.
    pub fn draw(&self, split: &Split, volume: u32, materials: usize) -> (Shape, Texture) {
        let mut rng = self.rng(split, volume, 0);
        let shape = self.draw_shape(split, &mut rng);
        let mut texture = draw_texture(&mut rng, materials);
        let mut rng = self.rng(split, volume, PALE);
        if split.pale.is_some_and(|pale| uniform(&mut rng) < pale.share) {
            texture.palette.iter_mut().for_each(|mixture| *mixture = tint(&mut rng, materials));
        }
        (shape, texture)
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

    /// The shape family of a volume of a split.
    pub fn class(&self, split: &Split, volume: u32) -> ShapeClass {
        draw_class(split, &mut self.rng(split, volume, 0))
    }

    /// The materials of a volume of a split: those of `table` in the split's density, or other inks.
    ///
    /// # Errors
    /// When a coefficient is past what a table holds.
    pub(crate) fn draw_materials(
        &self,
        split: &Split,
        volume: u32,
        table: &MaterialTable,
    ) -> Result<MaterialTable, VoxelError> {
        let mut rng = self.rng(split, volume, OTHER_INKS);
        let inks = split.other_inks.filter(|inks| uniform(&mut rng) < inks.share);
        let mut factor = |most: f64| most.powf(2.0 * uniform(&mut rng) - 1.0);
        let density = split.density * inks.map_or(1.0, |inks| factor(inks.density));
        let mut scaled = |values: &[f32]| -> Vec<f32> {
            let mut scale =
                |v: &f32| (f64::from(*v) * density * inks.map_or(1.0, |inks| factor(inks.each))) as f32;
            values.iter().map(&mut scale).collect()
        };
        let materials = table.materials().iter().map(|m| Material {
            name: m.name.clone(),
            sigma_s: scaled(&m.sigma_s),
            sigma_a: scaled(&m.sigma_a),
            g: m.g.clone(),
        });
        MaterialTable::over(table.spectrum().clone(), materials.collect())
    }

    fn draw_shape(&self, split: &Split, rng: &mut Pcg64) -> Shape {
        let class = draw_class(split, rng);
        let large_share = split.pale.map_or(self.large_share, |pale| pale.large_share);
        let [low, high] =
            if uniform(rng) < large_share { [self.size_mm[1], self.large_mm] } else { self.size_mm };
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
            ShapeClass::Blend => draw_blend(rng, size),
            ShapeClass::Star => {
                let radius = size * between(rng, 0.06, 0.15);
                let limbs = (0..4 + (uniform(rng) * 3.0) as usize).map(|_| {
                    let length = (0.5 * size - radius) * between(rng, 0.5, 1.0);
                    random_rotation(rng)[0].map(|v| v * length)
                });
                Shape::Star { limbs: limbs.collect(), radius }
            }
            ShapeClass::Gyroid => Shape::Gyroid {
                diameter: size,
                period: between(rng, 3.0, 6.0),
                thickness: between(rng, 0.4, 1.0),
            },
            ShapeClass::Rock => draw_rock(rng, size),
        }
    }
}

/// A body with limbs that grow from its and each other's ends, no longer than `size` along any axis but for
/// fillets and the thinnest limbs' least radius.
fn draw_blend(rng: &mut Pcg64, size: f64) -> Shape {
    /// Least radius in mm.
    const THINNEST: f64 = 0.2;
    let thickness = between(rng, 0.4, 1.2);
    let mut limbs: Vec<Limb> = Vec::new();
    for _ in 0..3 + (uniform(rng) * 6.0) as usize {
        let (from, most) = match limbs.len() {
            0 => ([0.0; 3], 1.0),
            n => {
                let parent = limbs[(uniform(rng) * n as f64) as usize % n];
                let end = usize::from(uniform(rng) < 0.5);
                (parent.ends[end], parent.radii[end])
            }
        };
        let direction = random_rotation(rng)[0];
        let length = between(rng, 0.5, 3.0);
        let root = most * between(rng, 0.4, 1.0);
        limbs.push(Limb {
            ends: [from, std::array::from_fn(|a| from[a] + length * direction[a])],
            radii: [root, root * between(rng, 0.4, 1.0)],
        });
    }
    for limb in &mut limbs {
        limb.radii = limb.radii.map(|r| r * thickness);
    }
    let edge = |a: usize, sign: f64| {
        let ends = limbs.iter().flat_map(|l| (0..2).map(|i| sign * l.ends[i][a] + l.radii[i]));
        ends.fold(f64::NEG_INFINITY, f64::max)
    };
    let (high, low): ([f64; 3], [f64; 3]) =
        (std::array::from_fn(|a| edge(a, 1.0)), std::array::from_fn(|a| -edge(a, -1.0)));
    let longest = (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max);
    let scale = size / longest;
    for limb in &mut limbs {
        limb.ends = limb.ends.map(|p| std::array::from_fn(|a| scale * (p[a] - 0.5 * (low[a] + high[a]))));
        limb.radii = limb.radii.map(|r| (scale * r).max(THINNEST));
    }
    let fillet = scale * thickness * between(rng, 0.1, 0.8);
    Shape::Blend { limbs, fillet }
}

/// A ball of about `size` with furrows of a few millimetres and finer ones on them.
fn draw_rock(rng: &mut Pcg64, size: f64) -> Shape {
    let waves = (0..4 + (uniform(rng) * 5.0) as usize).map(|_| {
        let length = 0.8 * 6f64.powf(uniform(rng));
        let direction = random_rotation(rng)[0];
        Wave { k: direction.map(|d| d * TAU / length), phase: TAU * uniform(rng) }
    });
    let waves: Vec<Wave> = waves.collect();
    let relief = size * between(rng, 0.05, 0.25);
    Shape::Rock { diameter: size - 2.0 * relief, relief, waves }
}

fn draw_class(split: &Split, rng: &mut Pcg64) -> ShapeClass {
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
    class
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
        (false, 0..=1) => f64::INFINITY,
        (false, 2..=4) => 0.03 * 8f64.powf(uniform(rng)),
        _ => 0.25 * 12f64.powf(uniform(rng)),
    };
    if !print && uniform(rng) < 0.1 {
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
}
