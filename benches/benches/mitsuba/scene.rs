//! Prints before refinement, and the points that paths start from.

use std::sync::Arc;

use pellucid::predict::Object;
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, SurfaceOptions, near_order};
use pellucid_benches::appearance::Error;
use pellucid_benches::prints::unrefined;
use pellucid_benches::solids::{ball, sheet};

/// Of the default inks.
pub const CHANNELS: usize = 3;
/// Spread points that paths start from.
const POINTS: usize = 200;
/// Thickness of a halftoned skin in mm.
const SKIN_MM: f64 = 0.5;
/// The refractive index of a printed surface.
const PRINTED: f64 = 1.5;

/// An object, before it is made.
pub enum Subject {
    /// Halftoned, of so many mm.
    Ball(f64),
    /// Halftoned through and through, so many mm thick.
    Sheet(f64),
    /// A model, so many mm high.
    Model(&'static str, f64),
}

/// The objects of a study.
pub fn all(full: bool) -> Vec<Subject> {
    match full {
        true => vec![
            Subject::Ball(10.0),
            Subject::Sheet(0.5),
            Subject::Model("octostar", 10.0),
            Subject::Model("vase-handle", 10.0),
            Subject::Model("tubes", 10.0),
        ],
        false => vec![Subject::Sheet(0.5)],
    }
}

/// An object.
pub struct Scene {
    /// Its name.
    pub name: String,
    /// Its labels.
    pub labels: LabelGrid,
    /// Surface and materials, index-matched.
    pub object: Object,
    /// Points that paths start from.
    pub chosen: Vec<u32>,
}

impl Scene {
    /// Makes it.
    pub fn new(subject: &Subject, control: &Control<'_>) -> Result<Self, Error> {
        let (name, labels) = match *subject {
            Subject::Ball(mm) => (format!("ball of {mm} mm"), ball(mm, SKIN_MM)),
            Subject::Sheet(mm) => (format!("sheet of {mm} mm"), sheet(mm, SKIN_MM)),
            Subject::Model(model, mm) => {
                (format!("{model} of {mm} mm"), unrefined(model, Some(mm), control)?.1)
            }
        };
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
        let order = near_order(surface.voxels());
        let chosen = order.iter().copied().step_by((order.len() / POINTS).max(1)).take(POINTS).collect();
        let object = Object::new(surface, MaterialTable::cmykw(), 1.0)?;
        Ok(Self { name, labels, object, chosen })
    }

    /// The object as it is printed, with internal reflection.
    pub fn printed(&self) -> Result<Arc<Object>, Error> {
        let (surface, materials) = (self.object.surface().clone(), self.object.materials().clone());
        Ok(Arc::new(Object::new(surface, materials, PRINTED)?))
    }
}
