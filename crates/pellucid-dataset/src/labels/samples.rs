//! Labelled samples of one volume.

use pellucid_stencil::{Coefficients, Features, FirstFlight, FirstFlights, StencilSpec, Stencils};
use pellucid_trace::{Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, CountSat, LabelGrid, MaterialTable, Surface, SurfaceOptions, Tile};
use rand_core::Rng;
use rand_pcg::Pcg64;

use super::half_stencils::HalfStencils;
use crate::recipe::draw::NEIGHBOURS;
use crate::volume::fill;
use crate::volume::noise::unit;
use crate::volume::texture::BlueNoise;
use crate::{DatasetError, Recipe, Split};

/// Points whose stencils are extracted at a time.
const CHUNK: usize = 256;
/// Voxels that are tried to find a point's neighbour.
const TRIES: usize = 24;
/// Least cosine between the normals of a point and its neighbour.
const ALIKE: f32 = 0.8;

/// How a point is labelled: how many paths its radiance takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Labelling {
    /// A fixed number for each point and channel.
    Paths(u32),
    /// As many as bring the standard error to a target.
    Error(ErrorTarget),
}

impl Labelling {
    /// What a split asks for.
    pub fn of(split: &Split) -> Self {
        match split.std_error {
            Some(std_error) => Self::Error(ErrorTarget { std_error, max_spp: split.spp.max(32) }),
            None => Self::Paths(split.spp),
        }
    }
}

/// Labelled points of one volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// A checksum of the volume's labels.
    pub digest: u64,
    /// The points' voxels `[x, y, z]`.
    pub voxels: Vec<[u32; 3]>,
    /// Ordered `[point][channel][level][z][y][x][feature]`, 1/mm; a neighbour's where the split says so.
    pub stencils: HalfStencils,
    /// First flights, `[point][channel]`.
    pub flights: Vec<FirstFlight>,
    /// Ordered `[point][channel]`, within 0..=1.
    pub radiance: Vec<f32>,
    /// Standard errors of `radiance`.
    pub std_error: Vec<f32>,
}

/// Makes the labelled samples of the volumes of one split. Everything follows from the recipe, the split, the
/// materials and the boundary.
#[derive(Clone, Debug)]
pub struct Sampler {
    recipe: Recipe,
    split: Split,
    /// As given, without the split's density.
    table: MaterialTable,
    materials: MaterialTable,
    boundary: Boundary,
    blue: BlueNoise,
}

impl Sampler {
    /// A sampler for `split`, of the materials of `table` of which the last is white, thinned or thickened by the split's
    /// density.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] for a recipe out of range or a split that it lacks.
    pub fn new(
        recipe: &Recipe,
        split: &str,
        table: &MaterialTable,
        boundary: Boundary,
    ) -> Result<Self, DatasetError> {
        recipe.check()?;
        let split = recipe.split(split)?.clone();
        let density = Split { other_inks: None, ..split.clone() };
        let materials = recipe.draw_materials(&density, 0, table)?;
        let blue = BlueNoise::new(split.halftone, recipe.pitch);
        Ok(Self { recipe: recipe.clone(), split, table: table.clone(), materials, boundary, blue })
    }

    /// The split.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The materials with the split's density; those of a volume of other inks are not these.
    pub fn materials(&self) -> &MaterialTable {
        &self.materials
    }

    /// Channels, each a sample a point.
    pub fn channels(&self) -> usize {
        self.materials.channels()
    }

    /// Draws `points` surface voxels of a volume, uniformly and with repeats, and labels them.
    ///
    /// # Errors
    /// [`DatasetError::Cancelled`]; others when the volume cannot be built, which takes a recipe at the edge
    /// of its ranges.
    pub fn samples(
        &self,
        volume: u32,
        points: u32,
        labels: Labelling,
        control: &Control<'_>,
    ) -> Result<Samples, DatasetError> {
        self.samples_of(&self.grid(volume)?, volume, points, labels, control)
    }

    /// As [`Sampler::samples`] with the voxels of `grid`, which has the recipe's pitch; `volume` decides on points,
    /// paths and inks.
    ///
    /// # Errors
    /// As there, and [`DatasetError::Invalid`] for labels that the materials lack.
    pub fn samples_of(
        &self,
        grid: &LabelGrid,
        volume: u32,
        points: u32,
        labels: Labelling,
        control: &Control<'_>,
    ) -> Result<Samples, DatasetError> {
        let surface = Surface::extract(grid, &SurfaceOptions::default(), control)?;
        if surface.is_empty() {
            return Err(DatasetError::invalid(
                format!("volume {volume} of split {:?}", self.split.name),
                "has no solid voxel; use a finer pitch or larger solids",
            ));
        }
        let mut rng = self.recipe.rng(&self.split, volume, 1);
        let chosen: Vec<u32> = (0..points).map(|_| (rng.next_u64() % surface.len() as u64) as u32).collect();
        let voxels: Vec<[u32; 3]> = chosen.iter().map(|&p| surface.voxels()[p as usize]).collect();

        let (stencils, flights) = self.inputs(volume, grid, &surface, &chosen, control)?;
        let materials = self.recipe.draw_materials(&self.split, volume, &self.table)?;
        let traced = Volume::new(grid, &surface, control)?;
        let spp = if let Labelling::Paths(spp) = labels { spp } else { 1 };
        let options =
            TraceOptions { spp, seed: rng.next_u64(), boundary: self.boundary, ..Default::default() };
        let tracer = Tracer::new(&traced, &materials, options)?;
        let mut radiance = vec![0.0; chosen.len() * self.channels()];
        let mut std_error = radiance.clone();
        match labels {
            Labelling::Paths(_) => {
                tracer.radiance_with_error(&chosen, 0, &mut radiance, &mut std_error, control)?;
            }
            Labelling::Error(target) => {
                // Paths of their own: comparisons with the other kind of label are independent.
                tracer.radiance_to(&chosen, 1, target, &mut radiance, &mut std_error, control)?;
            }
        }
        Ok(Samples { digest: digest(grid), voxels, stencils, flights, radiance, std_error })
    }

