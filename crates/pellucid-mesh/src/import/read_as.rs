//! Length units and axes: how a file's coordinates become metres in print axes.

use super::Format;

/// Length of one unit of a file's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum LengthUnit {
    /// Micrometre.
    #[cfg_attr(feature = "serde", serde(rename = "um"))]
    Micrometre,
    /// Millimetre.
    #[cfg_attr(feature = "serde", serde(rename = "mm"))]
    Millimetre,
    /// Centimetre.
    #[cfg_attr(feature = "serde", serde(rename = "cm"))]
    Centimetre,
    /// Inch, 25.4 mm.
    #[cfg_attr(feature = "serde", serde(rename = "in"))]
    Inch,
    /// Foot, 304.8 mm.
    #[cfg_attr(feature = "serde", serde(rename = "ft"))]
    Foot,
    /// Metre.
    #[cfg_attr(feature = "serde", serde(rename = "m"))]
    Metre,
}

impl LengthUnit {
    /// Every unit, the shortest first.
    pub const ALL: [Self; 6] =
        [Self::Micrometre, Self::Millimetre, Self::Centimetre, Self::Inch, Self::Foot, Self::Metre];

    /// Its symbol: `um`, `mm`, `cm`, `in`, `ft` or `m`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Micrometre => "um",
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Inch => "in",
            Self::Foot => "ft",
            Self::Metre => "m",
        }
    }

    /// The unit of a symbol.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.name() == name)
    }

    /// Metres of one unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Micrometre => 1e-6,
            Self::Millimetre => 1e-3,
            Self::Centimetre => 1e-2,
            Self::Inch => 0.0254,
            Self::Foot => 0.3048,
            Self::Metre => 1.0,
        }
    }
}

/// The axis of a file that becomes the print's z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum UpAxis {
    /// The file's `(x, y, z)` is `(x, -z, y)` in print axes.
    Y,
    /// The file's axes are the print's.
    Z,
}

impl UpAxis {
    /// `y` or `z`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// How a file was read, for a report, and to read it in the same way again.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReadAs {
    /// Its format.
    pub format: Format,
    /// Length of one unit of its coordinates.
    pub unit: LengthUnit,
    /// Its axis that points up.
    pub up: UpAxis,
    /// Colour given to what has none in the file, linear Rec.709.
    pub color: [f32; 3],
}

impl ReadAs {
    /// A point of the file in metres and print axes.
    pub fn to_print_m(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let turned = match self.up {
            UpAxis::Y => [x, -z, y],
            UpAxis::Z => [x, y, z],
        };
        turned.map(|c| c * self.unit.metres())
    }
}
