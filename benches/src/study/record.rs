//! What a result was measured with.

use std::process::Command;

use pellucid_core::InstructionSet;

/// Names and values, in order.
#[derive(Clone, Debug, Default)]
pub struct Record {
    fields: Vec<(String, String)>,
}

impl Record {
    /// Command, commit, machine and instruction set as they are now, for the study `name` on `threads` threads.
    pub fn now(name: &str, threads: usize) -> Self {
        let mut record = Self::default();
        record.add("command", command(name, std::env::args().skip(1)));
        record.add("version", format!("{}, commit {}", env!("CARGO_PKG_VERSION"), commit()));
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        record.add("machine", format!("{}, {cores} cores, {}", processor(), std::env::consts::OS));
        record.add("instruction set", InstructionSet::chosen().to_string());
        record.add("threads", threads.to_string());
        record
    }

    /// Adds a setting.
    pub fn add(&mut self, name: &str, value: impl Into<String>) {
        self.fields.push((name.to_owned(), value.into()));
    }

    /// A Markdown list.
    pub fn markdown(&self) -> String {
        self.fields.iter().map(|(name, value)| format!("- {name}: {value}\n")).collect()
    }

    /// Lines behind `#`, for CSV.
    pub fn comments(&self) -> String {
        self.fields.iter().map(|(name, value)| format!("# {name}: {}\n", value.replace('\n', " "))).collect()
    }
}

/// What starts a study with these arguments; of paths only the last part, which alone means something elsewhere.
fn command(name: &str, arguments: impl Iterator<Item = String>) -> String {
    let mut text = format!("cargo bench -p pellucid-benches --bench {name}");
    for (i, argument) in arguments.filter(|a| a != "--bench").enumerate() {
        text += if i == 0 { " -- " } else { " " };
        text += argument.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
    }
    text
}

/// Hash and date of the commit that was built, and whether files differ from it.
fn commit() -> String {
    let git = |args: &[&str]| {
        let out = Command::new("git").args(args).current_dir(env!("CARGO_MANIFEST_DIR")).output().ok()?;
        out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_owned())
    };
    match git(&["log", "-1", "--format=%h of %cs"]) {
        None => "unknown".into(),
        Some(commit)
            if git(&["status", "--porcelain", "--untracked-files=no"]).is_none_or(|s| s.is_empty()) =>
        {
            commit
        }
        Some(commit) => commit + ", with changes",
    }
}

/// The processor's name, where the system tells.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_name_no_folders_of_this_machine() {
        let given = ["--full", "--sets", "/home/a/sets/", "b/w.safetensors", "--bench"].map(String::from);
        let command = command("x", given.into_iter());
        assert_eq!(command, "cargo bench -p pellucid-benches --bench x -- --full --sets sets w.safetensors");
        let small = super::command("x", std::iter::once("--bench".to_owned()));
        assert_eq!(small, "cargo bench -p pellucid-benches --bench x");
    }

    #[test]
    fn a_record_names_what_was_measured_with() {
        let mut record = Record::now("a", 1);
        record.add("paths", "7");
        let (markdown, comments) = (record.markdown(), record.comments());
        for name in ["command", "version", "machine", "instruction set", "threads", "paths"] {
            assert!(markdown.contains(&format!("- {name}: ")), "{markdown}");
            assert!(comments.contains(&format!("# {name}: ")), "{comments}");
        }
        assert!(comments.lines().all(|line| line.starts_with("# ")));
    }
}
