//! Which vector instructions the kernels use.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use crate::Fault;

/// A class of vector instructions, ascending. A kernel takes the best form it has that is not above what is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum InstructionSet {
    /// No vector instructions beyond what the compiler may use everywhere.
    Portable,
    /// AVX2 with FMA.
    Avx2,
    /// AVX-512 F, BW, DQ, VL.
    Avx512,
    /// AVX-512 with bf16 products.
    Avx512Bf16,
}

/// The environment variable that forces a lesser set on a whole process.
pub const VARIABLE: &str = "PELLUCID_INSTRUCTION_SET";

impl InstructionSet {
    /// All, ascending.
    pub const ALL: [Self; 4] = [Self::Portable, Self::Avx2, Self::Avx512, Self::Avx512Bf16];

    /// The best set that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx512 && is_x86_feature_detected!("avx512bf16") {
                return Self::Avx512Bf16;
            }
            if avx512 {
                return Self::Avx512;
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Self::Avx2;
            }
        }
        Self::Portable
    }

    /// What kernels use where nobody chooses: the best set of this processor, or the lesser one that the environment
    /// variable [`VARIABLE`] names when the process first asks. An unknown name counts as none.
    pub fn chosen() -> Self {
        static CHOSEN: OnceLock<InstructionSet> = OnceLock::new();
        *CHOSEN.get_or_init(|| {
            let wanted = std::env::var(VARIABLE).ok().and_then(|name| name.parse().ok());
            wanted.map_or_else(Self::detect, |set: Self| set.min(Self::detect()))
        })
    }

    /// The sets that this processor has, ascending: what conformance tests run.
    pub fn available() -> impl Iterator<Item = Self> {
        let best = Self::detect();
        Self::ALL.into_iter().filter(move |set| *set <= best)
    }

    /// This set.
    ///
    /// # Errors
    /// [`Fault`] where the processor lacks it.
    pub fn require(self) -> Result<Self, Fault> {
        let best = Self::detect();
        if self <= best {
            return Ok(self);
        }
        Err(Fault::new("instruction set", format!("this processor has no {self}"))
            .remedy(format!("{best} or less runs here")))
    }

    /// The name in settings and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
            Self::Avx512Bf16 => "avx512bf16",
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for InstructionSet {
    type Err = Fault;

    fn from_str(name: &str) -> Result<Self, Fault> {
        Self::ALL.into_iter().find(|set| set.name() == name).ok_or_else(|| {
            Fault::new("instruction set", format!("{name:?} is unknown"))
                .remedy("portable, avx2, avx512 or avx512bf16")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_order_ascends() {
        for set in InstructionSet::ALL {
            assert_eq!(set.name().parse(), Ok(set));
        }
        assert!(InstructionSet::ALL.is_sorted());
        assert!("sse".parse::<InstructionSet>().unwrap_err().to_string().contains("avx2"));
        assert!(InstructionSet::available().any(|s| s == InstructionSet::Portable));
        assert!(InstructionSet::Portable.require().is_ok());
    }
}
