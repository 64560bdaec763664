//! The models, and their sizes.

use std::path::{Path, PathBuf};

use pellucid::mesh::{BaseColor, ImportLimits, Model, Scale, Triangle, Vertex, import_path};
use pellucid::{Monitor, PrintJob, PrintSettings};
use pellucid_benches::appearance::Error;

/// Surface voxels that models are scaled to.
pub const WANTED: f64 = 250_000.0;
/// Those of the small study.
pub const WANTED_SMALL: f64 = 25_000.0;
/// Height in mm at which the surface is counted, to find the one that has as many as are wanted.
const PROBE_MM: f64 = 6.0;

/// A model to refine.
pub struct Subject {
    /// What it is called in tables.
    pub name: String,
    /// Where it is read from; the cube is made.
    file: Option<PathBuf>,
    size: Size,
}

enum Size {
    /// So many surface voxels, by its two longer sides: thickness decides what thin objects can show.
    KeepingThickness(f64),
    HeightMm(f64),
    SurfaceVoxels(f64),
}

/// The models of the repository and a cube, scaled to so many surface voxels, and `FILE=MM`s.
pub fn all(full: bool, wanted: f64, also: &[String]) -> Result<Vec<Subject>, Error> {
    let names: &[&str] = match full {
        true => &["vase-handle", "vase-hollow", "showcase", "bone", "plane", "wedge", "octostar", "tubes"],
        false => &["vase-handle"],
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models");
    let own = names.iter().map(|&name| {
        let size = match (name, full) {
            ("plane" | "wedge", true) => Size::KeepingThickness(wanted),
            _ => Size::SurfaceVoxels(wanted),
        };
        Ok(Subject { name: name.to_owned(), file: Some(folder.join(format!("{name}.glb"))), size })
    });
    let further = also.iter().map(|given| {
        let (file, mm) = given.rsplit_once('=').ok_or_else(|| format!("{given}: FILE=MM is wanted"))?;
        let file = PathBuf::from(file);
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Subject { name, file: Some(file), size: Size::HeightMm(mm.parse()?) })
    });
    let cube = Subject { name: "cube".to_owned(), file: None, size: Size::SurfaceVoxels(wanted) };
    own.chain(full.then_some(Ok(cube))).chain(further).collect()
}

impl Subject {
    /// What tells it from others, sizes too.
    pub fn key(&self) -> String {
        match self.size {
            Size::HeightMm(mm) => format!("{}-{mm}mm", self.name),
            Size::SurfaceVoxels(wanted) | Size::KeepingThickness(wanted) => format!("{}-{wanted}", self.name),
        }
    }

    /// True of an upright box.
    pub fn is_box(&self) -> bool {
        self.file.is_none()
    }

    /// The model and the size that it is printed in.
    pub fn sized(&self) -> Result<(Model, Scale), Error> {
        let model = match &self.file {
            Some(file) => import_path(file, &ImportLimits::default())?,
            None => cube()?,
        };
        // A surface grows as the square; a round size reads better.
        let height =
            |probe: usize, wanted: f64| (2.0 * PROBE_MM * (wanted / probe as f64).sqrt()).round() / 2.0;
        Ok(match self.size {
            Size::HeightMm(mm) => (model, Scale::HeightMm(mm)),
            Size::SurfaceVoxels(wanted) => {
                let mm = height(surface_voxels(&model, Scale::HeightMm(PROBE_MM))?, wanted);
                (model, Scale::HeightMm(mm))
            }
            Size::KeepingThickness(wanted) => {
                let mm = height(surface_voxels(&spread(&model, PROBE_MM)?, Scale::Native)?, wanted);
                (spread(&model, mm)?, Scale::Native)
            }
        })
    }
}

fn surface_voxels(model: &Model, scale: Scale) -> Result<usize, Error> {
    let settings = PrintSettings { scale, ..PrintSettings::default() };
    Ok(PrintJob::new(settings)?.place(model, &Monitor::silent())?.surface.len())
}

/// A flat model with another height in mm and as much wider, as thick as it was.
fn spread(model: &Model, height_mm: f64) -> Result<Model, Error> {
    let [low, high] = model.bounds_m();
    let extent: [f64; 3] = std::array::from_fn(|a| high[a] - low[a]);
    let thin = (0..3).min_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    let factor = height_mm * 1e-3 / extent[2];
    let mut vertices = model.vertices().to_vec();
    for vertex in &mut vertices {
        (0..3).filter(|&a| a != thin).for_each(|a| vertex.position_m[a] *= factor);
    }
    let (triangles, materials) = (model.triangles().to_vec(), model.materials().to_vec());
    Ok(Model::new(model.name(), vertices, triangles, materials, model.textures().to_vec())?)
}

/// A cube with a colour of its own at each corner, and smooth ones between them.
fn cube() -> Result<Model, Error> {
    let corner = |i: u32| {
        let at = [0, 1, 2].map(|axis| f64::from(i >> axis & 1));
        let [r, g, b] = at.map(|v| (0.1 + 0.7 * v) as f32);
        Vertex { position_m: at.map(|v| 0.01 * v), uv: [0.0; 2], color: [r, g, b, 1.0] }
    };
    let face = |axis: u32, end: u32| {
        let [u, v, first] = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3), end << axis];
        let [along, across] = if end == 1 { [u, v] } else { [v, u] };
        let [b, c, d] = [first + along, first + u + v, first + across];
        [[first, b, c], [first, c, d]].map(|vertices| Triangle { vertices, material: 0 })
    };
    let triangles = (0..3).flat_map(|axis| [face(axis, 0), face(axis, 1)]).flatten().collect();
    let plain = BaseColor { name: String::new(), factor: [1.0; 4], texture: None, double_sided: false };
    Ok(Model::new("cube", (0..8).map(corner).collect(), triangles, vec![plain], Vec::new())?)
}
