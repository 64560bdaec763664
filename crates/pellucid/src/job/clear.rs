//! See-through parts: which voxels are printed in clear resin instead of colour.

use pellucid_core::Fault;
use pellucid_mesh::{PlacedMesh, VoxeliseOptions};
use pellucid_voxel::{
    AIR, Anisotropy, LabelGrid, Material, MaterialTable, NearestSurface, Surface, SurfaceOptions,
    TILE_VOXELS, Tile,
};
use serde::{Deserialize, Serialize};

use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob};

/// Name of the clear resin, in material tables and printers' palettes.
pub(crate) const CLEAR: &str = "clear";
/// How deep below a see-through place of its surface a body is clear, in mm: walls of twice that are see-through.
const WINDOW_MM: f64 = 5.0;
/// Scattering (isotropic) and absorption of UltraClear in R, G, B, 1/mm, after hand-held photographs. Tables need
/// coefficients; nothing is traced through clear resin.
const SIGMA_S: [f32; 3] = [0.0040, 0.0059, 0.0069];
const SIGMA_A: [f32; 3] = [0.0090, 0.0124, 0.0110];

/// Clear voxels of a print.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ClearParts {
    /// The label of the clear resin where it is printed, air elsewhere.
    pub grid: LabelGrid,
    /// How much there is.
    pub report: ClearReport,
}

/// How much of a print is clear, in a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ClearReport {
    /// Voxels of clear resin.
    pub voxels: u64,
    /// Their share of all solid voxels.
    pub share: f64,
    /// Triangles of bodies that are clear throughout.
    pub body_triangles: u64,
    /// Surface voxels of other bodies that are see-through.
    pub window_voxels: u64,
}

/// The table with clear resin as its last material, which it gets where it has none.
pub(crate) fn with_clear(materials: &MaterialTable) -> Result<MaterialTable, PrintError> {
    let channels = materials.channels();
    let of_channels = |rgb: [f32; 3]| match channels {
        3 => rgb.to_vec(),
        _ => vec![rgb.iter().sum::<f32>() / 3.0; channels],
    };
    let known = materials.materials().iter().find(|m| m.name == CLEAR).cloned();
    let clear = known.unwrap_or_else(|| Material {
        name: CLEAR.into(),
        sigma_s: of_channels(SIGMA_S),
        sigma_a: of_channels(SIGMA_A),
        g: Anisotropy::Uniform(0.0),
    });
    let others = materials.materials().iter().filter(|m| m.name != CLEAR).cloned();
    Ok(MaterialTable::over(materials.spectrum().clone(), others.chain([clear]).collect())?)
}

/// The table without clear resin, which is its last material: what colours are made of.
pub(crate) fn without_clear(materials: &MaterialTable) -> Result<MaterialTable, PrintError> {
    let inks = materials.materials().iter().filter(|m| m.name != CLEAR).cloned().collect();
    Ok(MaterialTable::over(materials.spectrum().clone(), inks)?)
}

/// Voxel by voxel of two grids in one frame.
pub(crate) fn combined(a: &LabelGrid, b: &LabelGrid, label: impl Fn(u8, u8) -> u8 + Sync) -> LabelGrid {
    LabelGrid::from_tiles(*a.frame(), |t| match (a.tile(t), b.tile(t)) {
        (Tile::Constant(a), Tile::Constant(b)) => Tile::Constant(label(*a, *b)),
        (a, b) => {
            let (mut labels, b) = (dense(a), dense(b));
            labels.iter_mut().zip(&b[..]).for_each(|(a, b)| *a = label(*a, *b));
            Tile::Dense(labels)
        }
    })
}

/// The grid without voxels of a label.
pub(crate) fn without_label(grid: &LabelGrid, label: u8) -> LabelGrid {
    combined(grid, grid, |l, _| if l == label { AIR } else { l })
}

fn dense(tile: &Tile) -> Box<[u8; TILE_VOXELS]> {
    match tile {
        Tile::Constant(label) => Box::new([*label; TILE_VOXELS]),
        Tile::Dense(labels) => labels.clone(),
    }
}

/// What is left of a model beside its clear parts.
pub(super) struct Split {
    /// The opaque voxels.
    pub opaque: LabelGrid,
    /// The others.
    pub clear: ClearParts,
    /// What the opaque voxels look like.
    pub body: Body,
}

/// The bodies that are not clear throughout, and how they look.
pub(super) struct Body {
    surface: Surface,
    /// Colour, and whether it is see-through there, of each surface voxel.
    looks: Vec<([f32; 3], bool)>,
    /// Nearest surface voxels, where there are windows.
    nearest: Option<NearestSurface>,
}

impl Body {
    /// The colour of an opaque voxel: that of its place on the model, or else of the nearest opaque one; white far below a
    /// window.
    pub fn color(&self, voxel: [u32; 3]) -> [f32; 3] {
        let look = |point: u32| self.looks[point as usize];
        let own = self.surface.index_of(voxel).map(look).filter(|(_, clear)| !clear);
        let near = || self.nearest.as_ref().and_then(|n| n.nearest(voxel)).map(look);
        own.or_else(near).map_or([1.0; 3], |(rgb, _)| rgb)
    }

