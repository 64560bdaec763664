//! What a network is trained and validated on.

use std::path::Path;

use crate::{
    DatasetError, LabelledSet, Prints, Recipe, Sampler, SetHeader, Shard, StoredVolumes, Stream,
    StreamOptions,
};
use pellucid_core::Control;
use pellucid_rpnn::file::Provenance;
use pellucid_rpnn::train::Trainer;
use pellucid_trace::Boundary;
use pellucid_voxel::MaterialTable;

use super::TrainingError;

/// Volumes to train on: made from a recipe while they are used, or stored with their labels.
#[derive(Clone, Debug)]
pub struct TrainingSet {
    header: SetHeader,
    stored: Option<StoredVolumes>,
    prints: Prints,
}

impl TrainingSet {
    /// The volumes of a recipe's split, made while they are used.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] for a recipe out of range or a split that it lacks.
    pub fn of_recipe(recipe: Recipe, split: &str, materials: MaterialTable) -> Result<Self, DatasetError> {
        recipe.check()?;
        recipe.split(split)?;
        let header = SetHeader { recipe, split: split.to_owned(), materials, shard: Shard::WHOLE };
        Ok(Self { header, stored: None, prints: Prints::none() })
    }

    /// The same with prints in the place of some volumes of the recipe; stored volumes stay as they are.
    pub fn with_prints(self, prints: Prints) -> Self {
        Self { prints, ..self }
    }

    /// The labelled volumes of files, all parts of one split.
    ///
    /// # Errors
    /// As [`StoredVolumes::load`].
    pub fn stored<P: AsRef<Path>>(files: &[P]) -> Result<Self, DatasetError> {
        let stored = StoredVolumes::load(files)?;
        Ok(Self { header: stored.header().clone(), stored: Some(stored), prints: Prints::none() })
    }

    /// Recipe, split and materials.
    pub fn header(&self) -> &SetHeader {
        &self.header
    }

    /// The split's points and paths with the recipe's boundary, in batches of `batch` shuffled by `seed`.
    ///
    /// # Errors
    /// [`TrainingError`] for a refractive index out of range.
    pub fn options(&self, batch: usize, seed: u64) -> Result<StreamOptions, TrainingError> {
        let split = self.header.split()?;
        let boundary = Boundary::with_index(self.header.recipe.refractive_index)?;
        let (points, spp) = (split.points, split.spp);
        Ok(StreamOptions { batch, points, spp, boundary, seed, ..StreamOptions::default() })
    }

    /// The stream of samples.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] naming the option that is out of range.
    pub fn into_stream(self, options: StreamOptions) -> Result<Stream, DatasetError> {
        let SetHeader { recipe, split, materials, .. } = &self.header;
        match self.stored {
            Some(stored) => Stream::stored(stored, options),
            None => Stream::with_prints(recipe, split, materials, self.prints, options),
        }
    }
}

/// The set that a run is validated on: a file of labelled points where `name` ends in `.set`, else a split of the
/// training set's recipe, labelled now. Progress counts volumes.
///
/// # Errors
/// As [`LabelledSet::load`] and [`LabelledSet::label`].
pub fn validation_set(
    name: &str,
    trained: &SetHeader,
    control: &Control<'_>,
) -> Result<LabelledSet, DatasetError> {
    if name.ends_with(".set") {
        return LabelledSet::load(&[name], control);
    }
    LabelledSet::label(&SetHeader { split: name.to_owned(), ..trained.clone() }, control)
}

/// What weights were trained for, and how: the set that they saw, and `command`, which made them.
///
/// # Errors
/// [`DatasetError::Invalid`] for a set that no [`TrainingSet`] has.
pub fn provenance(
    trainer: &Trainer,
    set: &SetHeader,
    options: &StreamOptions,
    command: &str,
) -> Result<Provenance, DatasetError> {
    // Materials as the split thins or thickens them, other inks included.
    let most = set.split()?.other_inks.map_or(1.0, |inks| inks.density * inks.each);
    let sampler = Sampler::new(&set.recipe, &set.split, &set.materials, options.boundary)?;
    let range = |values: &dyn Fn(&pellucid_voxel::Material) -> Vec<f32>| {
        let all: Vec<f64> = sampler.materials().materials().iter().flat_map(values).map(f64::from).collect();
        [
            all.iter().copied().fold(f64::INFINITY, f64::min) / most,
            all.iter().copied().fold(0.0, f64::max) * most,
        ]
    };
    let s = trainer.settings();
    let validation = trainer.curve().points.iter().rev().find_map(|p| p.validation);
    let validation = validation.map_or(String::new(), |v| {
        format!("; validation rmse {:.4}, bias {:+.4} over {} samples", v.rmse, v.bias, v.samples)
    });
    Ok(Provenance {
        form: s.form,
        pitch_mm: set.recipe.pitch.mm(),
        refractive_index: set.recipe.refractive_index,
        sigma_s_range: range(&|m| m.sigma_s.clone()),
        sigma_a_range: range(&|m| m.sigma_a.clone()),
        history: format!(
            "pellucid {} {command}; recipe {:?}; {} of {} steps of {} samples at {} paths, {} points a volume; \
             {:.0} minutes{validation}",
            env!("CARGO_PKG_VERSION"),
            set.recipe.name,
            trainer.steps_done(),
            s.steps,
            s.batch,
            options.spp,
            options.points,
            trainer.seconds() / 60.0
        ),
    })
}
