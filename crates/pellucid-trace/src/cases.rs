//! Reference cases in JSON: parsing, analytic and voxelised estimates, z-scores.

use std::collections::BTreeMap;
use std::path::Path;

use pellucid_core::files::read_text_bounded;
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, TILE, TILE_VOXELS,
    Tile,
};
use serde::Deserialize;

use crate::{
    AnalyticScene, Boundary, Estimate, Medium, Optics, Shape, TraceError, TraceOptions, Tracer, Volume,
};

/// Most bytes of a case file.
const MAX_FILE: u64 = 64 << 20;
/// Thickest voxelised object, mm; larger ones are shrunk and their coefficients raised.
const MAX_THICKNESS_MM: f64 = 20.0;
/// Boxes are cut this far to the sides of the point when voxelised, mm.
const MAX_ASIDE_MM: f64 = 12.0;
/// Paths of the first round, enough to see the rare exits of dark materials.
const PILOT: u32 = 1 << 17;
/// Most paths of an estimate.
const MAX_PATHS: u32 = 1 << 26;

/// One reference radiance with everything needed to reproduce it.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name, unique in its file by convention.
    pub id: String,
    /// The scene.
    pub scene: AnalyticScene,
    /// The object's surface.
    pub boundary: Boundary,
    /// Surface point in mm.
    pub point_mm: [f64; 3],
    /// Outward normal there.
    pub normal: [f64; 3],
    /// Reference radiance: the deterministic solution where the file has one.
    pub reference: f64,
    /// Standard error of the reference, 0 for a deterministic one.
    pub reference_error: f64,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Scalar {
    One(f64),
    Channels(Vec<f64>),
}

#[derive(Deserialize)]
struct RawMaterial {
    albedo: Scalar,
    sigma_t: Scalar,
    g: Option<f64>,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum RawShape {
    Box { min_mm: [f64; 3], max_mm: [f64; 3] },
    Sphere { center_mm: [f64; 3], radius_mm: f64 },
}

#[derive(Deserialize)]
struct RawBox {
    material: String,
    min_mm: [f64; 3],
    max_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum RawMedium {
    Homogeneous { albedo: f64, sigma_t: f64 },
    Checkerboard { cell_mm: f64, even: String, odd: String },
    Layers { base: String, boxes: Vec<RawBox> },
}

#[derive(Deserialize)]
struct RawCase {
    id: String,
    geometry: RawShape,
    medium: RawMedium,
    #[serde(default)]
    materials: BTreeMap<String, RawMaterial>,
    channel: Option<String>,
    boundary: String,
    g: f64,
    point: [f64; 3],
    normal: [f64; 3],
    value: f64,
    std_err: f64,
    adding_doubling_crosscheck: Option<f64>,
    exact_chandrasekhar: Option<f64>,
}

/// Reads a case file: a JSON list, or an object whose `cases` is one.
///
/// # Errors
/// [`TraceError::Io`] when the file cannot be read or is larger than 64 MiB,
/// [`TraceError::Invalid`] naming the case and field for anything else.
pub fn read_cases(path: &Path) -> Result<Vec<Case>, TraceError> {
    parse_cases(&read_text_bounded(path, MAX_FILE)?)
}

/// Parses the text of a case file.
///
/// # Errors
/// [`TraceError::Invalid`] naming the case and field.
pub fn parse_cases(text: &str) -> Result<Vec<Case>, TraceError> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum File {
        List(Vec<serde_json::Value>),
        Object { cases: Vec<serde_json::Value> },
    }
    let file: File = serde_json::from_str(text)
        .map_err(|e| TraceError::invalid("case file", format!("not a JSON list of cases: {e}")))?;
    let (File::List(values) | File::Object { cases: values }) = file;
    values
        .into_iter()
        .enumerate()
        .map(|(i, value)| {
            let raw: RawCase = serde_json::from_value(value)
                .map_err(|e| TraceError::invalid(format!("case {i}"), e.to_string()))?;
            let id = raw.id.clone();
            Case::from_raw(raw).map_err(|e| match e {
                TraceError::Invalid(mut fault) => {
                    fault.subject = format!("case {id:?}, {}", fault.subject);
                    TraceError::Invalid(fault)
                }
                other => other,
            })
        })
        .collect()
}

impl Case {
    fn from_raw(raw: RawCase) -> Result<Self, TraceError> {
        let channel = match raw.channel.as_deref() {
            None => None,
            Some("R") => Some(0),
            Some("G") => Some(1),
            Some("B") => Some(2),
            Some(other) => return Err(TraceError::invalid("channel", format!("{other:?}; R, G, B or null"))),
        };
        let mut optics = Vec::new();
        let mut material = |name: &str| -> Result<usize, TraceError> {
            let m = raw
                .materials
                .get(name)
                .ok_or_else(|| TraceError::invalid("materials", format!("{name:?} is not defined")))?;
            let pick = |s: &Scalar, what: &str| match (s, channel) {
                (Scalar::One(v), _) => Ok(*v),
                (Scalar::Channels(v), Some(c)) if c < v.len() => Ok(v[c]),
                _ => Err(TraceError::invalid(
                    format!("materials, {name:?}, {what}"),
                    "has no value for the channel",
                )),
            };
            let (albedo, sigma_t) = (pick(&m.albedo, "albedo")?, pick(&m.sigma_t, "sigma_t")?);
            optics.push(of_albedo(albedo, sigma_t, m.g.unwrap_or(raw.g))?);
            Ok(optics.len() - 1)
        };
        let medium = match &raw.medium {
            RawMedium::Homogeneous { albedo, sigma_t } => {
                optics.push(of_albedo(*albedo, *sigma_t, raw.g)?);
                Medium::Homogeneous(0)
            }
            RawMedium::Checkerboard { cell_mm, even, odd } => {
                Medium::Checkerboard { cell_mm: *cell_mm, even: material(even)?, odd: material(odd)? }
            }
            RawMedium::Layers { base, boxes } => Medium::Layers {
                base: material(base)?,
                boxes: boxes
                    .iter()
                    .map(|b| Ok((material(&b.material)?, b.min_mm, b.max_mm)))
                    .collect::<Result<_, TraceError>>()?,
            },
        };
        let shape = match raw.geometry {
            RawShape::Box { min_mm, max_mm } => Shape::Box { min_mm, max_mm },
            RawShape::Sphere { center_mm, radius_mm } => Shape::Sphere { center_mm, radius_mm },
        };
        let boundary = match raw.boundary.as_str() {
            "matched" => Boundary::Matched,
            other => {
                let index = other.strip_prefix("dielectric_n").and_then(|n| n.parse().ok());
                let index = index.ok_or_else(|| {
                    TraceError::invalid("boundary", format!("{other:?}; \"matched\" or \"dielectric_n1.5\""))
                })?;
                Boundary::with_index(index)?
            }
        };
        if !(raw.value.is_finite() && raw.std_err.is_finite() && raw.std_err >= 0.0) {
            return Err(TraceError::invalid(
                "value",
                format!("{} with standard error {}", raw.value, raw.std_err),
            ));
        }
        let exact = raw.adding_doubling_crosscheck.or(raw.exact_chandrasekhar);
        Ok(Self {
            id: raw.id,
            scene: AnalyticScene::new(shape, medium, optics)?,
            boundary,
            point_mm: raw.point,
            normal: raw.normal,
            reference: exact.unwrap_or(raw.value),
            reference_error: if exact.is_some() { 0.0 } else { raw.std_err },
        })
    }

