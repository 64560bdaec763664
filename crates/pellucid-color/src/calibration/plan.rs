//! Which materials are fitted to which patches, in which order, from where.

use super::model::Coefficients;
use super::{FitOptions, Measurements, Patch, Stack, StackLayer};
use crate::ColorError;

/// Patches that a material's two coefficients need: one more than unknowns, so that they check each other.
const LEAST_PATCHES: usize = 3;
/// Most materials.
const MAX_MATERIALS: usize = 64;

/// Scattering and absorption in 1/mm from which fits start.
const SCATTERING: [f64; 5] = [0.05, 0.5, 2.0, 8.0, 30.0];
const ABSORPTION: [f64; 5] = [1e-3, 1e-2, 0.1, 1.0, 8.0];

/// Materials that are fitted together.
pub(super) struct Step {
    pub materials: Vec<usize>,
    /// Materials of earlier steps that the patches hold too.
    pub held: Vec<usize>,
    pub patches: Vec<usize>,
    pub starts: Vec<Vec<Coefficients>>,
}

pub(super) struct Plan {
    /// White and black first, if they are there, then inks in the order of the measurements.
    pub names: Vec<String>,
    /// Mean cosine by material.
    pub g: Vec<f64>,
    pub steps: Vec<Step>,
    /// Stacks that tell how sure a material's colour is.
    pub probes: Vec<Patch>,
    /// The material of each probe.
    pub probe_material: Vec<usize>,
    backing: usize,
}

impl Plan {
    pub fn new(measurements: &Measurements, options: &FitOptions) -> Result<Self, ColorError> {
        let list = measurements.list();
        let found = |name: &str| list.iter().any(|m| m.patch.stack.materials().contains(&name));
        let mut names: Vec<String> = Vec::new();
        for name in [&options.white, &options.black] {
            if found(name) && !names.contains(name) {
                names.push(name.clone());
            }
        }
        let backing = names.len();
        for name in list.iter().flat_map(|m| m.patch.stack.materials()) {
            if !names.iter().any(|n| n == name) {
                names.push(name.to_owned());
            }
        }
        if names.len() > MAX_MATERIALS {
            let reason = format!("{} materials; at most {MAX_MATERIALS}", names.len());
            return Err(ColorError::unsupported("measurements", reason));
        }
        if backing < 2 {
            let reason = format!(
                "too few to fit: no patches with {:?} and {:?}, over which inks are measured",
                options.white, options.black
            );
            return Err(ColorError::invalid("measurements", reason));
        }
        let g = names.iter().map(|n| options.g_of.get(n).copied().unwrap_or(options.g)).collect();
        let mut plan =
            Self { names, g, steps: Vec::new(), probes: Vec::new(), probe_material: Vec::new(), backing };
        plan.add_step(measurements, (0..backing).collect())?;
        for ink in backing..plan.names.len() {
            plan.add_step(measurements, vec![ink])?;
        }
        plan.add_probes(options)?;
        Ok(plan)
    }

    fn add_step(&mut self, measurements: &Measurements, materials: Vec<usize>) -> Result<(), ColorError> {
        let last = materials.iter().copied().max().unwrap_or(0);
        let position = |name: &str| self.names.iter().position(|n| n == name).unwrap_or(usize::MAX);
        let list = measurements.list();
        let holds = |patch: &Patch, m: usize| patch.stack.materials().iter().any(|n| position(n) == m);
        let fits = |patch: &Patch| {
            !patch.check
                && patch.stack.materials().iter().all(|n| position(n) <= last)
                && materials.iter().any(|&m| holds(patch, m))
        };
        let patches: Vec<usize> = (0..list.len()).filter(|&i| fits(&list[i].patch)).collect();
        for &material in &materials {
            let mut stacks: Vec<&Stack> = Vec::new();
            for &i in patches.iter().filter(|&&i| holds(&list[i].patch, material)) {
                if !stacks.contains(&&list[i].patch.stack) {
                    stacks.push(&list[i].patch.stack);
                }
            }
            if stacks.len() < LEAST_PATCHES {
                let reason = format!(
                    "too few to fit {:?}: {} different stacks of it with nothing but white and black; measure at least \
                     {LEAST_PATCHES}, of several thicknesses, over white and over black",
                    self.names[material],
                    stacks.len()
                );
                return Err(ColorError::invalid("measurements", reason));
            }
        }
        let held = (0..self.names.len())
            .filter(|m| !materials.contains(m) && patches.iter().any(|&i| holds(&list[i].patch, *m)))
            .collect();
        let starts = self.starts(&materials);
        self.steps.push(Step { materials, held, patches, starts });
        Ok(())
    }

    /// A grid over what resins are; white scatters more than it absorbs, black is the other way round.
    fn starts(&self, materials: &[usize]) -> Vec<Vec<Coefficients>> {
        let mut starts = vec![Vec::new()];
        for &material in materials {
            let (scattering, absorption): (&[f64], &[f64]) = match material {
                m if m >= self.backing => (&SCATTERING, &ABSORPTION),
                0 => (&SCATTERING[2..], &ABSORPTION[..3]),
                _ => (&SCATTERING[..4], &ABSORPTION[3..]),
            };
            starts = starts
                .iter()
                .flat_map(|start: &Vec<Coefficients>| {
                    let pairs = scattering.iter().flat_map(|&s| absorption.iter().map(move |&a| [s, a]));
                    pairs.map(|pair| start.iter().copied().chain([pair]).collect())
                })
                .collect();
        }
        starts
    }

    fn add_probes(&mut self, options: &FitOptions) -> Result<(), ColorError> {
        for (material, name) in self.names.iter().enumerate() {
            for (mm, below) in [(0.2, &options.white), (0.2, &options.black), (1.0, &options.black)] {
                let stack =
                    Stack::new(vec![StackLayer::pure(name, mm)?, StackLayer::pure(below, f64::INFINITY)?])?;
                self.probes.push(Patch { id: String::new(), stack, check: true });
                self.probe_material.push(material);
            }
        }
        Ok(())
    }

    /// Materials in the order of a table: inks, black, white.
    pub fn table_order(&self) -> Vec<usize> {
        (self.backing..self.names.len()).chain((0..self.backing).rev()).collect()
    }
}
