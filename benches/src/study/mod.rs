//! Studies: measurements that end in a table and a plot.
//!
//! A study runs with `cargo bench --bench NAME`, small, or with `-- --full` as its published figures were made.
//!
//! | module | owns |
//! | --- | --- |
//! | [`settings`] | the arguments of every study |
//! | [`record`] | what a result was measured with: commit, machine, instruction set, threads, settings |
//! | [`table`] | rows as Markdown and CSV |
//! | [`plot`] | curves as SVG |
//! | [`stopwatch`] | processor time, and work on one thread |
//! | [`kept`] | what an earlier run measured |

pub mod kept;
pub mod plot;
pub mod record;
pub mod settings;
pub mod stopwatch;
pub mod table;

use std::path::{Path, PathBuf};

use pellucid_core::{FileError, files};

pub use kept::Kept;
pub use plot::{Axis, Panel, Plot, Series};
pub use record::Record;
pub use settings::{ResumableSettings, StudySettings};
pub use table::Table;

/// Where a study writes, and what it says of itself.
pub struct Study {
    name: &'static str,
    folder: PathBuf,
    record: Record,
}

impl Study {
    /// The study `name`. Full ones write to `docs/results/NAME` of this repository, small ones to `NAME` in the folder
    /// `scratch`, so that they leave published figures alone; both where the settings say so.
    ///
    /// # Errors
    /// [`FileError`] when the folder cannot be made.
    pub fn new(
        name: &'static str,
        scratch: &str,
        settings: &StudySettings,
        record: Record,
    ) -> Result<Self, FileError> {
        let folder = match (&settings.out, settings.full) {
            (Some(folder), _) => folder.clone(),
            (None, true) => Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/results").join(name),
            (None, false) => Path::new(scratch).join(name),
        };
        std::fs::create_dir_all(&folder).map_err(FileError::at("create", &folder))?;
        Ok(Self { name, folder, record })
    }

    /// The study's name: that of its files.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Where it writes.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes `NAME.md`, `NAME.csv` and `NAME.svg`. The Markdown is a title, the record, the plot and `body`; the CSV
    /// begins with the record behind `#`.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn write(&self, title: &str, body: &str, rows: &Table, plot: &Plot) -> Result<(), FileError> {
        let Self { name, folder, record } = self;
        let markdown =
            format!("# {title}\n\n{}\n![{title}]({name}.svg)\n\n{}\n", record.markdown(), body.trim_end());
        files::write_whole_bytes(folder.join(format!("{name}.md")), markdown.as_bytes())?;
        let csv = record.comments() + &rows.csv();
        files::write_whole_bytes(folder.join(format!("{name}.csv")), csv.as_bytes())?;
        files::write_whole_bytes(folder.join(format!("{name}.svg")), plot.svg().as_bytes())?;
        println!("wrote {}", folder.display());
        Ok(())
    }
}
