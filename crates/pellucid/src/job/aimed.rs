//! The second artefact: what each surface voxel should show, and what can be reached.

use std::sync::Arc;

use pellucid_color::gamut::{DEFAULT_THICKNESSES_MM, ThicknessGamut};
use pellucid_color::mixture::table::DEFAULT_NODES;
use pellucid_color::{Gamut, MatchOptions, MediaWhite, MixtureModel, Rendering, RenderingIntent, Viewing};
use pellucid_core::Control;
use pellucid_mesh::MeshReport;
use pellucid_predict::Object;
use pellucid_refine::{GamutInk, InkModel, Problem};
use pellucid_voxel::{LabelGrid, NearestSurface};
use rayon::prelude::*;

use crate::job::placed::{Placed, THICK_MM};
use crate::record::ModelRecord;
use crate::report::Thinness;
use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob};

/// Nodes a side of the gamut tables of thin parts.
const THIN_NODES: usize = 17;

/// An ink model that artefacts share.
pub type SharedInk = Arc<dyn InkModel + Send + Sync>;

/// An object with its targets. Colours are linear RGB relative to the print's white.
#[derive(Clone)]
#[non_exhaustive]
pub struct Aimed {
    /// Which model it is.
    pub model: ModelRecord,
    /// Surface, materials and boundary: what a predictor binds to.
    pub object: Arc<Object>,
    /// White where it is solid.
    pub solid: LabelGrid,
    /// The nearest surface voxel of each voxel within the coloured depth.
    pub nearest: NearestSurface,
    /// Printable colours and their mixtures; may be replaced by a model of one's own.
    pub ink: SharedInk,
    /// From radiance to colour.
    pub viewing: Viewing,
    /// What each surface voxel should show.
    pub target: Vec<[f32; 3]>,
    /// The target brought within reach of the gamut alone, as if all material were thick.
    pub gamut_target: Vec<[f32; 3]>,
    /// The target brought within reach of gamut and thickness.
    pub printable_target: Vec<[f32; 3]>,
    /// Thickness in mm below each surface voxel, along its normal; at most 10.
    pub thickness_mm: Vec<f32>,
    /// Where material is thin.
    pub thin: Thinness,
    /// Size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// The model's mesh, where there was one.
    pub mesh: Option<MeshReport>,
}

impl Aimed {
    /// The refinement's problem.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            object: &self.object,
            nearest: &self.nearest,
            ink: &*self.ink,
            viewing: &self.viewing,
            target: &self.target,
            printable_target: &self.printable_target,
        }
    }
}

impl PrintJob {
    /// Finds what the materials can show, and brings the texture's colours within reach.
    ///
    /// # Errors
    /// [`PrintError::Color`] when the materials make no mixtures, [`PrintError::Cancelled`].
    pub fn aim(&self, placed: Placed, monitor: &Monitor<'_>) -> Result<Aimed, PrintError> {
        monitor.run(Stage::Color, |control| self.aim_within(placed, control))
    }

    fn aim_within(&self, placed: Placed, control: &Control<'_>) -> Result<Aimed, PrintError> {
        let s = &self.settings;
        let (gamut, by_thickness) = self.gamuts(control)?;
        let viewing = gamut.model().viewing();
        let white = MediaWhite::new(gamut.model().media_white())?;
        let intent = match s.absolute {
            true => RenderingIntent::AbsoluteColorimetric,
            false => RenderingIntent::RelativeColorimetric,
        };
        let rendering = Rendering { intent, ..Rendering::default() };
        let target: Vec<[f32; 3]> = placed
            .texture
            .par_iter()
            .map(|rgb| rendering.target(rgb.map(f64::from), white, gamut.black()).map(|v| v as f32))
            .collect();
        control.check()?;
        // Of thin parts by the same table, whose own error is not the thickness's.
        let within_reach = |(&rgb, &mm): (&[f32; 3], &f32)| match mm < THICK_MM as f32 {
            true => [f64::INFINITY, f64::from(mm)].map(|mm| by_thickness.map(rgb, mm).rgb),
            false => [gamut.map(rgb).rgb; 2],
        };
        let reached = target.par_iter().zip(&placed.thickness_mm).map(within_reach);
        let (gamut_target, printable_target) = reached.map(|[thick, own]| (thick, own)).unzip();
        control.check()?;
        let object = Object::new(placed.surface, s.materials.clone(), s.refractive_index)?;
        Ok(Aimed {
            model: placed.model,
            object: Arc::new(object),
            solid: placed.solid,
            nearest: placed.nearest,
            ink: Arc::new(GamutInk::new(gamut, &s.materials)),
            viewing,
            target,
            gamut_target,
            printable_target,
            thin: Thinness::of(&placed.thickness_mm),
            thickness_mm: placed.thickness_mm,
            extent_mm: placed.extent_mm,
            mesh: placed.mesh,
        })
    }

    /// Colours of thick prints, and of parts by their thickness.
    fn gamuts(&self, control: &Control<'_>) -> Result<(Gamut, ThicknessGamut), PrintError> {
        let s = &self.settings;
        let options = MatchOptions::default();
        let thick = MixtureModel::under(&s.materials, "white", s.refractive_index, s.illuminant)?;
        let by_thickness =
            ThicknessGamut::build(&thick, &DEFAULT_THICKNESSES_MM, options, THIN_NODES, control)?;
        let gamut = Gamut::build(thick, options, DEFAULT_NODES, &control.silent())?;
        Ok((gamut, by_thickness))
    }
}
