//! Judges all finished runs and draws them, set by set and model by model.

use std::path::Path;

use pellucid::dataset::Recipe;
use pellucid::voxel::Control;

use super::finished::Finished;
use super::object::Case;
use super::pictures::{self, Look};
use super::plan::Shapes;
use super::report::Shown;
use super::runs::Runs;
use super::scores::Row;
use super::{Error, held_out, models};

/// Sets of which the first volume is drawn, with the networks' training shapes.
const DRAWN: [(&str, Shapes); 5] = [
    ("unseen-density-x4", Shapes::All),
    ("unseen-density-quarter", Shapes::All),
    ("unseen-shape", Shapes::All),
    ("unseen-density-x4", Shapes::Paper),
    ("unseen-density-quarter", Shapes::Paper),
];

/// What is judged, and where it is kept.
pub struct Judging<'a> {
    pub recipe: &'a Recipe,
    pub networks: &'a [Finished],
    pub full: bool,
    pub look: Look,
    /// Folder for labelled sets.
    pub folder: &'a Path,
    /// Folder for pictures.
    pub out: &'a Path,
    pub control: &'a Control<'a>,
}

impl Judging<'_> {
    /// Rows and pictures of all held-out sets.
    pub fn sets(&self, runs: &mut Runs) -> Result<(Vec<Row>, Vec<Shown>), Error> {
        let (mut rows, mut shown) = (Vec::new(), Vec::new());
        for name in held_out::SETS {
            let drawn = || DRAWN.iter().filter(|(set, _)| *set == name).map(|(_, shapes)| *shapes);
            rows.extend(runs.rows(name, self.networks, |networks| {
                let set = self.labelled(name)?;
                if drawn().next().is_some() {
                    let case = held_out::first_volume(&set, self.control)?;
                    drawn().try_for_each(|shapes| self.draw(&case, shapes, networks))?;
                }
                held_out::judge(&set, networks, self.control)
            })?);
            shown.extend(drawn().filter_map(|shapes| self.shown(name, shapes)));
        }
        Ok((rows, shown))
    }

    /// Rows and pictures of the models.
    pub fn models(&self, runs: &mut Runs) -> Result<(Vec<Row>, Vec<Shown>), Error> {
        let (mut rows, mut shown) = (Vec::new(), Vec::new());
        for (name, height_mm) in models::chosen(self.full) {
            rows.extend(runs.rows(name, self.networks, |networks| {
                let case = models::case(name, height_mm, self.control)?;
                let rows = models::judge(&case, networks, self.full, self.control)?;
                for shapes in [Shapes::All, Shapes::Paper] {
                    self.draw(&case, shapes, networks)?;
                }
                Ok(rows)
            })?);
            shown.extend([Shapes::All, Shapes::Paper].into_iter().filter_map(|s| self.shown(name, s)));
        }
        Ok((rows, shown))
    }

    fn labelled(&self, name: &str) -> Result<pellucid::dataset::LabelledSet, Error> {
        held_out::labelled(self.recipe, name, self.full, &self.folder.join("sets"), self.control)
    }

    /// Draws those of the networks that have seed 1 and were trained on some shapes, if there are any.
    fn draw(&self, case: &Case, shapes: Shapes, networks: &[&Finished]) -> Result<(), Error> {
        let first = |n: &&&Finished| n.group.shapes == shapes && n.group.seed == 1;
        let networks: Vec<&Finished> = networks.iter().filter(first).copied().collect();
        if networks.is_empty() {
            return Ok(());
        }
        let path = self.out.join(file(&case.name, shapes));
        pictures::draw(&path, case, &networks, self.look, self.control)
    }

    fn shown(&self, name: &str, shapes: Shapes) -> Option<Shown> {
        let file = file(name, shapes);
        let title = format!("{name}, trained on {}", shapes.name());
        self.out.join(&file).exists().then_some(Shown { file, title })
    }
}

fn file(name: &str, shapes: Shapes) -> String {
    format!("{name}-{}.png", shapes.name())
}
