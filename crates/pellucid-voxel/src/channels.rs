//! What the channels of a material table are.

use crate::VoxelError;

/// What the channels of coefficients and radiances stand for.
///
/// Simulation treats every channel alike; only their colour depends on what they are.
///
/// ```
/// use pellucid_voxel::Channels;
/// let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
/// assert_eq!(bands.count(), 31);
/// assert_eq!(bands.names()[15], "550 nm");
/// assert_eq!(Channels::of_names(&bands.names()), bands);
/// assert_eq!(Channels::of_names(&["red", "green", "blue"]), Channels::Rgb);
/// assert_eq!(Channels::of_names(&["grey"]), Channels::Named(vec!["grey".into()]));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum Channels {
    /// Linear R, G, B of Rec.709.
    Rgb,
    /// Evenly spaced wavelengths, one band each.
    Bands {
        /// Wavelength of the first band in nm, finite and above 0.
        start_nm: f64,
        /// From one band to the next in nm, finite and not 0; below 0 where wavelengths descend.
        step_nm: f64,
        /// Number of bands, 1 to [`Channels::MAX`].
        count: u32,
    },
    /// Anything else, by name: 1 to [`Channels::MAX`] names. One is the usual form of a grey print.
    Named(Vec<String>),
}

/// How far a wavelength that a name tells may lie from the even spacing, in nm: names are often rounded.
const ROUNDED_NM: f64 = 0.01;

impl Channels {
    /// Most channels.
    pub const MAX: usize = 256;

    /// What names say: `R, G, B` or `red, green, blue` in any case are [`Channels::Rgb`], two or more evenly spaced
    /// wavelengths such as `400 nm, 410 nm` are [`Channels::Bands`], others are [`Channels::Named`].
    pub fn of_names<S: AsRef<str>>(names: &[S]) -> Self {
        let spelled = |rgb: [&str; 3]| {
            names.len() == 3 && rgb.iter().zip(names).all(|(c, name)| name.as_ref().eq_ignore_ascii_case(c))
        };
        if spelled(["R", "G", "B"]) || spelled(["red", "green", "blue"]) {
            return Self::Rgb;
        }
        bands_of(names).unwrap_or_else(|| Self::Named(names.iter().map(|n| n.as_ref().to_owned()).collect()))
    }

    /// These channels, when they keep the ranges that are documented above.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] for no channel or wavelengths out of range, [`VoxelError::Unsupported`] past
    /// [`Channels::MAX`].
    pub fn checked(self) -> Result<Self, VoxelError> {
        let count = self.count();
        if count == 0 {
            return Err(VoxelError::invalid("channels", "there are none; give at least one"));
        }
        if count > Self::MAX {
            return Err(VoxelError::unsupported("channels", format!("{count}; at most {}", Self::MAX)));
        }
        if let Self::Bands { start_nm, step_nm, count } = self {
            let end_nm = start_nm + step_nm * f64::from(count - 1);
            let possible = |nm: f64| nm.is_finite() && nm > 0.0;
            if !possible(start_nm) || !possible(end_nm) || !step_nm.is_finite() || step_nm == 0.0 {
                return Err(VoxelError::invalid(
                    "bands",
                    format!(
                        "start_nm {start_nm}, step_nm {step_nm}, count {count}; wavelengths must be above 0 and the \
                         step not 0"
                    ),
                ));
            }
        }
        Ok(self)
    }

    /// Number of channels.
    pub fn count(&self) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Bands { count, .. } => *count as usize,
            Self::Named(names) => names.len(),
        }
    }

    /// A name for each channel: `R`, `G`, `B`; the wavelength, such as `550 nm`; or the names themselves.
    pub fn names(&self) -> Vec<String> {
        match self {
            Self::Rgb => ["R", "G", "B"].map(str::to_owned).to_vec(),
            Self::Bands { .. } => self.wavelengths_nm().map(|nm| format!("{nm} nm")).collect(),
            Self::Named(names) => names.clone(),
        }
    }

    /// The wavelength of each band in nm; nothing where the channels are no bands.
    pub fn wavelengths_nm(&self) -> impl Iterator<Item = f64> + use<> {
        let (start, step, count) = match *self {
            Self::Bands { start_nm, step_nm, count } => (start_nm, step_nm, count),
            _ => (0.0, 0.0, 0),
        };
        (0..count).map(move |k| start + step * f64::from(k))
    }
}

