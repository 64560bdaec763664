//! The lights that prints are seen under.

use super::cie::{D50, D65, linear};
use super::lamps::{F11, LAMP_ENTRIES, LAMPS_START_NM, LAMPS_STEP_NM, LED_B3};

/// The light a print is seen under.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Illuminant {
    /// Average daylight.
    #[default]
    D65,
    /// Horizon daylight, the graphic arts' viewing light.
    D50,
    /// Equal energy.
    E,
    /// A tungsten lamp: Planck's radiator at 2856 K.
    A,
    /// A fluorescent lamp of three narrow bands, 4000 K (CIE's F11).
    F11,
    /// A blue diode with a phosphor, 4103 K (CIE's LED-B3).
    #[cfg_attr(feature = "serde", serde(rename = "LED"))]
    Led,
}

impl Illuminant {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::D65, Self::D50, Self::E, Self::A, Self::F11, Self::Led];

    /// A short name: `D65`, `D50`, `E`, `A`, `F11` or `LED`.
    pub fn name(self) -> &'static str {
        match self {
            Self::D65 => "D65",
            Self::D50 => "D50",
            Self::E => "E",
            Self::A => "A",
            Self::F11 => "F11",
            Self::Led => "LED",
        }
    }

    /// The illuminant of a name, in any case.
    ///
    /// ```
    /// use pellucid_color::spectrum::Illuminant;
    /// assert_eq!(Illuminant::from_name("led"), Some(Illuminant::Led));
    /// assert_eq!(Illuminant::from_name("candle"), None);
    /// ```
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|i| i.name().eq_ignore_ascii_case(name))
    }

    /// Relative power at a wavelength, linear between the tabulated ones as the CIE has it.
    pub(super) fn power(self, nm: f64) -> f64 {
        match self {
            Self::D65 => linear(&D65, nm),
            Self::D50 => linear(&D50, nm),
            Self::E => 100.0,
            Self::A => {
                // The CIE's definition, with the constant of 1931.
                let radiated = |nm: f64| nm.powi(-5) / ((1.435e7 / (2848.0 * nm)).exp() - 1.0);
                100.0 * radiated(nm) / radiated(560.0)
            }
            Self::F11 => lamp(&F11, nm),
            Self::Led => lamp(&LED_B3, nm),
        }
    }

    /// Whether its power hardly changes within 10 nm, so that its value at a band's wavelength stands for the band.
    pub(super) fn is_smooth(self) -> bool {
        !matches!(self, Self::F11 | Self::Led)
    }
}

/// Linear between entries, dark outside.
fn lamp(table: &[f64; LAMP_ENTRIES], nm: f64) -> f64 {
    let at = (nm - LAMPS_START_NM) / LAMPS_STEP_NM;
    if !(0.0..=(LAMP_ENTRIES - 1) as f64).contains(&at) {
        return 0.0;
    }
    let i = (at as usize).min(LAMP_ENTRIES - 2);
    table[i] + (at - i as f64) * (table[i + 1] - table[i])
}
