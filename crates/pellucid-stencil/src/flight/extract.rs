//! First flights of surface points.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, LabelGrid, MaterialTable, Surface, internal_reflectance};
use rayon::prelude::*;

use super::FirstFlight;
use super::march::{FarSide, Segment, march};
use super::optics::{LANES, Optics};
use super::passage::Passage;
use crate::StencilError;

/// Points a thread takes at a time.
pub(super) const CHUNK: usize = 256;

/// Flights into one object: labels, surface, materials and the boundary's refractive index.
///
/// ```
/// use pellucid_stencil::{FirstFlight, FirstFlights};
/// use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};
/// // A block of white, label 5, deep enough to be opaque.
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [64, 32, 256]).unwrap();
/// let grid = LabelGrid::from_fn(frame, |_| 5);
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
/// let flights = FirstFlights::new(&MaterialTable::cmykw(), &grid, &surface, 1.5).unwrap();
/// let top = surface.index_of([32, 16, 255]).unwrap();
/// let mut red_green_blue = [FirstFlight::default(); 3];
/// flights.extract(&[top], &mut red_green_blue, &Control::none()).unwrap();
/// // Nearly every first collision scatters; with sigma_t = 6 in red 45 % lie within 0.1 mm.
/// let red = red_green_blue[0];
/// assert!((red.masses[0] - 0.9991 * (1.0 - (-0.6f32).exp())).abs() < 1e-3);
/// assert!((red.masses.iter().sum::<f32>() + red.escaped + red.returned - 1.0).abs() < 2e-3);
/// ```
#[derive(Clone, Debug)]
pub struct FirstFlights<'a> {
    grid: &'a LabelGrid,
    surface: &'a Surface,
    optics: Optics,
    channels: usize,
    mm: [f32; 3],
    index: f64,
}

impl<'a> FirstFlights<'a> {
    /// Flights through `grid` from points of its `surface`; `refractive_index` is that of the boundary, 1 where it is
    /// matched.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when the surface lies in another frame, a label lies past the table, or the index is
    /// not within 1 to 4.
    pub fn new(
        materials: &MaterialTable,
        grid: &'a LabelGrid,
        surface: &'a Surface,
        refractive_index: f64,
    ) -> Result<Self, StencilError> {
        if surface.frame() != grid.frame() {
            return Err(StencilError::invalid("surface", "lies in another frame than the grid"));
        }
        if !(1.0..=4.0).contains(&refractive_index) {
            return Err(StencilError::invalid(
                "refractive index",
                format!("{refractive_index}; it must lie within 1 to 4"),
            ));
        }
        let histogram = grid.histogram();
        if let Some(label) = histogram.iter().rposition(|&n| n > 0).filter(|&l| l > materials.len()) {
            return Err(StencilError::invalid(
                "label grid",
                format!("holds label {label}; the table has {} materials", materials.len()),
            ));
        }
        Ok(Self {
            grid,
            surface,
            optics: Optics::new(materials),
            channels: materials.channels(),
            mm: grid.frame().pitch().mm().map(|v| v as f32),
            index: refractive_index,
        })
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The flights of surface points, `out` ordered `[point][channel]`. A point's flights depend on nothing else that
    /// is asked for. Progress counts points.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a point lies past the surface or the lengths do not agree;
    /// [`StencilError::Cancelled`].
    pub fn extract(
        &self,
        points: &[u32],
        out: &mut [FirstFlight],
        control: &Control<'_>,
    ) -> Result<(), StencilError> {
        self.check_points(points)?;
        self.check_values("flights", out.len(), points)?;
        let (done, total) = (AtomicU64::new(0), points.len() as u64);
        points.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK * self.channels)).try_for_each(
            |(points, out)| {
                control.check()?;
                for (&point, out) in points.iter().zip(out.chunks_exact_mut(self.channels)) {
                    for (group, out) in out.chunks_mut(LANES).enumerate() {
                        let flights = self.flight(point, group);
                        out.iter_mut().zip(flights).for_each(|(out, flight)| *out = flight);
                    }
                }
                control.advance(&done, points.len() as u64, total);
                Ok(())
            },
        )
    }

    pub(super) fn check_points(&self, points: &[u32]) -> Result<(), StencilError> {
        match points.iter().find(|&&p| p as usize >= self.surface.len()) {
            None => Ok(()),
            Some(point) => {
                let count = self.surface.len();
                Err(StencilError::invalid("points", format!("{point}; the surface has {count}")))
            }
        }
    }

    /// Checks that there is a value for each point in each channel.
    pub(super) fn check_values(&self, what: &str, values: usize, points: &[u32]) -> Result<(), StencilError> {
        if values == points.len() * self.channels {
            return Ok(());
        }
        Err(StencilError::invalid(
            what,
            format!("{values} for {} points in {} channels", points.len(), self.channels),
        ))
    }

    pub(super) fn optics(&self) -> &Optics {
        &self.optics
    }

    /// The flights of a point in the channels of a group.
    fn flight(&self, point: u32, group: usize) -> [FirstFlight; LANES] {
        let mut passage = Passage::new(&self.optics, group);
        let reflectance = self.follow(point, |segment| passage.pass(segment));
        passage.end(reflectance)
    }

    /// Follows a point's flight until `visit` returns false; the reflectance at the far side where it gets there.
    #[inline]
    pub(super) fn follow(&self, point: u32, visit: impl FnMut(Segment) -> bool) -> Option<f32> {
        let (voxel, normal) = (self.surface.voxels()[point as usize], self.surface.normals()[point as usize]);
        let inward = normal.map(|n| -n);
        let leaves =
            |voxel: [i32; 3], _: usize| self.smooth_normal(voxel).is_none_or(|n| dot(inward, n) > 0.0);
        let far = march(self.grid, self.mm, voxel, normal, leaves, visit)?;
        Some(self.reflectance(far, inward))
    }

    fn smooth_normal(&self, voxel: [i32; 3]) -> Option<[f32; 3]> {
        let point = self.surface.index_of(voxel.map(|v| v as u32))?;
        Some(self.surface.normals()[point as usize])
    }

    /// Reflectance where a ray leaves; at a true edge, where the smooth normal turns away, by the face's own normal.
    fn reflectance(&self, far: FarSide, direction: [f32; 3]) -> f32 {
        let smooth = self.smooth_normal(far.voxel).map(|n| dot(direction, n)).filter(|&c| c > 0.0);
        let cosine = smooth.unwrap_or(direction[far.axis].abs());
        internal_reflectance(f64::from(cosine), self.index) as f32
    }
}

#[inline]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
