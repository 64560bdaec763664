//! Scenes without voxels: boxes and spheres filled by formula. They tell the error of voxels from
//! that of Monte Carlo.

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::rng;
use crate::tally::Tally;
use crate::walk::{Flight, Optics, Scene, walk};
use crate::{Boundary, TraceError, TraceOptions};

/// A convex solid, in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// An axis-aligned box between two corners.
    Box {
        /// Lower corner.
        min_mm: [f64; 3],
        /// Upper corner.
        max_mm: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Centre.
        center_mm: [f64; 3],
        /// Radius.
        radius_mm: f64,
    },
}

/// Which material is where, by position in a list of materials.
#[derive(Clone, Debug, PartialEq)]
pub enum Medium {
    /// One material everywhere.
    Homogeneous(usize),
    /// Cubic cells: cell (i, j, k) = floor(point / edge) is `even` where i + j + k is even.
    Checkerboard {
        /// Edge of a cell in mm.
        cell_mm: f64,
        /// Material of even cells.
        even: usize,
        /// Material of odd cells.
        odd: usize,
    },
    /// A base material with boxes of others; a later box wins.
    Layers {
        /// Material outside every box.
        base: usize,
        /// Material, lower corner and upper corner of each box.
        boxes: Vec<(usize, [f64; 3], [f64; 3])>,
    },
}

/// A radiance with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Its standard error.
    pub std_error: f64,
    /// Paths behind it.
    pub paths: u32,
}

/// A solid filled with materials, traced in double precision.
///
/// ```
/// use pellucid_trace::{AnalyticScene, Boundary, Medium, Optics, Shape, TraceOptions};
/// use pellucid_voxel::Control;
/// let shape = Shape::Box { min_mm: [-500.0, -500.0, -500.0], max_mm: [500.0, 500.0, 0.0] };
/// let optics = vec![Optics { sigma_s: 0.5, sigma_a: 0.5, g: 0.0 }];
/// let scene = AnalyticScene::new(shape, Medium::Homogeneous(0), optics).unwrap();
/// let options = TraceOptions { spp: 20_000, boundary: Boundary::Matched, ..Default::default() };
/// let l = scene.radiance([0.0; 3], [0.0, 0.0, 1.0], &options, &Control::none()).unwrap();
/// assert!((l.value - 0.115226).abs() < 4.0 * l.std_error); // Chandrasekhar's half-space
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticScene {
    shape: Shape,
    medium: Medium,
    optics: Vec<Optics>,
    majorant: f64,
}

impl Shape {
    /// True inside.
    pub fn contains(&self, p: [f64; 3]) -> bool {
        match self {
            Self::Box { min_mm, max_mm } => (0..3).all(|a| p[a] >= min_mm[a] && p[a] < max_mm[a]),
            Self::Sphere { center_mm, radius_mm } => {
                (0..3).map(|a| (p[a] - center_mm[a]).powi(2)).sum::<f64>() < radius_mm * radius_mm
            }
        }
    }

    /// Lower and upper corner of the bounding box.
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        match *self {
            Self::Box { min_mm, max_mm } => (min_mm, max_mm),
            Self::Sphere { center_mm: c, radius_mm: r } => (c.map(|v| v - r), c.map(|v| v + r)),
        }
    }

    fn is_valid(&self) -> bool {
        match self {
            Self::Box { min_mm, max_mm } => {
                (0..3).all(|a| min_mm[a].is_finite() && max_mm[a].is_finite() && min_mm[a] < max_mm[a])
            }
            Self::Sphere { center_mm, radius_mm } => {
                center_mm.iter().all(|c| c.is_finite()) && radius_mm.is_finite() && *radius_mm > 0.0
            }
        }
    }
}

impl Medium {
    /// Position in the list of the material at a point.
    pub fn material(&self, p: [f64; 3]) -> usize {
        match self {
            Self::Homogeneous(m) => *m,
            Self::Checkerboard { cell_mm, even, odd } => {
                let parity: i64 = p.iter().map(|c| (c / cell_mm).floor() as i64).sum();
                if parity % 2 == 0 { *even } else { *odd }
            }
            Self::Layers { base, boxes } => boxes
                .iter()
                .rev()
                .find(|(_, min, max)| (0..3).all(|a| p[a] >= min[a] && p[a] < max[a]))
                .map_or(*base, |(m, _, _)| *m),
        }
    }

    fn materials(&self) -> Vec<usize> {
        match self {
            Self::Homogeneous(m) => vec![*m],
            Self::Checkerboard { even, odd, .. } => vec![*even, *odd],
            Self::Layers { base, boxes } => {
                std::iter::once(*base).chain(boxes.iter().map(|(m, _, _)| *m)).collect()
            }
        }
    }
}

