//! What a data set consists of: a small JSON file from which every volume follows.

use std::path::Path;

use pellucid_core::files::read_text_bounded;
use pellucid_voxel::Pitch;
use serde::{Deserialize, Serialize};

use crate::DatasetError;

pub(crate) mod draw;

/// Families of solids. The first four are the paper's (section 4.1), the others what it lists as limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShapeClass {
    /// An axis-parallel cube.
    Cube,
    /// A cube turned at random.
    RotatedCube,
    /// A ball.
    Sphere,
    /// A thin cuboid, 1 to 2.5 mm.
    Cuboid,
    /// A slab of 0.2 to 1 mm, axis-parallel or turned.
    Slab,
    /// A ring: a closed loop.
    Torus,
    /// A hollow ball.
    Hollow,
    /// A ball with a hollow cut into it.
    Concave,
    /// A pipe or a rod.
    Tube,
    /// Tapered limbs that flow into each other, as in bodies of animals.
    Blend,
    /// Limbs that meet in the middle.
    Star,
    /// A ball cut from a gyroid's curved sheets.
    Gyroid,
    /// A ball with a rough, furrowed surface.
    Rock,
}

impl ShapeClass {
    /// All families.
    pub const ALL: [Self; 13] = [
        Self::Cube,
        Self::RotatedCube,
        Self::Sphere,
        Self::Cuboid,
        Self::Slab,
        Self::Torus,
        Self::Hollow,
        Self::Concave,
        Self::Tube,
        Self::Blend,
        Self::Star,
        Self::Gyroid,
        Self::Rock,
    ];

    /// The name in recipes and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cube => "cube",
            Self::RotatedCube => "rotated-cube",
            Self::Sphere => "sphere",
            Self::Cuboid => "cuboid",
            Self::Slab => "slab",
            Self::Torus => "torus",
            Self::Hollow => "hollow",
            Self::Concave => "concave",
            Self::Tube => "tube",
            Self::Blend => "blend",
            Self::Star => "star",
            Self::Gyroid => "gyroid",
            Self::Rock => "rock",
        }
    }
}

/// A use of the data set with volumes of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Such as `train`, `validation`, `thin`.
    pub name: String,
    /// Number of volumes.
    pub volumes: u32,
    /// Surface points drawn from each volume.
    pub points: u32,
    /// Paths a point and channel of the labels; the most of them where `std_error` is given.
    pub spp: u32,
    /// Standard error to which labels are traced; without it they take `spp` paths each.
    #[serde(default)]
    pub std_error: Option<f32>,
    /// Shape families and their weights.
    pub shapes: Vec<(ShapeClass, f64)>,
    /// Factor on all coefficients: 4 and 0.25 are the paper's Figure 11.
    pub density: f64,
    /// Volumes of other inks; none without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_inks: Option<OtherInks>,
    /// Samples that see the surroundings of a neighbour; none without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<Neighbours>,
    /// Part of the volumes whose mixtures are all tints of white, and of those that are large (up to
    /// [`Recipe::large_mm`]); both within 0..=1. The recipe's share of large ones, and chance tints, without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pale: Option<Pale>,
    /// What blue noise volumes are halftoned by.
    #[serde(default, skip_serializing_if = "is_default")]
    pub halftone: Halftone,
}

/// Volumes whose inks are not those of the material table, so that other inks and pitches lie within what was trained on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OtherInks {
    /// Part of the volumes, within 0..=1.
    pub share: f64,
    /// A volume's coefficients are all multiplied by one factor from 1 / `density` to `density`, even in its logarithm.
    pub density: f64,
    /// Each coefficient is multiplied by another factor from 1 / `each` to `each`, even in its logarithm.
    pub each: f64,
}

/// More of what light passes through for long: pale and large volumes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pale {
    /// Part of the volumes whose mixtures are all tints of the last material.
    pub share: f64,
    /// Part of the volumes that are large, instead of the recipe's.
    pub large_share: f64,
}

/// Samples whose stencil is that of another surface voxel nearby, whose label and first flight are their own: what a
/// network is asked for that is run for one point in many.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Neighbours {
    /// Part of the points, within 0..=1.
    pub share: f64,
    /// Greatest distance along each axis in mm.
    pub reach_mm: f64,
}

/// Blue noise for halftones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Halftone {
    /// Ranked noise, a moment's work: what labelled sets were made with first.
    #[default]
    Ranked,
    /// The mask that prints are halftoned with.
    Mask,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Split {
    fn check_variety(&self) -> Result<(), (&'static str, &'static str)> {
        if let Some(inks) = self.other_inks {
            if !(0.0..=1.0).contains(&inks.share) {
                return Err(("other_inks.share", "must lie within 0 to 1"));
            }
            if ![inks.density, inks.each].iter().all(|f| (1.0..=1000.0).contains(f)) {
                return Err(("other_inks.density and each", "must lie within 1 to 1000"));
            }
        }
        if let Some(pale) = self.pale
            && ![pale.share, pale.large_share].iter().all(|s| (0.0..=1.0).contains(s))
        {
            return Err(("pale.share and large_share", "must lie within 0 to 1"));
        }
        if let Some(near) = self.neighbours {
            if !(0.0..=1.0).contains(&near.share) {
                return Err(("neighbours.share", "must lie within 0 to 1"));
            }
            if !(0.0..=2.0).contains(&near.reach_mm) {
                return Err(("neighbours.reach_mm", "must lie within 0 to 2"));
            }
        }
        Ok(())
    }
}

