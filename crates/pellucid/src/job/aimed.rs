//! The second artefact: what each surface voxel should show, and what can be reached.

use std::borrow::Cow;
use std::sync::Arc;

use pellucid_color::gamut::{DEFAULT_THICKNESSES_MM, ThicknessGamut};
use pellucid_color::mixture::table::DEFAULT_NODES;
use pellucid_color::spectrum::Illuminant;
use pellucid_color::upsampling::Upsampling;
use pellucid_color::{Gamut, MatchOptions, MediaWhite, MixtureModel, Rendering, RenderingIntent, Viewing};
use pellucid_core::Control;
use pellucid_mesh::MeshReport;
use pellucid_predict::Object;
use pellucid_refine::{Aim, GamutInk, InkModel, Problem};
use pellucid_voxel::{AIR, LabelGrid, NearestSurface};
use rayon::prelude::*;

use crate::job::clear::{ClearParts, combined};
use crate::job::placed::{Placed, THICK_MM};
use crate::record::ModelRecord;
use crate::report::Thinness;
use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob};

/// Nodes a side of the gamut tables of thin parts.
const THIN_NODES: usize = 17;

/// Colours whose reflectances are found between looks at the cancellation flag.
const UPSAMPLED: usize = 4096;

/// An ink model that artefacts share.
pub type SharedInk = Arc<dyn InkModel + Send + Sync>;

/// Colours of thick prints, and of parts by their thickness.
pub(super) struct ColorTables {
    ink: Arc<GamutInk>,
    by_thickness: ThicknessGamut,
}

/// What the print should look like under one more light.
#[derive(Clone)]
pub struct FurtherAim {
    /// The light.
    pub illuminant: Illuminant,
    /// From radiance to colour under it.
    pub viewing: Viewing,
    /// What each surface voxel should show, relative to the print's white under that light.
    pub target: Vec<[f32; 3]>,
    /// What it should show and can.
    pub printable_target: Vec<[f32; 3]>,
}

impl FurtherAim {
    /// The refinement's aim.
    pub fn aim(&self) -> Aim<'_> {
        Aim { viewing: &self.viewing, printable_target: &self.printable_target }
    }
}

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
    /// The nearest surface voxel of each voxel within the coloured depth; of none where the job refines in sections
    /// ([`PrintSettings::section_mm`](crate::PrintSettings)).
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
    /// The printable target in further viewings: those of [`PrintSettings::also_under`](crate::PrintSettings).
    pub further: Vec<FurtherAim>,
    /// Where material is thin.
    pub thin: Thinness,
    /// Size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// The model's mesh, where there was one.
    pub mesh: Option<MeshReport>,
    /// What is printed in clear resin, beside the object.
    pub clear: Option<ClearParts>,
}

impl Aimed {
    /// Labels of the object with the clear voxels beside them: what is printed.
    pub fn with_clear<'l>(&self, labels: &'l LabelGrid) -> Cow<'l, LabelGrid> {
        match &self.clear {
            Some(parts) => Cow::Owned(combined(labels, &parts.grid, |l, c| if l == AIR { c } else { l })),
            None => Cow::Borrowed(labels),
        }
    }

    /// What the refinement aims at in further viewings, for [`Problem::further`].
    pub fn further_aims(&self) -> Vec<Aim<'_>> {
        self.further.iter().map(FurtherAim::aim).collect()
    }

    /// The refinement's problem, without further viewings.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            object: &self.object,
            nearest: &self.nearest,
            ink: &*self.ink,
            viewing: &self.viewing,
            target: &self.target,
            printable_target: &self.printable_target,
            further: &[],
        }
    }
}

impl PrintJob {
    /// Finds what the materials can show, and brings the texture's colours within reach.
    ///
    /// # Errors
    /// [`PrintError::Color`] when the materials make no mixtures, [`PrintError::Cancelled`].
    pub fn aim(&self, placed: Placed, monitor: &Monitor<'_>) -> Result<Aimed, PrintError> {
        monitor.run(Stage::Color, |control| {
            let tables = self.color_tables(control)?;
            self.aim_by(&tables, placed, control)
        })
    }

