//! Which files a proof has beside its pictures.

use pellucid_core::Fault;

use crate::PrintError;

/// Files of a proof beside its pictures; each needs the cargo feature of its name. None by default, whatever features are
/// on.
///
/// ```
/// use pellucid::job::ProofFiles;
/// assert_eq!(ProofFiles::default(), ProofFiles { html: false });
/// assert_eq!(ProofFiles::built().html, cfg!(feature = "html"));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProofFiles {
    /// `proof.html`: one page to turn the print, compare and look into its slices.
    pub html: bool,
}

impl ProofFiles {
    /// All that this build can write.
    pub fn built() -> Self {
        Self { html: cfg!(feature = "html") }
    }

    /// Tells whether this build can write them.
    ///
    /// # Errors
    /// [`PrintError::Unsupported`] naming the cargo feature that is missing.
    pub fn check(self) -> Result<(), PrintError> {
        let missing = |feature: &str| {
            let fault = Fault::new(format!("proof.{feature}"), "this build cannot write it")
                .remedy(format!("build with the cargo feature {feature}"));
            PrintError::Unsupported(fault)
        };
        if self.html && !Self::built().html { Err(missing("html")) } else { Ok(()) }
    }
}
