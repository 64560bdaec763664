//! Files that appear whole.

use std::path::Path;

/// Writes texts into a folder, which is made where there is none, each by way of a temporary file.
pub fn write_files(folder: &Path, files: &[(&str, String)]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for (name, text) in files {
        let temporary = folder.join(format!("{name}.tmp"));
        std::fs::write(&temporary, text)?;
        std::fs::rename(&temporary, folder.join(name))?;
    }
    Ok(())
}