    /// [`PrintJob::aim`] by tables that are there already.
    pub(super) fn aim_by(
        &self,
        tables: &ColorTables,
        placed: Placed,
        control: &Control<'_>,
    ) -> Result<Aimed, PrintError> {
        let s = &self.settings;
        let ColorTables { ink, by_thickness } = tables;
        let gamut = ink.gamut();
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
        let (gamut_target, printable_target): (Vec<_>, Vec<_>) =
            reached.map(|[thick, own]| (thick, own)).unzip();
        control.check()?;
        let further = self.further(&viewing, [&target, &printable_target], placed.texture_under, control)?;
        let object = Object::new(placed.surface, self.inks.clone(), s.refractive_index)?;
        Ok(Aimed {
            model: placed.model,
            object: Arc::new(object),
            solid: placed.solid,
            nearest: placed.nearest,
            ink: Arc::clone(ink) as SharedInk,
            viewing,
            target,
            gamut_target,
            printable_target,
            further,
            thin: Thinness::of(&placed.thickness_mm),
            thickness_mm: placed.thickness_mm,
            extent_mm: placed.extent_mm,
            mesh: placed.mesh,
            clear: placed.clear,
        })
    }

    /// Targets as given and printable ones under further lights: those of the smooth reflectances that look like them in
    /// `viewing`; of a spectral image its own (`given`, by light), off which the printable ones are as far as those
    /// reflectances say.
    fn further(
        &self,
        viewing: &Viewing,
        targets: [&[[f32; 3]]; 2],
        given: Vec<Vec<[f32; 3]>>,
        control: &Control<'_>,
    ) -> Result<Vec<FurtherAim>, PrintError> {
        let s = &self.settings;
        if s.also_under.is_empty() {
            return Ok(Vec::new());
        }
        let white = self.white_radiance()?;
        let upsampling = Upsampling::new(self.inks.spectrum(), viewing, &white)?;
        let viewings: Vec<Viewing> = self.further_viewings(&white).collect::<Result<_, _>>()?;
        let [mut smooth, mut printable] = {
            let [smooth, printable] =
                targets.map(|target| under_each(&upsampling, &viewings, target, control));
            [smooth?, printable?]
        };
        for (given, (smooth, printable)) in given.into_iter().zip(smooth.iter_mut().zip(&mut printable)) {
            for ((given, smooth), printable) in given.iter().zip(&*smooth).zip(printable) {
                (0..3).for_each(|c| printable[c] += given[c] - smooth[c]);
            }
            *smooth = given;
        }
        let each = s.also_under.iter().zip(viewings).zip(smooth.into_iter().zip(printable));
        let aim = |((&illuminant, viewing), (target, printable_target))| FurtherAim {
            illuminant,
            viewing,
            target,
            printable_target,
        };
        Ok(each.map(aim).collect())
    }

    /// What the job's materials can show, whatever the object.
    pub(super) fn color_tables(&self, control: &Control<'_>) -> Result<ColorTables, PrintError> {
        let s = &self.settings;
        let options = MatchOptions::default();
        let thick = MixtureModel::under(&self.inks, "white", s.refractive_index, s.illuminant)?;
        let by_thickness =
            ThicknessGamut::build(&thick, &DEFAULT_THICKNESSES_MM, options, THIN_NODES, control)?;
        let gamut = Gamut::build(thick, options, DEFAULT_NODES, &control.silent())?;
        Ok(ColorTables { ink: Arc::new(GamutInk::new(gamut, &self.inks)), by_thickness })
    }
}

/// Colours in several viewings, `[viewing][colour]`, of the smooth reflectances that have them in the upsampling's.
fn under_each(
    upsampling: &Upsampling,
    viewings: &[Viewing],
    colors: &[[f32; 3]],
    control: &Control<'_>,
) -> Result<Vec<Vec<[f32; 3]>>, PrintError> {
    let mut found = vec![vec![[0.0; 3]; colors.len()]; viewings.len()];
    // In parts, for cancellation.
    for start in (0..colors.len()).step_by(UPSAMPLED) {
        control.check()?;
        let part = start..colors.len().min(start + UPSAMPLED);
        let seen: Vec<Vec<[f32; 3]>> = colors[part.clone()]
            .par_iter()
            .map(|&rgb| {
                let radiance = upsampling.radiance(rgb);
                viewings.iter().map(|viewing| viewing.relative_rgb(&radiance)).collect()
            })
            .collect();
        for (i, seen) in part.zip(seen) {
            found.iter_mut().zip(seen).for_each(|(found, rgb)| found[i] = rgb);
        }
    }
    Ok(found)
}
