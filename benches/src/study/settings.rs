//! The arguments of every study.

use std::path::PathBuf;

use super::Kept;
use crate::appearance::Error;

/// Arguments that every study takes; flatten them into its own.
#[derive(Clone, Debug, clap::Args)]
pub struct StudySettings {
    /// Measure as the published figures were, and write to docs/results; without it less, in minutes, to the build folder
    #[arg(long)]
    pub full: bool,
    /// Folder to write to instead
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// What cargo passes to every benchmark
    #[arg(long, hide = true)]
    bench: bool,
}

/// Arguments of a study that goes on where it was cut off.
#[derive(Clone, Debug, clap::Args)]
pub struct ResumableSettings {
    /// Those of every study.
    #[command(flatten)]
    pub study: StudySettings,
    /// Folder for what is measured, from which a study goes on when it was cut off; in the build folder without it
    #[arg(long, value_name = "DIR")]
    pub state: Option<PathBuf>,
}

impl ResumableSettings {
    /// What earlier runs of the study `name` measured, by default in the folder `scratch`.
    ///
    /// # Errors
    /// As [`Kept::new`].
    pub fn kept(&self, name: &str, scratch: &str) -> Result<Kept, Error> {
        Kept::new(name, self.state.as_deref(), scratch, self.study.full)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Args {
        #[command(flatten)]
        study: StudySettings,
    }

    #[test]
    fn cargos_argument_changes_nothing() {
        let study = Args::try_parse_from(["study", "--full", "--bench"]).unwrap().study;
        assert!(study.full && study.out.is_none());
        let study = Args::try_parse_from(["study", "--bench"]).unwrap().study;
        assert!(!study.full);
    }
}
