//! The radiance of patches in one channel, as a function of the materials' coefficients.

use super::{Patch, StackLayer};
use crate::ColorError;
use crate::plane_parallel::{Layer, SolvedLayer, Solver};

/// Scattering and absorption of a material in one channel, 1/mm.
pub(super) type Coefficients = [f64; 2];

/// The patches, with materials by position.
pub(super) struct Model<'a> {
    solver: &'a Solver,
    /// Mean cosine by material.
    g: &'a [f64],
    stacks: Vec<Vec<Piece>>,
    /// By material: the thicknesses of its pure layers.
    thicknesses: Vec<Vec<f64>>,
}

enum Piece {
    /// A pure layer: material, and position among its thicknesses.
    Pure(usize, usize),
    Mixture(Vec<(usize, f64)>, f64),
}

/// The materials' coefficients and what follows from them.
#[derive(Clone)]
pub(super) struct State {
    pub coefficients: Vec<Coefficients>,
    layers: Vec<Vec<SolvedLayer>>,
}

impl<'a> Model<'a> {
    /// Of patches whose materials are all among `names`.
    pub fn new(
        solver: &'a Solver,
        names: &[String],
        g: &'a [f64],
        patches: impl Iterator<Item = &'a Patch>,
    ) -> Self {
        let mut thicknesses = vec![Vec::new(); names.len()];
        let position = |name: &str| names.iter().position(|n| n == name).unwrap_or(0);
        let mut piece = |layer: &StackLayer| match layer.parts() {
            [(name, _)] => {
                let material = position(name);
                let known: &mut Vec<f64> = &mut thicknesses[material];
                let slot = known.iter().position(|mm| *mm == layer.thickness_mm()).unwrap_or_else(|| {
                    known.push(layer.thickness_mm());
                    known.len() - 1
                });
                Piece::Pure(material, slot)
            }
            parts => {
                let parts = parts.iter().map(|(name, share)| (position(name), *share)).collect();
                Piece::Mixture(parts, layer.thickness_mm())
            }
        };
        let stacks = patches.map(|patch| patch.stack.layers().iter().map(&mut piece).collect()).collect();
        Self { solver, g, stacks, thicknesses }
    }

    /// All materials at given coefficients.
    pub fn state(&self, coefficients: Vec<Coefficients>) -> Result<State, ColorError> {
        let layers = (0..coefficients.len())
            .map(|material| self.solve(material, coefficients[material]))
            .collect::<Result<_, _>>()?;
        Ok(State { coefficients, layers })
    }

    /// Changes one material, and returns what puts it back.
    pub fn set(
        &self,
        state: &mut State,
        material: usize,
        coefficients: Coefficients,
    ) -> Result<(Coefficients, Vec<SolvedLayer>), ColorError> {
        let layers = self.solve(material, coefficients)?;
        Ok((
            std::mem::replace(&mut state.coefficients[material], coefficients),
            std::mem::replace(&mut state.layers[material], layers),
        ))
    }

    /// Undoes [`Model::set`].
    pub fn put_back(state: &mut State, material: usize, old: (Coefficients, Vec<SolvedLayer>)) {
        (state.coefficients[material], state.layers[material]) = old;
    }

    fn solve(
        &self,
        material: usize,
        [sigma_s, sigma_a]: Coefficients,
    ) -> Result<Vec<SolvedLayer>, ColorError> {
        let layer = Layer { sigma_s, sigma_a, g: self.g[material], thickness_mm: 0.0 };
        self.solver.solve_layers(&layer, &self.thicknesses[material])
    }

    /// Radiance of a patch by position.
    pub fn radiance(&self, state: &State, patch: usize) -> Result<f64, ColorError> {
        let mut mixed = Vec::new();
        for piece in &self.stacks[patch] {
            if let Piece::Mixture(parts, thickness_mm) = piece {
                let layer = self.mixture(state, parts);
                mixed.push(self.solver.solve_layers(&layer, &[*thickness_mm])?.swap_remove(0));
            }
        }
        let mut mixed = mixed.iter();
        let layers: Vec<&SolvedLayer> = self.stacks[patch]
            .iter()
            .filter_map(|piece| match piece {
                Piece::Pure(material, slot) => state.layers[*material].get(*slot),
                Piece::Mixture(..) => mixed.next(),
            })
            .collect();
        self.solver.radiance_of_solved(&layers)
    }

    /// Coefficients mix by volume; the mean cosine by what scatters.
    fn mixture(&self, state: &State, parts: &[(usize, f64)]) -> Layer {
        let mut layer = Layer { sigma_s: 0.0, sigma_a: 0.0, g: 0.0, thickness_mm: 0.0 };
        for &(material, share) in parts {
            let [sigma_s, sigma_a] = state.coefficients[material];
            layer.sigma_s += share * sigma_s;
            layer.sigma_a += share * sigma_a;
            layer.g += share * sigma_s * self.g[material];
        }
        if layer.sigma_s > 0.0 {
            layer.g /= layer.sigma_s;
        }
        layer
    }

    /// Whether a patch has a material in it.
    pub fn contains(&self, patch: usize, material: usize) -> bool {
        self.stacks[patch].iter().any(|piece| match piece {
            Piece::Pure(own, _) => *own == material,
            Piece::Mixture(parts, _) => parts.iter().any(|(own, share)| *own == material && *share > 0.0),
        })
    }
}
