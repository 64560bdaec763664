//! Large prints in sections along z: each is refined with what is around it, so that the state of a refinement, most of a
//! job's memory, is that of a section.

use std::ops::Range;
use std::sync::Arc;

use pellucid_core::Control;
use pellucid_predict::Object;
use pellucid_voxel::{LabelGrid, NearestSurface, Surface, TILE, TILE_VOXELS, Tile};

use crate::job::{Aimed, FurtherAim};
use crate::{PrintError, PrintJob};

/// How far in mm materials are seen in another place.
const REACH_MM: f64 = 2.0;

/// How far in mm beyond a section its surface is predicted, for mixtures of some depth.
pub(crate) fn margin_mm(depth_mm: f64) -> f64 {
    REACH_MM.max(depth_mm)
}

/// Layers of a print that are refined by themselves. Positions are those of the whole print.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Section {
    /// The layers that are looked at: beyond `seen` as far as mixtures go.
    pub z: Range<u32>,
    /// The layers whose surface is predicted: beyond those of `kept` as far as materials are seen.
    pub seen: Range<u32>,
    /// Their surface voxels.
    pub points: Range<u32>,
    /// Surface voxels whose mixtures the section decides on. Those before are decided on already; those after are moved
    /// with them, and decided on in the next section.
    pub kept: Range<u32>,
}

impl Section {
    /// Sections at most so high, but for rounding to tiles, which together keep every surface voxel once, from the bottom
    /// up. `depth_mm` is how deep mixtures go.
    pub(super) fn all(surface: &Surface, height_mm: f64, depth_mm: f64) -> Vec<Self> {
        let (mm, layers) = (surface.frame().pitch().mm()[2], surface.frame().size()[2]);
        let tile = TILE as u32;
        let tiles = layers.div_ceil(tile);
        let most = ((height_mm / mm / f64::from(tile)).round() as u32).max(1);
        let count = tiles.div_ceil(most);
        let margin = |mm_wide: f64| (mm_wide / mm).ceil() as u32;
        let (seen, deep) = (margin(margin_mm(depth_mm)), margin(depth_mm));
        let start = |i: u32| (u64::from(i) * u64::from(tiles) / u64::from(count)) as u32 * tile;
        let wider =
            |z: &Range<u32>, by: u32| z.start.saturating_sub(by)..z.end.saturating_add(by).min(layers);
        let section = |i: u32| {
            let own = start(i)..start(i + 1).min(layers);
            let seen = wider(&own, seen);
            let z = wider(&seen, deep);
            let z = z.start / tile * tile..z.end.next_multiple_of(tile).min(layers);
            Self { z, points: surface.points_in(seen.clone()), seen, kept: surface.points_in(own) }
        };
        (0..count).map(section).filter(|section| !section.kept.is_empty()).collect()
    }

    /// The surface voxels that the section decides on, as positions among its own.
    fn own_kept(&self) -> Range<u32> {
        self.kept.start - self.points.start..self.kept.end - self.points.start
    }

    /// Of a value for each of the section's surface voxels those that it decides on.
    pub(super) fn kept_of<'v, T>(&self, values: &'v [T]) -> &'v [T] {
        let kept = self.own_kept();
        &values[kept.start as usize..kept.end as usize]
    }

    /// Puts what `part`, the section's labels, has in the cells that it decides on into the whole print's.
    pub(super) fn put_into(&self, whole: &mut LabelGrid, part: &LabelGrid, nearest: &NearestSurface) {
        let (kept, first) = (self.own_kept(), self.z.start / TILE as u32);
        let layers = first..first + part.tile_dims()[2];
        whole.update_tiles(|[x, y, z], tile| {
            let at = [x, y, layers.contains(&z).then(|| z - first)?];
            let entries = nearest.tile(part.tile_index(at))?;
            if !entries.iter().any(|entry| kept.contains(entry)) {
                return None;
            }
            let new = part.tile(at);
            let mut labels = Box::new([0; TILE_VOXELS]);
            for (i, (label, entry)) in labels.iter_mut().zip(entries).enumerate() {
                let [x, y, z] = Tile::coords(i);
                *label = if kept.contains(entry) { new } else { tile }.label(x, y, z);
            }
            Some(Tile::Dense(labels))
        });
    }
}