    /// The difference of an estimate from the reference in combined standard errors.
    pub fn z(&self, estimate: &Estimate) -> f64 {
        let sigma = estimate.std_error.hypot(self.reference_error);
        if sigma > 0.0 { (estimate.value - self.reference) / sigma } else { 0.0 }
    }

    /// Estimates the case in its analytic geometry: `spp` paths, or as many as bring the standard
    /// error to 0.0007 (131,072 at least).
    ///
    /// # Errors
    /// As [`AnalyticScene::radiance`].
    pub fn analytic(
        &self,
        spp: Option<u32>,
        seed: u64,
        control: &Control<'_>,
    ) -> Result<Estimate, TraceError> {
        to_target(spp, |spp| {
            let options = TraceOptions { spp, seed, boundary: self.boundary, ..TraceOptions::default() };
            self.scene.radiance(self.point_mm, self.normal, &options, control)
        })
    }

    /// The case as voxels of a printer's pitch.
    ///
    /// The grid lies so that the point is the centre of a voxel's face. Objects more than 20 mm
    /// thick are shrunk and their coefficients raised alike, which changes no radiance; boxes are
    /// cut 12 mm to the sides of the point.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] when no surface voxel lies near the point or the materials are
    /// out of range, [`TraceError::Unsupported`], [`TraceError::Cancelled`].
    pub fn voxelise(&self, pitch: Pitch, control: &Control<'_>) -> Result<VoxelCase, TraceError> {
        let (min, max) = self.scene.shape().bounds();
        let thickness = (0..3).map(|a| max[a] - min[a]).fold(f64::INFINITY, f64::min);
        let scale = (MAX_THICKNESS_MM / thickness).min(1.0);
        let point = self.point_mm.map(|c| c * scale);
        let is_box = matches!(self.scene.shape(), Shape::Box { .. });
        let mut low = min.map(|c| c * scale);
        let mut high = max.map(|c| c * scale);
        if is_box {
            for a in 0..3 {
                low[a] = low[a].max(point[a] - MAX_ASIDE_MM.max(MAX_THICKNESS_MM * self.normal[a].abs()));
                high[a] = high[a].min(point[a] + MAX_ASIDE_MM.max(MAX_THICKNESS_MM * self.normal[a].abs()));
            }
        }
        let mm = pitch.mm();
        let facing = (1..3).fold(0, |b, a| if self.normal[a].abs() > self.normal[b].abs() { a } else { b });
        let mut origin = [0.0; 3];
        let mut size = [0u32; 3];
        for a in 0..3 {
            let phase = if a == facing { 0.0 } else { 0.5 };
            let below = ((point[a] - low[a]) / mm[a] - phase).ceil().max(0.0) + 1.0;
            origin[a] = point[a] - (below + phase) * mm[a];
            size[a] = ((high[a] - origin[a]) / mm[a]).ceil() as u32 + 1;
        }
        let frame = Frame::new(origin, pitch, size)?;
        let inside = |p: [f64; 3]| {
            (0..3).all(|a| p[a] >= low[a] && p[a] < high[a])
                && self.scene.shape().contains(p.map(|c| c / scale))
        };
        let label = |v: [i64; 3]| {
            let p = frame.centre_mm(v);
            if inside(p) { self.scene.medium().material(p.map(|c| c / scale)) as u8 + 1 } else { 0 }
        };
        let homogeneous = matches!(self.scene.medium(), Medium::Homogeneous(_));
        let grid = LabelGrid::from_tiles(frame, |t| {
            let at = t.map(|c| i64::from(c) * TILE as i64);
            let corner = |i: usize| {
                label(std::array::from_fn(|a| at[a] + if i >> a & 1 == 1 { TILE as i64 - 1 } else { 0 }))
            };
            // Shapes are convex: eight corners inside mean all inside.
            if homogeneous && (0..8).all(|i| corner(i) != 0) {
                return Tile::Constant(corner(0));
            }
            let mut labels = Box::new([0; TILE_VOXELS]);
            for (i, l) in labels.iter_mut().enumerate() {
                *l = label([
                    at[0] + (i % TILE) as i64,
                    at[1] + (i / TILE % TILE) as i64,
                    at[2] + (i / TILE / TILE) as i64,
                ]);
            }
            Tile::Dense(labels)
        });
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
        let volume = Volume::new(&grid, &surface, control)?;
        // The voxel below the point.
        let inner: [f64; 3] = std::array::from_fn(|a| point[a] - 0.5 * mm[a] * self.normal[a]);
        let distance = |v: &[u32; 3]| {
            let c = frame.centre_mm(v.map(i64::from));
            (0..3).map(|a| (c[a] - inner[a]).powi(2)).sum::<f64>()
        };
        let nearest = (0..surface.len())
            .min_by(|&a, &b| distance(&surface.voxels()[a]).total_cmp(&distance(&surface.voxels()[b])));
        let Some(nearest) =
            nearest.filter(|&i| distance(&surface.voxels()[i]) < 4.0 * pitch.max_mm().powi(2))
        else {
            return Err(TraceError::invalid(
                "point",
                format!("{:?} mm is not on the surface", self.point_mm),
            ));
        };
        Ok(VoxelCase { volume, point: nearest as u32, scale })
    }

