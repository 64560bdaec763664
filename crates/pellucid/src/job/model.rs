//! The appearance of a prepared print as a glTF model.

use std::path::Path;

use pellucid_core::Control;
use pellucid_proof::glb::{Glb, Look};

use crate::{Prepared, PrintError};

/// Writes `proof.glb` into a folder.
pub(super) fn write_model(prepared: &Prepared, dir: &Path, control: &Control<'_>) -> Result<(), PrintError> {
    let (aimed, [unrefined, refined]) = (&prepared.aimed, &prepared.judged.appearance);
    let looks = [("refined", refined), ("target", &aimed.target), ("unrefined", unrefined)];
    let looks = looks.map(|(name, colors)| Look { name, colors });
    let glb = Glb::of(&prepared.refined.labels, aimed.object.surface(), &looks, control)?;
    Ok(glb.write(dir.join("proof.glb"))?)
}
