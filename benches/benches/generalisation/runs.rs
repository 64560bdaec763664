//! What the runs came to, kept beside the report: a group takes hours, its networks' weights take many megabytes, and
//! the report is of all groups, wherever and whenever each was trained.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pellucid::core::files::write_whole_bytes;
use pellucid::rpnn::Variant;
use pellucid::rpnn::train::{CurvePoint, Score};
use serde::{Deserialize, Serialize};

use super::Error;
use super::finished::Finished;
use super::plan::Group;
use super::scores::Row;

/// A finished run without its weights.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    /// Name of the volumes trained on.
    pub shapes: String,
    pub seed: u64,
    /// Name of the architecture.
    pub variant: String,
    /// A digest of the weights.
    pub digest: String,
    /// Loss and validation over the run.
    pub curve: Vec<CurvePoint>,
    /// Seconds of its steps by the clock, samples not included.
    pub seconds: f64,
    /// Validation of the run that came to rest at three quarters of the steps.
    pub three_quarters: Option<Score>,
    /// Errors by set or model, a row for it all and for each of its shape families.
    pub rows: BTreeMap<String, Vec<Row>>,
}

/// The runs of a study, in a file.
pub struct Runs {
    path: PathBuf,
    runs: Vec<Run>,
}

impl Runs {
    /// Those kept in a folder; none where there are none yet.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = folder.join("runs.json");
        let runs = if path.exists() { serde_json::from_slice(&std::fs::read(&path)?)? } else { Vec::new() };
        Ok(Self { path, runs })
    }

    /// Whether all runs of a group are kept.
    pub fn has(&self, group: Group) -> bool {
        let kept = |variant: &Variant| self.find(group.shapes.name(), group.seed, variant.name()).is_some();
        Variant::ALL.iter().all(kept)
    }

    /// The run of some volumes, a seed and an architecture.
    pub fn find(&self, shapes: &str, seed: u64, variant: &str) -> Option<&Run> {
        self.runs.iter().find(|r| r.shapes == shapes && r.seed == seed && r.variant == variant)
    }

    /// The rows of a set or model for all networks: those that are kept, and what `judge` gives for the others as far as
    /// their weights are there.
    pub fn rows<'n>(
        &mut self,
        set: &str,
        networks: &'n [Finished],
        judge: impl FnOnce(&[&'n Finished]) -> Result<Vec<Row>, Error>,
    ) -> Result<Vec<Row>, Error> {
        let open: Vec<&Finished> =
            networks.iter().filter(|n| n.trained.is_some() && self.known(n, set).is_none()).collect();
        if !open.is_empty() {
            let rows = judge(&open)?;
            for network in open {
                let own = rows.iter().filter(|row| network.is_of(row)).cloned().collect();
                self.run_of(network).rows.insert(set.to_owned(), own);
            }
            write_whole_bytes(&self.path, &serde_json::to_vec(&self.runs)?)?;
        }
        Ok(networks.iter().filter_map(|n| self.known(n, set)).flatten().cloned().collect())
    }

    /// The networks that were not judged on a set or model, and cannot be any more.
    pub fn not_judged<'n>(
        &'n self,
        set: &'n str,
        networks: &'n [Finished],
    ) -> impl Iterator<Item = &'n Finished> + 'n {
        networks.iter().filter(move |n| n.trained.is_none() && self.known(n, set).is_none())
    }

    fn known(&self, network: &Finished, set: &str) -> Option<&Vec<Row>> {
        self.runs.iter().find(|run| run.digest == network.digest)?.rows.get(set)
    }

    /// The run of a network, which takes the place of an earlier one.
    fn run_of(&mut self, network: &Finished) -> &mut Run {
        let (shapes, variant) = (network.group.shapes.name(), network.variant.name());
        let same =
            |run: &Run| run.shapes == shapes && run.seed == network.group.seed && run.variant == variant;
        self.runs.retain(|run| !same(run) || run.digest == network.digest);
        let at = self.runs.iter().position(same).unwrap_or_else(|| {
            self.runs.push(Run {
                shapes: shapes.to_owned(),
                seed: network.group.seed,
                variant: variant.to_owned(),
                digest: network.digest.clone(),
                curve: network.curve.clone(),
                seconds: network.seconds,
                three_quarters: network.three_quarters,
                rows: BTreeMap::new(),
            });
            self.runs.len() - 1
        });
        &mut self.runs[at]
    }
}
