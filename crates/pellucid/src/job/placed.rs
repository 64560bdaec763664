//! The first artefact: which voxels are solid, and what colour their surface has in the texture.

use pellucid_color::MixtureModel;
use pellucid_mesh::{MeshReport, Model, PlacedMesh, Placement, VoxeliseOptions};
use pellucid_slice::check_extent;
use pellucid_voxel::{AIR, LabelGrid, NearestSurface, Surface, SurfaceOptions, local_thickness_mm};

use crate::job::clear::{ClearParts, Split};
use crate::job::spectral::SpectralColors;
use crate::record::ModelRecord;
use crate::report::Thinness;
use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob};

/// Thickness in mm from which a part counts as thick.
pub(crate) const THICK_MM: f64 = 10.0;

/// A shape in print space, all of it white, and the texture's colour of its surface.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Placed {
    /// Which model it is.
    pub model: ModelRecord,
    /// White where it is solid.
    pub solid: LabelGrid,
    /// Surface voxels and normals.
    pub surface: Surface,
    /// The nearest surface voxel of each voxel within the coloured depth; of none where the job refines in sections
    /// ([`PrintSettings::section_mm`](crate::PrintSettings)).
    pub nearest: NearestSurface,
    /// Thickness in mm below each surface voxel, along its normal; at most 10.
    pub thickness_mm: Vec<f32>,
    /// Linear RGB of the texture at each surface voxel.
    pub texture: Vec<[f32; 3]>,
    /// Of a spectral image in the texture's place: its colours under each of
    /// [`PrintSettings::also_under`](crate::PrintSettings), relative to the print's white there; else none, and colours
    /// under further lights are those of smooth reflectances.
    pub texture_under: Vec<Vec<[f32; 3]>>,
    /// Size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// The model's mesh, where there was one.
    pub mesh: Option<MeshReport>,
    /// What is printed in clear resin; not solid here.
    pub clear: Option<ClearParts>,
}

impl PrintJob {
    /// Voxelises a model.
    ///
    /// # Errors
    /// At once [`PrintError::Unsupported`] when it is larger than the printer, and [`PrintError::Color`] when the materials
    /// make no mixtures; [`PrintError`] of the step that failed.
    pub fn place(&self, model: &Model, monitor: &Monitor<'_>) -> Result<Placed, PrintError> {
        self.place_colored(model, None, monitor)
    }

    /// [`PrintJob::place`] with the colours of a spectral image, where there is one, in place of the texture's.
    pub(super) fn place_colored(
        &self,
        model: &Model,
        spectral: Option<&SpectralColors<'_>>,
        monitor: &Monitor<'_>,
    ) -> Result<Placed, PrintError> {
        let s = &self.settings;
        self.check_inks()?;
        let placement = Placement::new(model, s.scale)?;
        let options = VoxeliseOptions {
            pitch: s.printer.pitch(),
            scale: s.scale,
            label: self.white,
            ..VoxeliseOptions::default()
        };
        let extent_mm = placement.extent_mm();
        check_extent(&s.printer, extent_mm)?;
        // The margin of air is part of the slices.
        let margin = options.pitch.mm().map(|mm| 2.0 * f64::from(options.margin) * mm);
        check_extent(&s.printer, std::array::from_fn(|a| extent_mm[a] + margin[a]))?;
        let (mesh, voxelised) = monitor.run(Stage::Voxelise, |c| {
            let mesh = PlacedMesh::at(model, placement);
            let voxelised = mesh.voxelise(&options, c)?;
            Ok::<_, PrintError>((mesh, voxelised))
        })?;
        voxelised.report.warnings().iter().for_each(|warning| monitor.warn(warning));
        let (shape, colors, clear) = match self.clear {
            None => {
                let shape = self.measure(voxelised.grid, monitor)?;
                let colors = monitor.run(Stage::Texture, |c| match spectral {
                    Some(spectral) => spectral.of(&mesh, &shape.surface, c),
                    None => Ok(vec![mesh.surface_colors(&shape.surface, c)?]),
                })?;
                (shape, colors, None)
            }
            Some(label) => {
                let Split { opaque, clear, body } =
                    self.split(&mesh, &voxelised.grid, &options, label, monitor)?;
                let shape = self.measure(opaque, monitor)?;
                let texture = shape.surface.voxels().iter().map(|&voxel| body.color(voxel)).collect();
                (shape, vec![texture], Some(clear))
            }
        };
        let mut colors = colors.into_iter();
        Ok(Placed {
            model: ModelRecord::of(model),
            texture: colors.next().unwrap_or_default(),
            texture_under: colors.collect(),
            clear,
            extent_mm: voxelised.report.extent_mm,
            mesh: Some(voxelised.report),
            ..shape
        })
    }

