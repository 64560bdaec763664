//! Which files a proof has beside its pictures.

use pellucid_core::Fault;

use crate::PrintError;

/// Files of a proof beside its pictures; each needs the cargo feature of its name. None by default, whatever features are
/// on.
///
/// ```
/// use pellucid::job::ProofFiles;
/// assert_eq!(ProofFiles::default(), ProofFiles { html: false, glb: false });
/// assert_eq!(ProofFiles::built().html, cfg!(feature = "html"));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProofFiles {
    /// `proof.html`: one page to turn the print, compare and look into its slices.
    pub html: bool,
    /// `proof.glb`: the refined appearance as a glTF model, with target and unrefined as variants.
    pub glb: bool,
}

impl ProofFiles {
    /// All that this build can write.
    pub fn built() -> Self {
        Self { html: cfg!(feature = "html"), glb: cfg!(feature = "glb") }
    }

    /// Tells whether this build can write them.
    ///
    /// # Errors
    /// [`PrintError::Unsupported`] naming the cargo feature that is missing.
    pub fn check(self) -> Result<(), PrintError> {
        let built = Self::built();
        let wanted = [("html", self.html, built.html), ("glb", self.glb, built.glb)];
        match wanted.into_iter().find(|(_, wanted, built)| *wanted && !built) {
            None => Ok(()),
            Some((feature, ..)) => {
                let fault = Fault::new(format!("proof.{feature}"), "this build cannot write it")
                    .remedy(format!("build with the cargo feature {feature}"));
                Err(PrintError::Unsupported(fault))
            }
        }
    }
}