/// The number before `nm`.
fn wavelength(name: &str) -> Option<f64> {
    name.trim().strip_suffix("nm")?.trim_end().parse().ok().filter(|nm: &f64| nm.is_finite() && *nm > 0.0)
}

fn bands_of<S: AsRef<str>>(names: &[S]) -> Option<Channels> {
    let nm = names.iter().map(|n| wavelength(n.as_ref())).collect::<Option<Vec<_>>>()?;
    let (&[start_nm, .., end_nm], gaps) = (nm.as_slice(), nm.len().checked_sub(1)?) else {
        return None;
    };
    let step_nm = (end_nm - start_nm) / gaps as f64;
    let count = u32::try_from(nm.len()).ok()?;
    let even = Channels::Bands { start_nm, step_nm, count };
    let fits = step_nm.abs() > 2.0 * ROUNDED_NM
        && even.wavelengths_nm().zip(&nm).all(|(a, b)| (a - b).abs() <= ROUNDED_NM);
    fits.then_some(even)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&n| n.to_owned()).collect()
    }

    #[test]
    fn names_tell_what_channels_are() {
        let bands = |start_nm, step_nm, count| Channels::Bands { start_nm, step_nm, count };
        for (list, channels) in [
            (&["R", "G", "B"][..], Channels::Rgb),
            (&["r", "g", "b"], Channels::Rgb),
            (&["B", "G", "R"], Channels::Named(names(&["B", "G", "R"]))),
            (&["R", "G"], Channels::Named(names(&["R", "G"]))),
            (&["450 nm", "550nm", "650.0 nm"], bands(450.0, 100.0, 3)),
            (&["700 nm", "550 nm", "400 nm"], bands(700.0, -150.0, 3)),
            (&["400 nm", "433.33 nm", "466.67 nm", "500 nm"], bands(400.0, 100.0 / 3.0, 4)),
            (&["400 nm", "450 nm", "550 nm"], Channels::Named(names(&["400 nm", "450 nm", "550 nm"]))),
            (&["550 nm"], Channels::Named(names(&["550 nm"]))),
            (&["400 nm", "400 nm"], Channels::Named(names(&["400 nm", "400 nm"]))),
            (&["NaN nm", "inf nm"], Channels::Named(names(&["NaN nm", "inf nm"]))),
            (&[], Channels::Named(vec![])),
        ] {
            assert_eq!(Channels::of_names(list), channels);
        }
    }

    #[test]
    fn ranges_are_checked() {
        let bands = |start_nm, step_nm, count| Channels::Bands { start_nm, step_nm, count }.checked();
        assert!(bands(400.0, 10.0, 1).is_ok());
        assert!(bands(400.0, 1.0, 256).is_ok());
        assert!(matches!(bands(400.0, 1.0, 257), Err(VoxelError::Unsupported(_))));
        for (start, step, count) in
            [(400.0, 10.0, 0), (0.0, 10.0, 3), (400.0, 0.0, 3), (400.0, -200.0, 3), (f64::NAN, 1.0, 3)]
        {
            assert!(
                matches!(bands(start, step, count), Err(VoxelError::Invalid(_))),
                "{start} {step} {count}"
            );
        }
        assert!(Channels::Named(vec![]).checked().is_err());
        assert!(Channels::Named(vec!["a".into(); 257]).checked().is_err());
    }

    proptest! {
        #[test]
        fn names_of_bands_tell_the_bands(start in 200u32..3000, step in 1u32..50, count in 2u32..60) {
            let bands = Channels::Bands { start_nm: f64::from(start), step_nm: f64::from(step), count };
            prop_assert_eq!(Channels::of_names(&bands.names()), bands);
        }
    }
}
