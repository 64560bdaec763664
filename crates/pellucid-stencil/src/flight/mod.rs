//! The exact first flight: what is known of a point's radiance before light scatters for the first time.
//!
//! Radiance varies from voxel to voxel only through the materials on a path's first flight, the ray from the point
//! straight into the object. In each channel that flight is integrated exactly, voxel by voxel: with which
//! probability the first collision lies in a depth bin and scatters, and how much arrives at the far side
//! uncollided. What is left to predict, the mean throughput J of the paths that go on from there, varies slowly:
//!
//! ```text
//! L = sum over bins d of m_d J_d  +  T (1 - R)  +  T R J_out
//! ```
//!
//! | module | owns |
//! | --- | --- |
//! | `march` | the segments of a ray through the voxels |
//! | `optics` | what materials do to a flight |
//! | `passage` | a flight from segment to segment |
//! | `extract` | the flights of points: [`FirstFlights`] |
//! | `pullback` | derivatives by the material of each voxel on the way |

mod extract;
mod march;
mod optics;
mod passage;
mod pullback;

pub use extract::FirstFlights;

/// Depth bins of the first collision.
pub const FLIGHT_BINS: usize = 3;

/// Depths in mm along the ray that part the bins.
pub const FLIGHT_DEPTHS_MM: [f64; FLIGHT_BINS - 1] = [0.1, 0.35];

/// The first flight from a point in a channel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstFlight {
    /// Probability that the first collision lies in each depth bin, times the albedo where it does.
    pub masses: [f32; FLIGHT_BINS],
    /// What leaves at the far side without a collision: transmittance times one less the reflectance there.
    pub escaped: f32,
    /// What is reflected inside at the far side without a collision: transmittance times reflectance.
    pub returned: f32,
}

impl FirstFlight {
    /// Values of a flight as an array.
    pub const VALUES: usize = FLIGHT_BINS + 2;

    /// Radiance, with the mean throughput J that follows a collision in each bin and, last, a reflection at the far
    /// side. Not below zero where J is not.
    #[inline]
    pub fn radiance(&self, j: &[f32; FLIGHT_BINS + 1]) -> f32 {
        let scattered: f32 = self.masses.iter().zip(j).map(|(m, j)| m * j).sum();
        scattered + self.escaped + self.returned * j[FLIGHT_BINS]
    }

    /// Derivatives of the radiance by each J.
    #[inline]
    pub fn factors(&self) -> [f32; FLIGHT_BINS + 1] {
        std::array::from_fn(|i| if i < FLIGHT_BINS { self.masses[i] } else { self.returned })
    }

    /// Masses, escaped, returned.
    #[inline]
    pub fn to_array(self) -> [f32; Self::VALUES] {
        std::array::from_fn(|i| match i {
            0..FLIGHT_BINS => self.masses[i],
            FLIGHT_BINS => self.escaped,
            _ => self.returned,
        })
    }

    /// The flight of [`FirstFlight::to_array`].
    #[inline]
    pub fn from_array(v: [f32; Self::VALUES]) -> Self {
        Self { masses: std::array::from_fn(|i| v[i]), escaped: v[FLIGHT_BINS], returned: v[FLIGHT_BINS + 1] }
    }
}