    /// The voxels of `grid` that do not lie below a window.
    fn opaque(&self, grid: &LabelGrid) -> LabelGrid {
        let mut opaque = grid.clone();
        let Some(nearest) = &self.nearest else { return opaque };
        opaque.update_tiles(|t, tile| {
            let entries = nearest.tile(grid.tile_index(t))?;
            let mut labels = dense(tile);
            let below = |&point: &u32| point != NearestSurface::NONE && self.looks[point as usize].1;
            let mut any = false;
            for (label, _) in labels.iter_mut().zip(entries).filter(|(l, point)| **l != AIR && below(point)) {
                (*label, any) = (AIR, true);
            }
            any.then_some(Tile::Dense(labels))
        });
        opaque
    }
}

impl PrintJob {
    /// Divides the voxels of a model into opaque ones and those of the clear resin `label`.
    pub(super) fn split(
        &self,
        mesh: &PlacedMesh<'_>,
        whole: &LabelGrid,
        options: &VoxeliseOptions,
        label: u8,
        monitor: &Monitor<'_>,
    ) -> Result<Split, PrintError> {
        let model = mesh.model();
        if model.opacity().is_empty() {
            monitor.warn("the model was imported without its opacity, so nothing of it is clear (ImportOptions::opacity)");
        }
        let bodies = model.clear_bodies();
        let body_triangles = bodies.iter().filter(|b| **b).count() as u64;
        let (left, own);
        let (placed, grid) = match body_triangles {
            0 => (mesh, whole.clone()),
            _ => {
                left = model.without(&bodies).ok_or_else(nothing_opaque)?;
                let voxelised = monitor.run(Stage::Voxelise, |c| {
                    let placed = PlacedMesh::at(&left, *mesh.placement());
                    let grid = placed.voxelise(options, c)?.grid;
                    Ok::<_, PrintError>((placed, grid))
                })?;
                own = voxelised.0;
                (&own, voxelised.1)
            }
        };
        let surface =
            monitor.run(Stage::Surface, |c| Surface::extract(&grid, &SurfaceOptions::default(), c))?;
        let looks = monitor.run(Stage::Texture, |c| placed.surface_looks(&surface, c))?;
        let window_voxels = looks.iter().filter(|(_, clear)| *clear).count() as u64;
        let nearest = match window_voxels {
            0 => None,
            _ => Some(monitor.run(Stage::Nearest, |c| NearestSurface::build(&grid, &surface, WINDOW_MM, c))?),
        };
        let body = Body { surface, looks, nearest };
        let opaque = body.opaque(&grid);
        if opaque.solid_count() == 0 {
            return Err(nothing_opaque());
        }
        let solid = combined(whole, &grid, |a, b| if a == AIR { b } else { a });
        let clear = combined(&solid, &opaque, |solid, opaque| match (solid, opaque) {
            (AIR, _) => AIR,
            (_, AIR) => label,
            _ => AIR,
        });
        let voxels = clear.solid_count();
        let share = voxels as f64 / solid.solid_count().max(1) as f64;
        let report = ClearReport { voxels, share, body_triangles, window_voxels };
        if voxels == 0 && !model.opacity().is_empty() {
            monitor.warn("no part of the model has an alpha below one half, so nothing is printed clear");
        }
        Ok(Split { opaque, clear: ClearParts { grid: clear, report }, body })
    }
}

fn nothing_opaque() -> PrintError {
    let fault = Fault::new("model", "all of it would be clear, and there is no colour to prepare");
    PrintError::Unsupported(fault.remedy("print it in clear resin as it is, or leave --clear-from-alpha out"))
}

#[cfg(test)]
mod tests {
    use pellucid_voxel::{Frame, Pitch};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn clear_resin_comes_last_and_is_taken_out_again() {
        let table = MaterialTable::cmykw();
        let with = with_clear(&table).unwrap();
        assert_eq!((with.len(), with.label_of(CLEAR)), (6, Some(6)));
        assert_eq!(without_clear(&with).unwrap(), table);
        assert_eq!(with_clear(&with).unwrap(), with);
        // One's own keeps its coefficients, and goes to the end.
        let mut materials = with.materials().to_vec();
        materials[5].sigma_a[1] = 0.5;
        materials.rotate_right(1);
        let own = with_clear(&MaterialTable::over(with.spectrum().clone(), materials).unwrap()).unwrap();
        assert_eq!((own.label_of("cyan"), own.get(6).unwrap().sigma_a[1]), (Some(1), 0.5));
    }

    proptest! {
        #[test]
        fn grids_combine_voxel_by_voxel(seed in any::<u64>(), size in prop::array::uniform3(1u32..40)) {
            let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
            // Some tiles constant, some not.
            let grid = |salt: u64| LabelGrid::from_fn(frame, |[x, y, z]| {
                let tile = seed.wrapping_add(salt).wrapping_mul(u64::from(x / 16 + 3 * (y / 16) + 7 * (z / 16)) + 1);
                if tile % 3 == 0 { 2 } else { ((u64::from(x * y + z) ^ tile) % 4) as u8 }
            });
            let (a, b) = (grid(1), grid(2));
            let both = combined(&a, &b, |a, b| a.max(2 * b));
            for z in 0..size[2] { for y in 0..size[1] { for x in 0..size[0] {
                let v = [x, y, z];
                prop_assert_eq!(both.get(v), a.get(v).max(2 * b.get(v)));
            }}}
            let without = without_label(&a, 2);
            prop_assert_eq!(without.histogram()[2], 0);
            prop_assert_eq!(without.solid_count(), a.solid_count() - a.histogram()[2]);
        }
    }
}
