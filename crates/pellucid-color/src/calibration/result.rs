//! What a fit found, and how far it may be trusted.

use pellucid_voxel::MaterialTable;

use crate::space::Lab;

/// A scattering or absorption coefficient of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Coefficient {
    /// 1/mm.
    pub value: f64,
    /// Standard error of its logarithm: the relative error, where that is small. From 1 on the measurements hardly
    /// depend on the coefficient.
    pub relative_error: f64,
}

/// What was found of a material.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MaterialFit {
    /// Its name.
    pub name: String,
    /// Scattering by channel.
    pub sigma_s: Vec<Coefficient>,
    /// Absorption by channel.
    pub sigma_a: Vec<Coefficient>,
    /// How uncertain its colours are by the measurements' scatter, as CIEDE2000: the most of 0.2 mm over thick white,
    /// 0.2 mm over thick black, and 1 mm over black.
    pub color_error: f64,
}

/// A measured patch beside what the fitted materials give.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PatchFit {
    /// The patch's name.
    pub id: String,
    /// What it is made of.
    pub stack: String,
    /// Whether it was not fitted but checks the fit.
    pub check: bool,
    /// As measured.
    pub measured: Lab,
    /// Of the fitted materials.
    pub predicted: Lab,
    /// CIEDE2000 between the two.
    pub delta_e: f64,
}

/// Materials fitted to measured patches.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Calibration {
    /// The materials, inks in the order of the measurements, black and white last.
    pub materials: MaterialTable,
    /// The refractive index that was taken for granted.
    pub refractive_index: f64,
    /// How sure the coefficients are, in the order of `materials`.
    pub fits: Vec<MaterialFit>,
    /// The patches, in the order of the measurements.
    pub patches: Vec<PatchFit>,
}

impl Calibration {
    /// Mean and largest CIEDE2000 of the patches that were fitted, or of those that check; 0 where there are none.
    pub fn delta_e(&self, check: bool) -> (f64, f64) {
        let (mut sum, mut most, mut count) = (0.0, 0.0f64, 0);
        for patch in self.patches.iter().filter(|patch| patch.check == check) {
            sum += patch.delta_e;
            most = most.max(patch.delta_e);
            count += 1;
        }
        (sum / f64::from(count.max(1)), most)
    }
}