impl AnalyticScene {
    /// Checks and builds a scene of a shape, its filling and the materials' coefficients.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for an empty shape, a cell without size, a material past the list,
    /// a coefficient that is negative or not finite, or |g| above 0.99.
    pub fn new(shape: Shape, medium: Medium, optics: Vec<Optics>) -> Result<Self, TraceError> {
        if !shape.is_valid() {
            return Err(TraceError::invalid("geometry", format!("{shape:?} has no inside")));
        }
        if let Medium::Checkerboard { cell_mm, .. } = medium
            && !(cell_mm.is_finite() && cell_mm > 0.0)
        {
            return Err(TraceError::invalid("cell_mm", format!("{cell_mm} mm must be positive")));
        }
        if let Some(m) = medium.materials().into_iter().find(|&m| m >= optics.len()) {
            return Err(TraceError::invalid("medium", format!("material {m} of {}", optics.len())));
        }
        for (i, o) in optics.iter().enumerate() {
            let ok = |v: f64| v.is_finite() && v >= 0.0;
            if !(ok(o.sigma_s) && ok(o.sigma_a) && (-0.99..=0.99).contains(&o.g)) {
                return Err(TraceError::invalid(format!("material {i}"), format!("{o:?} is out of range")));
            }
        }
        let majorant =
            medium.materials().iter().map(|&m| optics[m].sigma_s + optics[m].sigma_a).fold(0.0, f64::max);
        Ok(Self { shape, medium, optics, majorant })
    }

    /// The solid.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The filling.
    pub fn medium(&self) -> &Medium {
        &self.medium
    }

    /// The materials' coefficients.
    pub fn optics(&self) -> &[Optics] {
        &self.optics
    }

    /// Radiance at a surface point with outward `normal`, from `options.spp` paths.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for options out of range or a normal that is not a unit vector,
    /// [`TraceError::Cancelled`]. Progress counts paths.
    pub fn radiance(
        &self,
        point_mm: [f64; 3],
        normal: [f64; 3],
        options: &TraceOptions,
        control: &Control<'_>,
    ) -> Result<Estimate, TraceError> {
        options.check()?;
        let length: f64 = normal.iter().map(|c| c * c).sum();
        if (length - 1.0).abs() > 1e-6 || point_mm.iter().any(|c| !c.is_finite()) {
            return Err(TraceError::invalid("point or normal", format!("{point_mm:?}, {normal:?}")));
        }
        let index = match options.boundary {
            Boundary::Matched => None,
            Boundary::Dielectric(n) => Some(n.get()),
        };
        const CHUNK: u32 = 1 << 12;
        let key = rng::point_key(options.seed, 0, 0, 0);
        let total = u64::from(options.spp);
        let done = std::sync::atomic::AtomicU64::new(0);
        let tally = (0..options.spp.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                control.check()?;
                let samples = chunk * CHUNK..options.spp.min((chunk + 1).saturating_mul(CHUNK));
                let count = samples.len() as u64;
                let mut tally = Tally::default();
                for sample in samples {
                    let mut rng = rng::path_rng(key, sample);
                    let d = normal.map(|c| -c);
                    tally.add(walk(self, index, f64::from(options.roulette), point_mm, d, &mut rng) as f32);
                }
                control.advance(&done, count, total);
                Ok::<_, TraceError>(tally)
            })
            .try_reduce(Tally::default, |mut a, b| {
                a += b;
                Ok(a)
            })?;
        let n = options.spp;
        Ok(Estimate { value: tally.mean(n), std_error: tally.std_error(n), paths: n })
    }
}

impl Scene for AnalyticScene {
    fn fly(&self, p: [f64; 3], d: [f64; 3], t: f64) -> Flight {
        match &self.shape {
            Shape::Box { min_mm, max_mm } => {
                let face = |a: usize| if d[a] > 0.0 { max_mm[a] } else { min_mm[a] };
                let time =
                    |a: usize| if d[a] == 0.0 { f64::INFINITY } else { ((face(a) - p[a]) / d[a]).max(0.0) };
                let axis = (1..3).fold(0, |best, a| if time(a) < time(best) { a } else { best });
                let exit = time(axis);
                if t < exit {
                    return Flight::Inside(along(p, d, t));
                }
                let mut at = along(p, d, exit);
                at[axis] = face(axis);
                let mut normal = [0.0; 3];
                normal[axis] = d[axis].signum();
                Flight::Surface(at, normal)
            }
            Shape::Sphere { center_mm, radius_mm } => {
                let o: [f64; 3] = std::array::from_fn(|a| p[a] - center_mm[a]);
                let b: f64 = (0..3).map(|a| o[a] * d[a]).sum();
                let c: f64 = o.iter().map(|v| v * v).sum::<f64>() - radius_mm * radius_mm;
                let root = (b * b - c).max(0.0).sqrt();
                // The form without cancellation for either sign of b.
                let exit = if b > 0.0 { -c / (b + root) } else { root - b }.max(0.0);
                if t < exit {
                    return Flight::Inside(along(p, d, t));
                }
                let out: [f64; 3] = std::array::from_fn(|a| o[a] + exit * d[a]);
                let length = out.iter().map(|v| v * v).sum::<f64>().sqrt();
                let normal = out.map(|v| v / length);
                Flight::Surface(std::array::from_fn(|a| center_mm[a] + radius_mm * normal[a]), normal)
            }
        }
    }

    fn optics(&self, p: [f64; 3]) -> Optics {
        self.optics[self.medium.material(p)]
    }

    fn majorant(&self) -> f64 {
        self.majorant
    }
}

fn along(p: [f64; 3], d: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|a| d[a].mul_add(t, p[a]))
}