    /// Takes voxels as they are: `labels` are solid where they are not air, and `color` gives the linear RGB of a
    /// surface voxel as a texture would.
    ///
    /// # Errors
    /// [`PrintError::Invalid`] when the pitch is not the printer's or a colour is not finite, [`PrintError::Color`] when the
    /// materials make no mixtures,
    /// [`PrintError::Unsupported`] when the box is larger than the printer.
    pub fn place_volume(
        &self,
        name: &str,
        labels: &LabelGrid,
        color: impl Fn([u32; 3]) -> [f32; 3] + Sync,
        monitor: &Monitor<'_>,
    ) -> Result<Placed, PrintError> {
        self.check_inks()?;
        let (mm, size) = (labels.frame().pitch().mm(), labels.size());
        let wanted = self.settings.printer.pitch().mm();
        if mm.iter().zip(wanted).any(|(a, b)| (a / b - 1.0).abs() > 1e-6) {
            return Err(PrintError::invalid(
                "volume",
                format!("its pitch is {mm:?} mm; the printer's is {wanted:?} mm"),
            ));
        }
        check_extent(&self.settings.printer, std::array::from_fn(|a| f64::from(size[a]) * mm[a]))?;
        let white = self.white;
        let solid =
            LabelGrid::from_fn(*labels.frame(), |voxel| if labels.get(voxel) == AIR { AIR } else { white });
        let mut placed = self.measure(solid, monitor)?;
        placed.texture = placed.surface.voxels().iter().map(|&voxel| color(voxel)).collect();
        if let Some(i) = placed.texture.iter().position(|rgb| rgb.iter().any(|v| !v.is_finite())) {
            let voxel = placed.surface.voxels()[i];
            return Err(PrintError::invalid("colour", format!("of voxel {voxel:?} is not finite")));
        }
        placed.model = ModelRecord::of_volume(name, &placed.solid, &placed.texture);
        Ok(placed)
    }

    /// Whether colours can be made of the materials; of slices that are there already nobody asks that.
    fn check_inks(&self) -> Result<(), PrintError> {
        Ok(MixtureModel::check(&self.inks, "white", self.settings.illuminant)?)
    }

    /// Everything of a placed shape that follows from its voxels; colour, name and extent are the caller's.
    fn measure(&self, solid: LabelGrid, monitor: &Monitor<'_>) -> Result<Placed, PrintError> {
        let surface =
            monitor.run(Stage::Surface, |c| Surface::extract(&solid, &SurfaceOptions::default(), c))?;
        if surface.is_empty() {
            return Err(PrintError::invalid("model", "no voxel is solid"));
        }
        let thickness_mm =
            monitor.run(Stage::Thickness, |c| local_thickness_mm(&solid, &surface, THICK_MM, c))?;
        let thin = Thinness::of(&thickness_mm);
        if thin.below_1_mm > 0.01 {
            monitor.warn(&format!(
                "{:.0} % of the surface lies on less than 1 mm of material: colours pale and show through there",
                100.0 * thin.below_1_mm
            ));
        }
        let depth = self.settings.refine.coloured_depth_mm;
        // Sections have their own.
        let nearest = match self.settings.section_mm {
            Some(_) => NearestSurface::none(&surface),
            None => monitor.run(Stage::Nearest, |c| NearestSurface::build(&solid, &surface, depth, c))?,
        };
        let (mm, size) = (solid.frame().pitch().mm(), solid.size());
        Ok(Placed {
            model: ModelRecord::default(),
            solid,
            surface,
            nearest,
            thickness_mm,
            texture: Vec::new(),
            texture_under: Vec::new(),
            clear: None,
            extent_mm: std::array::from_fn(|a| f64::from(size[a]) * mm[a]),
            mesh: None,
        })
    }
}
