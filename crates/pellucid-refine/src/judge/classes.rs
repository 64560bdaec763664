//! Classes of colours by hue.

use serde::{Deserialize, Serialize};

/// A class of target colours by CIELAB (D65) of the target as given, relative to the print's white: chroma below 10 is
/// neutral, below 25 pale, the rest goes by hue angle. The sectors hold the primaries of sRGB and of process printing (ISO 12647-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorClass {
    /// Hue 15° to 65°: red, orange, brown, skin.
    Red,
    /// 65° to 115°.
    Yellow,
    /// 115° to 180°.
    Green,
    /// 180° to 255°.
    Cyan,
    /// 255° to 318°.
    Blue,
    /// 318° to 15°.
    Magenta,
    /// Chroma 10 to 25 and hue 318° to 115°: cream, pink, light skin, greyish brown.
    PaleWarm,
    /// Chroma 10 to 25 and hue 115° to 318°.
    PaleCool,
    /// Chroma below 10 and L\* at least 70.
    NeutralLight,
    /// Chroma below 10 and L\* 30 to 70.
    NeutralMid,
    /// Chroma below 10 and L\* below 30.
    NeutralDark,
}

/// Chroma from which a colour has a hue.
const LEAST_CHROMA: f32 = 10.0;

/// Chroma from which it is no longer pale.
const VIVID_CHROMA: f32 = 25.0;

impl ColorClass {
    /// Every class.
    pub const ALL: [Self; 11] = [
        Self::Red,
        Self::Yellow,
        Self::Green,
        Self::Cyan,
        Self::Blue,
        Self::Magenta,
        Self::PaleWarm,
        Self::PaleCool,
        Self::NeutralLight,
        Self::NeutralMid,
        Self::NeutralDark,
    ];

    /// The class of `[L*, a*, b*]`.
    ///
    /// ```
    /// use pellucid_refine::ColorClass;
    /// assert_eq!(ColorClass::of([53.2, 80.1, 67.2]), ColorClass::Red);
    /// assert_eq!(ColorClass::of([91.0, 2.0, -3.0]), ColorClass::NeutralLight);
    /// ```
    pub fn of(lab: [f32; 3]) -> Self {
        let [l, a, b] = lab;
        let chroma = a.hypot(b);
        if chroma < LEAST_CHROMA {
            return match l {
                l if l >= 70.0 => Self::NeutralLight,
                l if l >= 30.0 => Self::NeutralMid,
                _ => Self::NeutralDark,
            };
        }
        match b.atan2(a).to_degrees().rem_euclid(360.0) {
            h if chroma < VIVID_CHROMA => match h {
                h if (115.0..318.0).contains(&h) => Self::PaleCool,
                _ => Self::PaleWarm,
            },
            h if h < 15.0 => Self::Magenta,
            h if h < 65.0 => Self::Red,
            h if h < 115.0 => Self::Yellow,
            h if h < 180.0 => Self::Green,
            h if h < 255.0 => Self::Cyan,
            h if h < 318.0 => Self::Blue,
            _ => Self::Magenta,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_color::Lab;

    #[test]
    fn primaries_lie_in_their_classes() {
        use ColorClass::*;
        let of = |rgb: [f64; 3]| {
            let lab = Lab::from_linear_rgb(rgb);
            ColorClass::of([lab.l, lab.a, lab.b].map(|v| v as f32))
        };
        let corners = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
        assert_eq!(corners.map(of), [Red, Yellow, Green, Cyan, Blue]);
        assert_eq!(of([1.0, 0.0, 1.0]), Magenta);
        assert_eq!([0.9, 0.2, 0.01].map(|v| of([v; 3])), [NeutralLight, NeutralMid, NeutralDark]);
        let pale = [[90.0, 2.0, 14.0], [80.0, 15.0, -3.0], [80.0, -12.0, 3.0], [75.0, 2.0, -20.0]];
        assert_eq!(pale.map(ColorClass::of), [PaleWarm, PaleWarm, PaleCool, PaleCool]);
        // Solids of ISO 12647-2 on coated paper: C, M, Y, R, G, B.
        let process = [
            [55.0, -37.0, -50.0],
            [48.0, 74.0, -3.0],
            [89.0, -5.0, 93.0],
            [47.0, 68.0, 48.0],
            [50.0, -68.0, 25.0],
            [24.0, 22.0, -46.0],
        ];
        assert_eq!(process.map(ColorClass::of), [Cyan, Magenta, Yellow, Red, Green, Blue]);
    }
}
