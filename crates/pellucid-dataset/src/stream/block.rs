//! Blocks of samples: half a window of volumes, made at once.

use pellucid_stencil::FirstFlight;
use pellucid_voxel::Control;
use rayon::prelude::*;

use super::{Prints, StreamOptions};
use crate::labels::{HalfStencils, permutation};
use crate::{DatasetError, Labelling, STENCIL_VALUES, Sampler, StoredVolumes};

/// Samples of half a window of volumes, `[volume][point][channel]`.
pub(super) struct Block {
    pub stencils: HalfStencils,
    pub flights: Vec<FirstFlight>,
    pub radiance: Vec<f32>,
}

/// Where the samples of a volume come from.
pub(super) enum Volumes {
    /// Made and traced, prints among them.
    Fresh(Box<Sampler>, Prints),
    /// Labelled before.
    Stored(Box<StoredVolumes>),
}

impl Volumes {
    pub fn channels(&self) -> usize {
        match self {
            Self::Fresh(sampler, _) => sampler.channels(),
            Self::Stored(stored) => stored.sampler().channels(),
        }
    }

    /// Stencils, flights and radiance of volume number `i` of the stream.
    fn samples(
        &self,
        i: u64,
        options: &StreamOptions,
        control: &Control<'_>,
    ) -> Result<(HalfStencils, Vec<FirstFlight>, Vec<f32>), DatasetError> {
        match self {
            Self::Fresh(sampler, prints) => {
                let labelling = Labelling::Paths(options.spp);
                let samples = match prints.instead_of(options.seed, i) {
                    Some(print) => sampler.samples_of(print, i as u32, options.points, labelling, control)?,
                    None => sampler.samples(i as u32, options.points, labelling, control)?,
                };
                Ok((samples.stencils, samples.flights, samples.radiance))
            }
            Self::Stored(stored) => {
                let (turn, i) = (i / stored.len() as u64, (i % stored.len() as u64) as usize);
                let order = permutation(stored.len(), crate::recipe::draw::rng(options.seed, 5, turn));
                let at = order[i] as usize;
                let (stencils, flights) = stored.inputs(at, control)?;
                Ok((stencils, flights, stored.record(at).radiance.clone()))
            }
        }
    }
}

/// Makes block `block` of a stream: half a window of volumes, in parallel.
pub(super) fn make_block(
    source: &Volumes,
    options: &StreamOptions,
    block: u64,
    control: &Control<'_>,
) -> Result<Block, DatasetError> {
    let volumes = u64::from(options.window / 2);
    let per_volume = options.points as usize * source.channels();
    let mut stencils = HalfStencils::zeros(volumes as usize * per_volume);
    let mut radiance = vec![0.0; volumes as usize * per_volume];
    let mut flights = vec![FirstFlight::default(); radiance.len()];
    stencils
        .values_mut()
        .par_chunks_exact_mut(per_volume * STENCIL_VALUES)
        .zip(flights.par_chunks_exact_mut(per_volume))
        .zip(radiance.par_chunks_exact_mut(per_volume))
        .enumerate()
        .try_for_each(|(i, ((stencils, flights), radiance))| {
            control.check()?;
            let volume = (block * volumes + i as u64) * u64::from(options.share.count)
                + u64::from(options.share.index);
            let made = source.samples(volume, options, control)?;
            stencils.copy_from_slice(made.0.values());
            flights.copy_from_slice(&made.1);
            radiance.copy_from_slice(&made.2);
            Ok::<(), DatasetError>(())
        })?;
    Ok(Block { stencils, flights, radiance })
}
