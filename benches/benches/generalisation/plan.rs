//! What is trained: architectures, volumes, seeds and budget.

use pellucid::dataset::{Recipe, SetHeader, ShapeClass, Shard};
use pellucid::rpnn::train::TrainSettings;
use pellucid::rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid::rpnn::variant::Head;
use pellucid::rpnn::{Precision, Variant};
use pellucid::voxel::MaterialTable;

use super::Error;

/// Sizes of a study.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Steps of every run.
    pub steps: u64,
    /// Surface points drawn from a volume.
    pub points: u32,
    /// Paths of a training label.
    pub spp: u32,
    /// Steps between validations.
    pub validate_every: u64,
    /// What is trained together, in this order.
    pub groups: Vec<Group>,
}

/// Four networks trained on one stream of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// The volumes.
    pub shapes: Shapes,
    /// Seed of the volumes and of the initial weights.
    pub seed: u64,
}

/// Which solids are trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shapes {
    /// All of the recipe's training split: what this project trains on.
    All,
    /// Cubes, rotated cubes, balls and cuboids of 1 to 2.5 mm: the paper's (section 4.1).
    Paper,
}

impl Shapes {
    /// The name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all-shapes",
            Self::Paper => "paper-shapes",
        }
    }
}

impl Plan {
    /// The study of the published figures, or a small one.
    pub fn new(full: bool) -> Self {
        let group = |shapes, seed| Group { shapes, seed };
        match full {
            true => Self {
                steps: 10_000,
                points: 1024,
                spp: 64,
                validate_every: 500,
                groups: vec![
                    group(Shapes::All, 1),
                    group(Shapes::All, 2),
                    group(Shapes::Paper, 1),
                    group(Shapes::Paper, 2),
                ],
            },
            false => Self {
                steps: 600,
                points: 512,
                spp: 32,
                validate_every: 100,
                groups: vec![group(Shapes::All, 1)],
            },
        }
    }

    /// Where the runs that end at three quarters of the steps leave the others.
    pub fn half(&self) -> u64 {
        self.steps / 2
    }

    /// Where the runs end that tell how flat the curve is.
    pub fn three_quarters(&self) -> u64 {
        self.steps * 3 / 4
    }

    /// How a variant is trained: the paper's form and rate, with our schedule.
    pub fn settings(&self, group: Group, variant: Variant) -> TrainSettings {
        TrainSettings {
            variant,
            head: Head::Radiance,
            mean_output: Head::Radiance.mean_output(),
            steps: self.steps,
            peak_rate: 1e-3,
            mirror: false,
            seed: group.seed,
            form: InputForm { transform: FeatureTransform::Scaled, order: LevelOrder::FineToCoarse },
            precision: Precision::Bf16,
            ..TrainSettings::default()
        }
    }

    /// The training volumes of a group.
    pub fn training_set(&self, recipe: &Recipe, group: Group) -> Result<SetHeader, Error> {
        let mut recipe = recipe.clone();
        recipe.seed = recipe.seed.wrapping_add(1_000_000 * (group.seed - 1));
        let train =
            recipe.splits.iter_mut().find(|s| s.name == "train").ok_or("the recipe has no split train")?;
        train.points = self.points;
        train.spp = self.spp;
        if group.shapes == Shapes::Paper {
            let shapes = [ShapeClass::Cube, ShapeClass::RotatedCube, ShapeClass::Sphere, ShapeClass::Cuboid];
            train.shapes = shapes.map(|shape| (shape, 1.0)).to_vec();
        }
        let materials = MaterialTable::cmykw();
        Ok(SetHeader { recipe, split: "train".into(), materials, shard: Shard::WHOLE })
    }
}
