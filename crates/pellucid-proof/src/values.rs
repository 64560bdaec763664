//! How many values pixels have.

use crate::ProofError;

/// Refuses empty pictures and lists of another length than 4 values a pixel.
pub(crate) fn check_values(subject: &str, width: u32, height: u32, values: usize) -> Result<(), ProofError> {
    let needed = u128::from(width) * u128::from(height) * 4;
    if needed == 0 {
        return Err(ProofError::invalid(subject, format!("{width} x {height} pixels; 1 x 1 is the least")));
    }
    if needed != values as u128 {
        return Err(ProofError::invalid(
            subject,
            format!("{values} values; {width} x {height} pixels have {needed}"),
        ));
    }
    Ok(())
}
