//! What a measured patch is made of, in a text that fits into a table's cell.

use std::fmt;
use std::str::FromStr;

use crate::ColorError;

/// Layers of materials, top first.
///
/// As text, layers are parted by `/`; each is a material and its thickness in mm, the last one without thickness goes
/// on for ever. Mixtures are `30% cyan + 70% white`, by volume.
///
/// ```
/// use pellucid_color::calibration::Stack;
/// let stack: Stack = "30% cyan + 70% white 0.54 / white 1.89 / black".parse()?;
/// assert_eq!(stack.layers().len(), 3);
/// assert_eq!(stack.layers()[0].parts()[0], ("cyan".to_owned(), 0.3));
/// assert_eq!(stack.to_string(), "30% cyan + 70% white 0.54 / white 1.89 / black");
/// # Ok::<(), pellucid_color::ColorError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Stack(Vec<StackLayer>);

/// Thinner layers are none.
const LEAST_MM: f64 = 1e-6;

/// A layer of a [`Stack`].
#[derive(Clone, Debug, PartialEq)]
pub struct StackLayer {
    parts: Vec<(String, f64)>,
    thickness_mm: f64,
}

impl StackLayer {
    /// A layer of a mixture of materials by name and share of the volume.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] unless the names can stand in a text and differ, the shares lie within 0 to 1 and sum to
    /// 1 (to a thousandth), and the thickness is above 0, in mm; infinity is a layer without a far side.
    pub fn new(parts: Vec<(String, f64)>, thickness_mm: f64) -> Result<Self, ColorError> {
        let fault = |reason: String| Err(ColorError::invalid("layer", reason));
        for (i, (name, share)) in parts.iter().enumerate() {
            let plain = !name.is_empty() && name.trim() == name && !name.contains(['/', '+', '%']);
            if !plain || name.chars().any(char::is_control) || ends_in_number(name) {
                return fault(format!(
                    "the name {name:?} is empty, ends in a number or has one of / + % in it"
                ));
            }
            if !(0.0..=1.0).contains(share) {
                return fault(format!("the share {share} of {name:?} must lie within 0 to 1"));
            }
            if parts[..i].iter().any(|(other, _)| other == name) {
                return fault(format!("{name:?} stands in it twice"));
            }
        }
        let sum: f64 = parts.iter().map(|(_, share)| share).sum();
        if (sum - 1.0).abs() > 1e-3 {
            return fault(format!("its shares make {:.1} %, not 100 %", 100.0 * sum));
        }
        if thickness_mm.is_nan() || thickness_mm < LEAST_MM {
            return fault(format!("its thickness of {thickness_mm} mm must be above 0"));
        }
        Ok(Self { parts, thickness_mm })
    }

    /// A layer of one material.
    ///
    /// # Errors
    /// As [`StackLayer::new`].
    pub fn pure(name: &str, thickness_mm: f64) -> Result<Self, ColorError> {
        Self::new(vec![(name.to_owned(), 1.0)], thickness_mm)
    }

    /// Materials with their shares of the volume.
    pub fn parts(&self) -> &[(String, f64)] {
        &self.parts
    }

    /// Thickness in mm, infinity for the bottom of a stack that has no far side.
    pub fn thickness_mm(&self) -> f64 {
        self.thickness_mm
    }
}

impl Stack {
    /// Most layers.
    pub const MAX_LAYERS: usize = 32;

    /// Of layers, top first.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for no layer, more than [`Stack::MAX_LAYERS`], and a thick layer above another one.
    pub fn new(layers: Vec<StackLayer>) -> Result<Self, ColorError> {
        if layers.is_empty() || layers.len() > Self::MAX_LAYERS {
            let reason = format!("{} layers; 1 to {} are possible", layers.len(), Self::MAX_LAYERS);
            return Err(ColorError::invalid("stack", reason));
        }
        if layers[..layers.len() - 1].iter().any(|layer| layer.thickness_mm == f64::INFINITY) {
            return Err(ColorError::invalid("stack", "a layer above another one needs a thickness in mm"));
        }
        Ok(Self(layers))
    }

    /// The layers, top first.
    pub fn layers(&self) -> &[StackLayer] {
        &self.0
    }

    /// The materials in it, each once, top first.
    pub fn materials(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.0.iter().flat_map(|layer| &layer.parts) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        names
    }
}