    /// Estimates the case in voxels, which may come from another case of the same geometry,
    /// point and filling.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for coefficients out of range, [`TraceError::Cancelled`].
    pub fn voxelised(
        &self,
        voxels: &VoxelCase,
        spp: Option<u32>,
        seed: u64,
        control: &Control<'_>,
    ) -> Result<Estimate, TraceError> {
        let materials = self
            .scene
            .optics()
            .iter()
            .enumerate()
            .map(|(i, o)| Material {
                name: format!("material {i}"),
                sigma_s: vec![(o.sigma_s / voxels.scale) as f32],
                sigma_a: vec![(o.sigma_a / voxels.scale) as f32],
                g: (o.g as f32).into(),
            })
            .collect();
        let table = MaterialTable::new(vec!["value".into()], materials)?;
        to_target(spp, |spp| {
            let options = TraceOptions { spp, seed, boundary: self.boundary, ..TraceOptions::default() };
            let tracer = Tracer::new(&voxels.volume, &table, options)?;
            let (mut l, mut e) = ([0.0; 1], [0.0; 1]);
            tracer.radiance_with_error(&[voxels.point], 0, &mut l, &mut e, control)?;
            Ok(Estimate { value: f64::from(l[0]), std_error: f64::from(e[0]), paths: spp })
        })
    }
}

/// A case's voxels and the surface point in them.
pub struct VoxelCase {
    volume: Volume,
    point: u32,
    scale: f64,
}

fn of_albedo(albedo: f64, sigma_t: f64, g: f64) -> Result<Optics, TraceError> {
    if !(0.0..=1.0).contains(&albedo) {
        return Err(TraceError::invalid("albedo", format!("{albedo} must lie within 0 to 1")));
    }
    Ok(Optics { sigma_s: albedo * sigma_t, sigma_a: (1.0 - albedo) * sigma_t, g })
}

/// A fixed number of paths, or a pilot and then as many as the target standard error asks for.
fn to_target(
    spp: Option<u32>,
    estimate: impl Fn(u32) -> Result<Estimate, TraceError>,
) -> Result<Estimate, TraceError> {
    const TARGET: f64 = 0.0007;
    let first = estimate(spp.unwrap_or(PILOT))?;
    if spp.is_some() || first.std_error <= TARGET {
        return Ok(first);
    }
    let more = f64::from(PILOT) * (first.std_error / TARGET).powi(2) * 1.05;
    estimate(more.min(f64::from(MAX_PATHS)) as u32)
}
