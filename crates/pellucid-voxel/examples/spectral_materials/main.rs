//! Writes the virtual spectral inks: `cargo run -p pellucid-voxel --example spectral_materials [FILE]`, by default
//! `crates/pellucid-voxel/materials/cmykw-spectral.json`.

mod table;

use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("materials/cmykw-spectral.json");
    let path = std::env::args_os().nth(1).map_or(own, PathBuf::from);
    let text = pretty(&serde_json::to_string(&table::spectral_table()?)?);
    std::fs::write(&path, text)?;
    println!("{}", path.display());
    Ok(())
}

/// A line a list.
fn pretty(json: &str) -> String {
    let note = "{\n\"note\": \"virtual: no measured spectra, but smooth ones whose means over 400 to 490, 500 to 590 and 600 to \
                700 nm are the RGB table's; made by the example spectral_materials of pellucid-voxel\",\n";
    let body = json.trim_start_matches('{');
    let body = body.replace("\"materials\":[", "\n\"materials\":[\n").replace("},{", "},\n{");
    let body = body.replace("\"sigma_s\"", "\n \"sigma_s\"").replace("\"sigma_a\"", "\n \"sigma_a\"");
    format!("{note}{}\n", body.replace("\"g\"", "\n \"g\"").replace("]}", "]\n}"))
}
