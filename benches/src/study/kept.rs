//! What an earlier run of a study measured, so that one that was cut off goes on.

use std::path::{Path, PathBuf};

use pellucid_core::files::write_whole_bytes;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::appearance::Error;

/// Folder of what is done.
pub struct Kept(PathBuf);

impl Kept {
    /// Of the study `name`: in the folder that was given, else in `scratch`; full and small runs apart.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(name: &str, given: Option<&Path>, scratch: &str, full: bool) -> Result<Self, Error> {
        let size = if full { "full" } else { "small" };
        let folder = match given {
            Some(folder) => folder.join(size),
            None => Path::new(scratch).join(format!("{name}-{size}-state")),
        };
        std::fs::create_dir_all(&folder)?;
        Ok(Self(folder))
    }

    /// What was measured before under this name, or is now, and then kept.
    ///
    /// # Errors
    /// Those of `measure`; when a file cannot be read or written.
    pub fn or<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        measure: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error> {
        if let Some(found) = self.get(name)? {
            return Ok(found);
        }
        println!("{name}");
        let found = measure()?;
        write_whole_bytes(self.path(name), &serde_json::to_vec(&found)?)?;
        Ok(found)
    }

    /// What was measured before under this name.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn get<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, Error> {
        let path = self.path(name);
        Ok(if path.exists() { Some(serde_json::from_slice(&std::fs::read(path)?)?) } else { None })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(format!("{}.json", name.replace([' ', ',', '.'], "-")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_is_not_measured_again_but_a_failure_is() {
        let folder = std::env::temp_dir().join(format!("pellucid-kept-{}", std::process::id()));
        let kept = Kept::new("study", Some(&folder), "", false).unwrap();
        assert!(kept.or::<u32>("a, b", || Err("no".into())).is_err());
        assert_eq!(kept.get::<u32>("a, b").unwrap(), None);
        assert_eq!(kept.or("a, b", || Ok(7)).unwrap(), 7);
        assert_eq!(kept.or("a, b", || Ok(8)).unwrap(), 7);
        assert_eq!(kept.get::<u32>("a, b").unwrap(), Some(7));
        let other = Kept::new("study", Some(&folder), "", true).unwrap();
        assert_eq!(other.or("a, b", || Ok(9)).unwrap(), 9, "small and full runs are apart");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