impl FromStr for Stack {
    type Err = ColorError;

    fn from_str(text: &str) -> Result<Self, ColorError> {
        let layers = text.split('/').map(layer).collect::<Result<_, _>>();
        layers.and_then(Self::new).map_err(|error| match error {
            ColorError::Invalid(fault) => {
                ColorError::invalid(format!("stack {text:?}"), format!("{}: {}", fault.subject, fault.reason))
            }
            other => other,
        })
    }
}

fn layer(text: &str) -> Result<StackLayer, ColorError> {
    let text = text.trim();
    let number = |t: &str| t.parse::<f64>().ok().filter(|mm| mm.is_finite());
    let (mixture, thickness_mm) = match text.rsplit_once(char::is_whitespace) {
        Some((head, tail)) if number(tail).is_some() => (head, number(tail).unwrap_or(f64::NAN)),
        _ => (text, f64::INFINITY),
    };
    let part = |text: &str| match text.split_once('%') {
        Some((percent, name)) => match number(percent.trim()) {
            Some(percent) => Ok((name.trim().to_owned(), percent / 100.0)),
            None => Err(ColorError::invalid("layer", format!("{percent:?} is no number of per cent"))),
        },
        None => Ok((text.trim().to_owned(), 1.0)),
    };
    StackLayer::new(mixture.split('+').map(part).collect::<Result<_, _>>()?, thickness_mm)
}

impl fmt::Display for Stack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, layer) in self.0.iter().enumerate() {
            f.write_str(if i > 0 { " / " } else { "" })?;
            for (k, (name, share)) in layer.parts.iter().enumerate() {
                f.write_str(if k > 0 { " + " } else { "" })?;
                if layer.parts.len() > 1 {
                    write!(f, "{}% ", rounded(100.0 * share))?;
                }
                f.write_str(name)?;
            }
            if layer.thickness_mm.is_finite() {
                write!(f, " {}", rounded(layer.thickness_mm))?;
            }
        }
        Ok(())
    }
}

/// Without what binary fractions add to a decimal one.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

/// Whether what follows the last blank would be read as a thickness.
fn ends_in_number(name: &str) -> bool {
    name.rsplit(char::is_whitespace).next().is_some_and(|word| word.parse::<f64>().is_ok_and(f64::is_finite))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn texts_that_are_no_stack_are_told() {
        for (text, part) in [
            ("", "name"),
            ("cyan / white", "needs a thickness"),
            ("cyan 0.1 / / white", "name"),
            ("cyan -0.1 / white", "above 0"),
            ("cyan 0 / white", "above 0"),
            ("30% cyan + 60% white 0.1 / white", "90.0 %"),
            ("cyan + white 0.1 / white", "200.0 %"),
            ("50% cyan + 50% cyan 1", "twice"),
            ("x% cyan", "per cent"),
            ("-10% cyan + 110% white", "0 to 1"),
        ] {
            let error = text.parse::<Stack>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert!(vec!["a 1"; 33].join(" / ").parse::<Stack>().is_err());
        assert!(StackLayer::pure("Vero White 2.0", 1.0).is_err());
        let stack: Stack = "Vero White 0.1 / Vero White".parse().unwrap();
        assert_eq!(stack.layers()[0].parts()[0].0, "Vero White");
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[a-z0-9%+/. -]{0,40}") {
            if let Ok(stack) = text.parse::<Stack>() {
                let back: Stack = stack.to_string().parse().unwrap();
                prop_assert_eq!(back.layers().len(), stack.layers().len());
            }
        }

        #[test]
        fn texts_round_trip(share in 1..99u32, um in 1..5000u32) {
            let share = f64::from(share) / 100.0;
            let parts = vec![("cyan".to_owned(), share), ("white".to_owned(), 1.0 - share)];
            let layers = vec![StackLayer::new(parts, f64::from(um) / 1000.0).unwrap(), StackLayer::pure("black", f64::INFINITY).unwrap()];
            let stack = Stack::new(layers).unwrap();
            let back: Stack = stack.to_string().parse().unwrap();
            for (a, b) in back.layers().iter().zip(stack.layers()) {
                prop_assert!(a.thickness_mm() == b.thickness_mm());
                for ((n, x), (m, y)) in a.parts().iter().zip(b.parts()) {
                    prop_assert!(n == m && (x - y).abs() < 1e-9);
                }
            }
        }
    }
}