impl Aimed {
    /// A section with the targets of its surface voxels; `labels`, of the whole print, are what is there so far. Mixtures
    /// are those of the surface voxels that are not decided on yet.
    pub(super) fn section(
        &self,
        section: &Section,
        depth_mm: f64,
        labels: &LabelGrid,
        control: &Control<'_>,
    ) -> Result<Self, PrintError> {
        let Section { z, seen, points, kept } = section;
        let surface = self.object.surface();
        let around = surface.points_in(z.clone());
        let solid = labels.section(z.clone())?;
        let nearest = {
            let surface = surface.section(z.clone(), z.clone())?;
            NearestSurface::build(&solid, &surface, depth_mm, control)?
        };
        let surface = surface.section(z.clone(), seen.clone())?;
        let own = |range: Range<u32>| range.start - around.start..range.end - around.start;
        let nearest = nearest.of_part(&surface, own(points.clone()), own(kept.start..points.end))?;
        let (materials, refractive_index) = (self.object.materials().clone(), self.object.refractive_index());
        let points = points.start as usize..points.end as usize;
        let of_points = |colors: &[[f32; 3]]| colors[points.clone()].to_vec();
        let further = |aim: &FurtherAim| FurtherAim {
            illuminant: aim.illuminant,
            viewing: aim.viewing.clone(),
            target: of_points(&aim.target),
            printable_target: of_points(&aim.printable_target),
        };
        Ok(Self {
            model: self.model.clone(),
            object: Arc::new(Object::new(surface, materials, refractive_index)?),
            solid,
            nearest,
            ink: Arc::clone(&self.ink),
            viewing: self.viewing.clone(),
            target: of_points(&self.target),
            gamut_target: of_points(&self.gamut_target),
            printable_target: of_points(&self.printable_target),
            thickness_mm: self.thickness_mm[points.clone()].to_vec(),
            further: self.further.iter().map(further).collect(),
            thin: self.thin,
            extent_mm: self.extent_mm,
            mesh: None,
            clear: None,
        })
    }
}

impl PrintJob {
    /// The sections of a print; none where it is refined as a whole.
    pub(super) fn sections(&self, aimed: &Aimed) -> Option<Vec<Section>> {
        let depth_mm = self.settings.refine.coloured_depth_mm;
        let height_mm = self.settings.section_mm?;
        Some(Section::all(aimed.object.surface(), height_mm, depth_mm))
    }

    /// What predictors are tried on: the print, or the section of most surface voxels.
    pub(crate) fn tried_on(&self, aimed: &Aimed, control: &Control<'_>) -> Result<Option<Aimed>, PrintError> {
        let sections = self.sections(aimed).into_iter().flatten();
        let Some(largest) = sections.max_by_key(|section| section.points.len()) else { return Ok(None) };
        let depth_mm = self.settings.refine.coloured_depth_mm;
        // As if nothing was decided on.
        let all = Section { kept: largest.points.clone(), ..largest };
        aimed.section(&all, depth_mm, &aimed.solid, control).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{AIR, Frame, Pitch, SurfaceOptions};

    #[test]
    fn sections_keep_every_surface_voxel_once_and_see_what_is_around() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [12, 8, 700]).unwrap();
        // Two blocks, far apart.
        let grid = LabelGrid::from_fn(frame, |v| if (200..520).contains(&v[2]) { AIR } else { 5 });
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let mm = frame.pitch().mm()[2];
        for (height_mm, depth_mm) in [(0.1, 0.2), (2.0, 1.0), (4.0, 3.0), (100.0, 1.0)] {
            let sections = Section::all(&surface, height_mm, depth_mm);
            let mut next = 0;
            for Section { z, points, kept, .. } in &sections {
                assert_eq!(kept.start, next);
                assert!(kept.end > kept.start && points.start <= kept.start && kept.end <= points.end);
                let around = surface.points_in(z.clone());
                assert!(around.start <= points.start && points.end <= around.end);
                assert!(grid.section(z.clone()).is_ok());
                let layers = |points: &Range<u32>| {
                    let layer = |p: u32| surface.voxels()[p as usize][2];
                    [layer(points.start), layer(points.end - 1)]
                };
                let [low, high] = layers(kept);
                assert!(f64::from(high - low) * mm <= height_mm + 16.0 * mm);
                let margin = ((REACH_MM.max(depth_mm) + depth_mm) / mm) as u32;
                assert!(z.start <= low.saturating_sub(margin) && z.end >= (high + margin).min(700), "{z:?}");
                next = kept.end;
            }
            assert_eq!(next as usize, surface.len());
        }
        assert_eq!(Section::all(&surface, 100.0, 1.0).len(), 1);
    }
}