/// A data set. The same recipe gives the same volumes everywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// The set's name.
    pub name: String,
    /// Seed of everything.
    pub seed: u64,
    /// Voxel edges.
    pub pitch: Pitch,
    /// Smallest and largest edge or diameter of most solids in mm.
    pub size_mm: [f64; 2],
    /// Largest edge or diameter of the others in mm: they go from [`Recipe::size_mm`]'s end up to here.
    pub large_mm: f64,
    /// Part of the volumes that are large, within 0..=1.
    pub large_share: f64,
    /// Refractive index of the boundary.
    pub refractive_index: f64,
    /// The uses.
    pub splits: Vec<Split>,
}

/// Most voxels of a solid's box.
const MAX_VOXELS: f64 = (1u64 << 33) as f64;

/// Longest recipe file that is read.
const MAX_FILE: u64 = 1 << 20;

impl Recipe {
    /// Reads and checks a recipe in JSON.
    ///
    /// # Errors
    /// [`DatasetError::Io`] when the file cannot be read or is over 1 MiB long; [`DatasetError::Invalid`] when it is no
    /// recipe, and as [`Recipe::check`].
    pub fn read(path: &Path) -> Result<Self, DatasetError> {
        let text = read_text_bounded(path, MAX_FILE)?;
        let damaged = |e: serde_json::Error| {
            let remedy = "start from datasets/recipes/default.json";
            DatasetError::damaged(path, "recipe", format!("is no recipe in JSON ({e})"), remedy)
        };
        let recipe: Self = serde_json::from_str(&text).map_err(damaged)?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Checks the ranges of a recipe.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] naming the field.
    pub fn check(&self) -> Result<(), DatasetError> {
        let invalid = |field: String, reason: &str| Err(DatasetError::invalid(field, reason));
        let [low, high] = self.size_mm;
        if !(1.0..=100.0).contains(&low) || !(low..=100.0).contains(&high) {
            return invalid("size_mm".into(), "must ascend within 1 to 100 mm");
        }
        if !(high..=100.0).contains(&self.large_mm) {
            return invalid("large_mm".into(), "must lie between the end of size_mm and 100");
        }
        if !(0.0..=1.0).contains(&self.large_share) {
            return invalid("large_share".into(), "must lie within 0 to 1");
        }
        let voxels: f64 = self.pitch.mm().iter().map(|mm| self.large_mm / mm).product();
        if voxels > MAX_VOXELS {
            return invalid("large_mm".into(), "takes more than 2^33 voxels; use a coarser pitch or less");
        }
        if !(1.0..=4.0).contains(&self.refractive_index) {
            return invalid("refractive_index".into(), "must lie within 1 to 4");
        }
        for (i, split) in self.splits.iter().enumerate() {
            let field = |name: &str| format!("splits[{i}] {:?}, {name}", split.name);
            if self.splits[..i].iter().any(|s| s.name == split.name) {
                return invalid(field("name"), "is used twice");
            }
            if split.std_error.is_some_and(|e| !(e.is_finite() && e > 0.0)) {
                return invalid(field("std_error"), "must be above 0, such as 0.003");
            }
            if split.volumes == 0 || split.points == 0 || split.spp == 0 {
                return invalid(field("volumes, points and spp"), "must be at least 1");
            }
            let weights_fine = split.shapes.iter().all(|(_, w)| w.is_finite() && *w > 0.0);
            if split.shapes.is_empty() || !weights_fine {
                return invalid(field("shapes"), "needs at least one family, weights above 0");
            }
            if !(1e-6..=1e6).contains(&split.density) {
                return invalid(field("density"), "must lie within 1e-6 to 1e6");
            }
            split.check_variety().or_else(|(name, reason)| invalid(field(name), reason))?;
        }
        Ok(())
    }

