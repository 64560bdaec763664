//! First flights of surface points.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, LabelGrid, MaterialTable, Surface, internal_reflectance};
use rayon::prelude::*;

use super::march::{FarSide, Segment, march};
use super::{FLIGHT_BINS, FLIGHT_DEPTHS_MM, FirstFlight};
use crate::StencilError;

/// Channels that are computed together.
const LANES: usize = 4;
/// Points a thread takes at a time.
const CHUNK: usize = 256;
/// Transmittance below which a flight counts as ended: what is left of it collides where it is.
const OPAQUE: f32 = 1e-4;

/// A value for each of some channels.
type Lanes = [f32; LANES];

/// Extinction in 1/mm and albedo of each label, in channels four at a time; label 0 is air.
#[derive(Clone, Debug)]
struct Optics {
    extinction: Vec<Lanes>,
    albedo: Vec<Lanes>,
    groups: usize,
}

impl Optics {
    fn new(materials: &MaterialTable) -> Self {
        let channels = materials.channels();
        let groups = channels.div_ceil(LANES);
        let mut optics =
            Self { extinction: vec![[0.0; LANES]; groups], albedo: vec![[0.0; LANES]; groups], groups };
        for m in materials.materials() {
            for group in 0..groups {
                // Lanes past the last channel repeat it, so that they end when it does.
                let lane = |of: &dyn Fn(usize) -> f32| -> Lanes {
                    std::array::from_fn(|l| of((group * LANES + l).min(channels - 1)))
                };
                let extinction = |c: usize| m.sigma_s[c] + m.sigma_a[c];
                let albedo = |c: usize| {
                    let sum = extinction(c);
                    if sum > 0.0 { m.sigma_s[c] / sum } else { 0.0 }
                };
                optics.extinction.push(lane(&extinction));
                optics.albedo.push(lane(&albedo));
            }
        }
        optics
    }
}

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
        if out.len() != points.len() * self.channels {
            return Err(StencilError::invalid(
                "flights",
                format!("{} for {} points in {} channels", out.len(), points.len(), self.channels),
            ));
        }
        if let Some(point) = points.iter().find(|&&p| p as usize >= self.surface.len()) {
            let count = self.surface.len();
            return Err(StencilError::invalid("points", format!("{point}; the surface has {count}")));
        }
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

    /// The flights of a point in the channels of a group.
    fn flight(&self, point: u32, group: usize) -> [FirstFlight; LANES] {
        let (voxel, normal) = (self.surface.voxels()[point as usize], self.surface.normals()[point as usize]);
        let inward = normal.map(|n| -n);
        let mut passage = Passage::new(&self.optics, group);
        let leaves =
            |voxel: [i32; 3], _: usize| self.smooth_normal(voxel).is_none_or(|n| dot(inward, n) > 0.0);
        let far = march(self.grid, self.mm, voxel, normal, leaves, |segment| passage.pass(segment));
        passage.end(far.map(|far| self.reflectance(far, inward)))
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

/// A flight under way, in the channels of a group: segments of one material are taken together.
struct Passage<'a> {
    optics: &'a Optics,
    group: usize,
    transmittance: Lanes,
    masses: [Lanes; FLIGHT_BINS],
    bin: usize,
    depth: f32,
    label: u8,
    length: f32,
}

impl<'a> Passage<'a> {
    fn new(optics: &'a Optics, group: usize) -> Self {
        Self {
            optics,
            group,
            transmittance: [1.0; LANES],
            masses: [[0.0; LANES]; FLIGHT_BINS],
            bin: 0,
            depth: 0.0,
            label: 0,
            length: 0.0,
        }
    }

    /// Passes a segment; false once nothing is left to follow.
    #[inline]
    fn pass(&mut self, segment: Segment) -> bool {
        if segment.label != self.label {
            self.settle();
            self.label = segment.label;
            if self.transmittance.iter().all(|&t| t < OPAQUE) {
                return false;
            }
        }
        let mut left = segment.length;
        while self.bin < FLIGHT_BINS - 1 {
            let to_edge = FLIGHT_DEPTHS_MM[self.bin] as f32 - self.depth;
            if left < to_edge {
                break;
            }
            self.length += to_edge;
            self.settle();
            self.depth += to_edge;
            left -= to_edge;
            self.bin += 1;
        }
        self.length += left;
        self.depth += left;
        // A long way through one material is settled now and then, to see whether it has come to its end.
        if self.length > 0.5 {
            self.settle();
            return self.transmittance.iter().any(|&t| t >= OPAQUE);
        }
        true
    }

    /// Attenuates along the length passed in one material.
    fn settle(&mut self) {
        let length = std::mem::take(&mut self.length);
        if self.label == 0 || length <= 0.0 {
            return;
        }
        let at = usize::from(self.label) * self.optics.groups + self.group;
        let (extinction, albedo) = (&self.optics.extinction[at], &self.optics.albedo[at]);
        let masses = &mut self.masses[self.bin];
        let passed: Lanes = std::array::from_fn(|l| exp_of_minus(extinction[l] * length));
        for l in 0..LANES {
            let kept = self.transmittance[l] * passed[l];
            masses[l] += (self.transmittance[l] - kept) * albedo[l];
            self.transmittance[l] = kept;
        }
    }

    /// The flights, given the reflectance at the far side where there is one.
    fn end(mut self, reflectance: Option<f32>) -> [FirstFlight; LANES] {
        self.settle();
        if reflectance.is_none() {
            // Opaque: the little that is left collides here.
            let at = usize::from(self.label) * self.optics.groups + self.group;
            for l in 0..LANES {
                self.masses[self.bin][l] += self.transmittance[l] * self.optics.albedo[at][l];
                self.transmittance[l] = 0.0;
            }
        }
        let reflectance = reflectance.unwrap_or(0.0);
        std::array::from_fn(|l| FirstFlight {
            masses: std::array::from_fn(|bin| self.masses[bin][l]),
            escaped: self.transmittance[l] * (1.0 - reflectance),
            returned: self.transmittance[l] * reflectance,
        })
    }
}

/// `exp(-x)` for x of 0 or more, to 2 units in the last place, the same on every machine; 0 past 87.
#[inline]
fn exp_of_minus(x: f32) -> f32 {
    // Added to a number of less than 2^22, leaves it rounded in the last bits.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, the first of few bits, so that the remainder is exact (Cody and Waite 1980).
    const HIGH: f32 = 0.693_359_4;
    const LOW: f32 = -2.121_944_4e-4;
    let y = -x.min(87.0);
    let shifted = y * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = y - n * HIGH - n * LOW;
    // Taylor's series on |r| of ln 2 / 2 and less.
    let p = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1f32.to_bits()));
    if x > 87.0 { 0.0 } else { p * scale }
}

#[inline]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_exact_to_a_few_units() {
        let mut x = 0.0f32;
        while x < 90.0 {
            let exact = (-f64::from(x)).exp();
            let got = f64::from(exp_of_minus(x));
            assert!((got - exact).abs() <= 4e-7 * exact + 1e-37, "{x}: {got} {exact}");
            x = x * 1.001 + 1e-4;
        }
        assert_eq!((exp_of_minus(0.0), exp_of_minus(1e30), exp_of_minus(f32::INFINITY)), (1.0, 0.0, 0.0));
    }
}