    /// The voxels of a volume.
    ///
    /// # Errors
    /// As [`Sampler::samples`].
    pub fn grid(&self, volume: u32) -> Result<LabelGrid, DatasetError> {
        let (shape, texture) = self.recipe.draw(&self.split, volume, self.materials.len());
        Ok(fill(&shape, &texture, self.recipe.pitch, &self.blue)?)
    }

    /// What a network is given of surface points of a volume, ordered as [`Samples::stencils`] and
    /// [`Samples::flights`].
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] when a point lies past the surface, [`DatasetError::Cancelled`].
    pub fn inputs(
        &self,
        volume: u32,
        grid: &LabelGrid,
        surface: &Surface,
        points: &[u32],
        control: &Control<'_>,
    ) -> Result<(HalfStencils, Vec<FirstFlight>), DatasetError> {
        let materials = self.recipe.draw_materials(&self.split, volume, &self.table)?;
        let index = self.recipe.refractive_index;
        let flights = FirstFlights::new(&materials, grid, surface, index)?;
        let mut flown = vec![FirstFlight::default(); points.len() * self.channels()];
        flights.extract(points, &mut flown, &control.silent())?;
        let seen = self.seen(volume, surface, points);
        let coefficients = Coefficients::all(&materials, Features::ScatterAbsorb)?;
        Ok((stencils_of(&materials, &coefficients, grid, &seen, control)?, flown))
    }

    /// The voxels about which stencils are taken: the points' own, or neighbours'.
    fn seen(&self, volume: u32, surface: &Surface, points: &[u32]) -> Vec<[u32; 3]> {
        let own = points.iter().map(|&p| surface.voxels()[p as usize]);
        let Some(near) = self.split.neighbours else { return own.collect() };
        let mut rng = self.recipe.rng(&self.split, volume, NEIGHBOURS);
        let reach = surface.frame().pitch().mm().map(|mm| (near.reach_mm / mm).round() as i64);
        let mut neighbour = |point: u32| -> Option<u32> {
            let (voxel, normal) = (surface.voxels()[point as usize], surface.normals()[point as usize]);
            (0..TRIES).find_map(|_| {
                let mut axis = |a: usize| {
                    let offset = (rng.next_u64() % (2 * reach[a] + 1) as u64) as i64 - reach[a];
                    u32::try_from(i64::from(voxel[a]) + offset).ok()
                };
                let other = surface.index_of([axis(0)?, axis(1)?, axis(2)?])?;
                let cosine: f32 =
                    surface.normals()[other as usize].iter().zip(normal).map(|(a, b)| a * b).sum();
                (cosine > ALIKE).then_some(other)
            })
        };
        let mut chance = self.recipe.rng(&self.split, volume, NEIGHBOURS + 1);
        let seen = points.iter().map(|&p| {
            let shares = unit(chance.next_u64()) < near.share;
            let of = if shares { neighbour(p).unwrap_or(p) } else { p };
            surface.voxels()[of as usize]
        });
        seen.collect()
    }
}

/// The stencils of some voxels, ordered as [`Samples::stencils`].
fn stencils_of(
    materials: &MaterialTable,
    coefficients: &Coefficients,
    grid: &LabelGrid,
    voxels: &[[u32; 3]],
    control: &Control<'_>,
) -> Result<HalfStencils, DatasetError> {
    let sat = CountSat::build(grid, materials.len(), control)?;
    let stencils = Stencils::new(StencilSpec::paper(), grid, &sat)?;
    let row = coefficients.values_per_point(stencils.spec());
    let channels = materials.channels();
    let mut out = HalfStencils::zeros(voxels.len() * channels);
    let mut buffer = vec![0.0; voxels.len().min(CHUNK) * row];
    // Neighbours are cheaper together.
    let order = pellucid_stencil::near_order(voxels);
    for order in order.chunks(CHUNK) {
        let part: Vec<[u32; 3]> = order.iter().map(|&i| voxels[i as usize]).collect();
        let buffer = &mut buffer[..part.len() * row];
        stencils.extract(coefficients, &part, buffer, control)?;
        for (values, &i) in buffer.chunks_exact(row).zip(order) {
            out.set(i as usize * channels, values);
        }
    }
    Ok(out)
}

/// A checksum of a grid's labels: FNV-1a, tile by tile.
pub(crate) fn digest(grid: &LabelGrid) -> u64 {
    let mut sum = Fnv::new();
    for tile in grid.tiles() {
        match tile {
            Tile::Constant(label) => sum.add(&[*label]),
            Tile::Dense(labels) => sum.add(&labels[..]),
        }
    }
    sum.0
}

/// FNV-1a over words of eight bytes, the last one padded with zeros.
pub(crate) struct Fnv(pub(crate) u64);

impl Fnv {
    pub(crate) fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    pub(crate) fn add(&mut self, bytes: &[u8]) {
        for word in bytes.chunks(8) {
            let mut padded = [0; 8];
            padded[..word.len()].copy_from_slice(word);
            self.0 = (self.0 ^ u64::from_le_bytes(padded)).wrapping_mul(0x0100_0000_01b3);
            self.0 ^= self.0 >> 29;
        }
    }
}

/// A random permutation of `0..n`.
pub(crate) fn permutation(n: usize, mut rng: Pcg64) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        order.swap(i, (rng.next_u64() % (i as u64 + 1)) as usize);
    }
    order
}
