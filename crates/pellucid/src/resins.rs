//! How much of each resin a print takes.

use pellucid_voxel::{LabelGrid, MaterialTable};
use serde::{Deserialize, Serialize};

/// Density of cured resin in g/cm³: the makers of the Vero resins state 1.17 to 1.18.
const DENSITY_G_PER_CM3: f64 = 1.18;
const MM3_PER_CM3: f64 = 1000.0;

/// Volume and mass of the resins of a print, without support.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Resins {
    /// What masses are computed with, in g/cm³.
    pub density_g_per_cm3: f64,
    /// Of all materials in cm³.
    pub volume_cm3: f64,
    /// Of all materials in g.
    pub grams: f64,
    /// Of each material in use, by ascending label as in the manifest.
    pub materials: Vec<ResinUse>,
}

/// Volume and mass of one resin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ResinUse {
    /// Label in the voxel grid.
    pub label: u8,
    /// The material's name.
    pub name: String,
    /// Volume in cm³.
    pub volume_cm3: f64,
    /// Mass in g.
    pub grams: f64,
}

impl Resins {
    /// Of labels; those that the table has not are left out.
    ///
    /// ```
    /// use pellucid::report::Resins;
    /// use pellucid::voxel::{Frame, LabelGrid, MaterialTable, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3])?, [10, 20, 10])?;
    /// let resins = Resins::of(&LabelGrid::from_fn(frame, |_| 5), &MaterialTable::cmykw());
    /// assert!((resins.volume_cm3 - 0.002).abs() < 1e-12);
    /// assert_eq!(resins.materials[0].name, "white");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of(labels: &LabelGrid, table: &MaterialTable) -> Self {
        let voxel_cm3 = labels.frame().pitch().volume_mm3() / MM3_PER_CM3;
        let counts = labels.histogram();
        let used = (1..=u8::MAX).filter(|&label| counts[usize::from(label)] > 0);
        let of_label = |label: u8| {
            let volume_cm3 = counts[usize::from(label)] as f64 * voxel_cm3;
            let name = table.get(label)?.name.clone();
            Some(ResinUse { label, name, volume_cm3, grams: volume_cm3 * DENSITY_G_PER_CM3 })
        };
        let materials: Vec<ResinUse> = used.filter_map(of_label).collect();
        let volume_cm3 = materials.iter().map(|m| m.volume_cm3).sum();
        Self {
            density_g_per_cm3: DENSITY_G_PER_CM3,
            volume_cm3,
            grams: volume_cm3 * DENSITY_G_PER_CM3,
            materials,
        }
    }
}
