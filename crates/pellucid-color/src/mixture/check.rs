//! Which tables a mixture can be made of.

use pellucid_voxel::MaterialTable;

use super::{MAX_MATERIALS, MixtureModel};
use crate::ColorError;
use crate::spectrum::Conditions;

impl MixtureModel {
    /// Tells at once whether [`MixtureModel::under`] would take a table, but for a white that is too dark.
    ///
    /// ```
    /// use pellucid_color::{MixtureModel, spectrum::Illuminant};
    /// use pellucid_voxel::MaterialTable;
    /// assert!(MixtureModel::check(&MaterialTable::cmykw(), "white", Illuminant::D65).is_ok());
    /// assert!(MixtureModel::check(&MaterialTable::cmykw(), "gold", Illuminant::D65).is_err());
    /// ```
    ///
    /// # Errors
    /// As [`MixtureModel::new`].
    pub fn check(
        table: &MaterialTable,
        white: &str,
        conditions: impl Into<Conditions>,
    ) -> Result<(), ColorError> {
        checked(table, white, &conditions.into().rows_for(table.spectrum())?).map(drop)
    }
}

/// Checks the number of materials and the rows; the white's position in label order.
pub(super) fn checked(
    table: &MaterialTable,
    white: &str,
    to_rgb: &[Vec<f64>; 3],
) -> Result<usize, ColorError> {
    let (count, channels) = (table.len(), table.channels());
    let label = table
        .label_of(white)
        .ok_or_else(|| ColorError::invalid("white", format!("no material is named {white:?}")))?;
    if count < 2 {
        return Err(ColorError::invalid("materials", "a mixture needs at least 2: white and an ink"));
    }
    if count > MAX_MATERIALS {
        return Err(ColorError::unsupported(
            format!("a mixture of {count} materials"),
            format!("keep to {MAX_MATERIALS}"),
        ));
    }
    if to_rgb.iter().any(|row| row.len() != channels || row.iter().any(|v| !v.is_finite())) {
        return Err(ColorError::invalid("weights", format!("need {channels} finite values a row")));
    }
    for material in table.materials() {
        if material.sigma_s.iter().zip(&material.sigma_a).any(|(s, a)| s + a == 0.0) {
            return Err(ColorError::invalid(
                format!("material {:?}", material.name),
                "neither scatters nor absorbs; clear resin cannot be part of a colour mixture",
            ));
        }
    }
    Ok(usize::from(label) - 1)
}