    /// The split of a name.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] listing the names there are.
    pub fn split(&self, name: &str) -> Result<&Split, DatasetError> {
        self.splits.iter().find(|s| s.name == name).ok_or_else(|| {
            let names: Vec<_> = self.splits.iter().map(|s| s.name.as_str()).collect();
            DatasetError::invalid(format!("split {name:?}"), format!("the recipe has {}", names.join(", ")))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::MaterialTable;

    #[test]
    fn families_are_named_as_recipes_spell_them() {
        for class in ShapeClass::ALL {
            assert_eq!(serde_json::to_value(class).unwrap(), class.name());
        }
    }

    pub(crate) fn recipe() -> Recipe {
        let split = |name: &str| Split {
            name: name.into(),
            volumes: 4,
            points: 100,
            spp: 16,
            std_error: None,
            shapes: vec![(ShapeClass::Cube, 1.0), (ShapeClass::Slab, 1.0), (ShapeClass::Tube, 2.0)],
            density: 1.0,
            other_inks: None,
            neighbours: None,
            pale: None,
            halftone: Halftone::Ranked,
        };
        Recipe {
            name: "test".into(),
            seed: 5,
            pitch: Pitch::j750(),
            size_mm: [2.0, 4.0],
            large_mm: 5.0,
            large_share: 0.1,
            refractive_index: 1.5,
            splits: vec![split("train"), split("test")],
        }
    }

    #[test]
    fn volumes_follow_from_the_recipe_and_differ() {
        let r = recipe();
        let a = r.draw(&r.splits[0], 0, 5);
        assert_eq!(a, r.draw(&r.splits[0], 0, 5));
        assert_ne!(a, r.draw(&r.splits[0], 1, 5));
        assert_ne!(a, r.draw(&r.splits[1], 0, 5));
        let json = serde_json::to_string(&r).unwrap();
        assert_eq!(serde_json::from_str::<Recipe>(&json).unwrap(), r);
    }

    #[test]
    fn the_default_recipe_is_valid() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recipes/default.json");
        let recipe = Recipe::read(&path).unwrap();
        let splits = ["train", "validation", "test", "unseen-shape", "thin", "loops"];
        for split in splits {
            recipe.split(split).unwrap();
        }
        let training: Vec<_> = recipe.split("train").unwrap().shapes.iter().map(|s| s.0).collect();
        assert!(recipe.split("unseen-shape").unwrap().shapes.iter().all(|s| !training.contains(&s.0)));
        assert!(Recipe::read(Path::new("nowhere.json")).unwrap_err().to_string().contains("nowhere.json"));
    }

    #[test]
    fn other_inks_are_a_share_of_the_volumes_within_their_factors() {
        let (mut r, table) = (recipe(), MaterialTable::cmykw());
        let plain = r.draw_materials(&r.splits[0], 3, &table).unwrap();
        assert_eq!(plain.materials(), table.materials());
        r.splits[0].other_inks = Some(OtherInks { share: 0.5, density: 6.0, each: 1.5 });
        let (mut others, mut densities) = (0, Vec::new());
        for volume in 0..200 {
            let drawn = r.draw_materials(&r.splits[0], volume, &table).unwrap();
            assert_eq!(drawn, r.draw_materials(&r.splits[0], volume, &table).unwrap());
            let pairs = || drawn.materials().iter().zip(table.materials());
            let coefficients = pairs()
                .flat_map(|(a, b)| a.sigma_s.iter().zip(&b.sigma_s).chain(a.sigma_a.iter().zip(&b.sigma_a)));
            let factors: Vec<f64> = coefficients.map(|(a, b)| f64::from(*a) / f64::from(*b)).collect();
            if factors.iter().all(|f| (f - 1.0).abs() < 1e-6) {
                continue;
            }
            others += 1;
            let (least, most) =
                factors.iter().fold((f64::INFINITY, 0.0f64), |(l, m), &f| (l.min(f), m.max(f)));
            assert!(most / least > 1.1 && most / least <= 2.25 * 1.001, "{least} {most}");
            assert!(least > 1.0 / 9.01 && most < 9.01, "{least} {most}");
            densities.push((least * most).sqrt());
        }
        // Four standard errors of 200 draws with even chances.
        assert!((100i32 - others).abs() <= 28, "{others}");
        assert!(densities.iter().any(|d| *d > 4.0) && densities.iter().any(|d| *d < 0.25));
    }

    #[test]
    fn pale_volumes_are_tints_and_more_are_large() {
        let mut r = recipe();
        r.splits[0].shapes = vec![(ShapeClass::Sphere, 1.0)];
        let before = r.draw(&r.splits[0], 7, 5);
        r.splits[0].pale = Some(Pale { share: 0.0, large_share: r.large_share });
        assert_eq!(r.draw(&r.splits[0], 7, 5), before, "a share of none changes nothing");
        r.splits[0].pale = Some(Pale { share: 1.0, large_share: 1.0 });
        for volume in 0..20 {
            let (shape, texture) = r.draw(&r.splits[0], volume, 5);
            assert!(
                texture.palette.iter().all(|m| m[4] >= 0.7 && (m.iter().sum::<f64>() - 1.0).abs() < 1e-12)
            );
            assert!(shape.reach()[0] >= 0.5 * r.size_mm[1], "{shape:?}");
        }
        r.splits[0].pale = Some(Pale { share: 1.5, large_share: 0.0 });
        assert!(r.check().unwrap_err().to_string().contains("pale"));
    }

    #[test]
    fn names_the_bad_field() {
        let mut r = recipe();
        r.splits[1].density = 0.0;
        assert!(r.check().unwrap_err().to_string().contains("\"test\", density"));
        r.splits[1] = r.splits[0].clone();
        assert!(r.check().unwrap_err().to_string().contains("used twice"));
        assert!(r.split("nowhere").unwrap_err().to_string().contains("train"));
    }
}
