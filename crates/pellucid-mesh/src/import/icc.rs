//! ICC profiles: which colours the codes of a texture stand for.

use std::path::Path;
use std::sync::Arc;

use pellucid_core::files::read_bounded;

use super::source::Source;
use crate::MeshError;

/// Most bytes of a profile: those of displays and working spaces have a few thousand, with tables some hundred thousand.
const MOST_BYTES: u64 = 4 << 20;

/// The ICC profile that the textures of a model are in where they embed none: [`ImportOptions::icc`](super::ImportOptions).
#[derive(Clone, PartialEq, Eq)]
pub struct IccProfile {
    name: String,
    bytes: Arc<[u8]>,
}

impl std::fmt::Debug for IccProfile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "IccProfile({:?}, {} bytes)", self.name, self.bytes.len())
    }
}

impl IccProfile {
    /// Takes a profile of R, G, B: by matrix and curves, or by tables. `name` is what notes and errors call it.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] for bytes that are no such profile, [`MeshError::Unsupported`] for one of another kind of
    /// colours, one of more than 4 MiB, and in a build without the cargo feature `icc`.
    pub fn from_bytes(name: impl Into<String>, bytes: &[u8]) -> Result<Self, MeshError> {
        let profile = Self { name: name.into(), bytes: bytes.into() };
        profile.codes()?;
        Ok(profile)
    }

    /// Reads the file of a profile.
    ///
    /// # Errors
    /// As [`IccProfile::from_bytes`]; [`MeshError::Io`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, MeshError> {
        let path = path.as_ref();
        let bytes = read_bounded(path, MOST_BYTES).map_err(|error| MeshError::Io {
            file: path.display().to_string(),
            object: "ICC profile".into(),
            source: std::io::Error::other(error),
            remedy: "give the file of an ICC profile of R, G, B".into(),
        })?;
        // Where a file lies on a machine is nobody's business.
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        Self::from_bytes(name, &bytes)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Linear Rec.709, 65535 for 1, of codes from 0 to 65535, by the relative colorimetric intent: the profile's white
    /// becomes white. Colours beyond Rec.709 are clipped to it.
    ///
    /// ```
    /// # #[cfg(feature = "icc")] {
    /// use pellucid_mesh::import::IccProfile;
    /// let p3 = moxcms::ColorProfile::new_display_p3().encode().unwrap();
    /// let profile = IccProfile::from_bytes("Display P3", &p3)?;
    /// let [grey, green] = [[32_768; 3], [20_000, 45_000, 20_000]].map(|codes| profile.linear(&[codes])[0]);
    /// assert!(grey.iter().all(|v| v.abs_diff(14_028) < 30), "as sRGB's: {grey:?}");
    /// assert!(green[0] < 2_500 && green[1] > 28_500, "a more vivid green than sRGB's of these codes: {green:?}");
    /// # }
    /// # Ok::<(), pellucid_mesh::MeshError>(())
    /// ```
    pub fn linear(&self, codes: &[[u16; 3]]) -> Vec<[u16; 3]> {
        self.codes().map(|known| known.linear(codes)).unwrap_or_default()
    }

    fn codes(&self) -> Result<Codes, MeshError> {
        if self.bytes.len() as u64 > MOST_BYTES {
            let reason = format!("it has {} bytes, {MOST_BYTES} at most", self.bytes.len());
            return Err(self.unsupported(reason, "give the profile of a display or working space"));
        }
        Codes::of(self)
    }

    #[cfg(feature = "icc")]
    fn invalid(&self, reason: impl Into<String>) -> MeshError {
        MeshError::invalid(&self.name, "ICC profile", reason, "save the profile, or the texture, again")
    }

    fn unsupported(&self, reason: impl Into<String>, remedy: &str) -> MeshError {
        MeshError::unsupported(&self.name, "ICC profile", reason, remedy)
    }
}

/// What codes stand for.
#[cfg(feature = "icc")]
pub(super) struct Codes(Arc<moxcms::Transform16BitExecutor>);

#[cfg(feature = "icc")]
impl Codes {
    fn of(profile: &IccProfile) -> Result<Self, MeshError> {
        use moxcms::{
            ColorProfile, DataColorSpace, Layout, RenderingIntent, ToneReprCurve, TransformOptions,
        };

        let source =
            ColorProfile::new_from_slice(&profile.bytes).map_err(|e| profile.invalid(e.to_string()))?;
        if source.color_space != DataColorSpace::Rgb {
            let reason = format!("it is of {:?} colours", source.color_space);
            return Err(profile.unsupported(reason, "give a profile of R, G, B"));
        }
        let line = Some(ToneReprCurve::Parametric(vec![1.0]));
        let mut rec709 = ColorProfile::new_srgb();
        (rec709.red_trc, rec709.green_trc, rec709.blue_trc) = (line.clone(), line.clone(), line);
        rec709.cicp = None;
        let options = TransformOptions {
            rendering_intent: RenderingIntent::RelativeColorimetric,
            allow_use_cicp_transfer: false,
            prefer_fixed_point: false,
            ..TransformOptions::default()
        };
        let transform = source.create_transform_16bit(Layout::Rgb, &rec709, Layout::Rgb, options);
        Ok(Self(transform.map_err(|e| profile.invalid(e.to_string()))?))
    }

    /// [`IccProfile::linear`].
    pub fn linear(&self, codes: &[[u16; 3]]) -> Vec<[u16; 3]> {
        use rayon::prelude::*;
        const AT_ONCE: usize = 1 << 14;

        let mut out = vec![[0; 3]; codes.len()];
        out.par_chunks_mut(AT_ONCE).zip(codes.par_chunks(AT_ONCE)).for_each(|(out, codes)| {
            // Lengths are equal and whole, the only things that it fails for.
            let _ = self.0.transform(codes.as_flattened(), out.as_flattened_mut());
        });
        out
    }

    /// Whether its codes stand for what sRGB's do, to less than a step of eight bits: most files' profile says no more.
    fn are_srgb(&self) -> bool {
        const STEPS: u16 = 5;
        let codes: Vec<[u16; 3]> = (0..STEPS.pow(3))
            .map(|i| [i % STEPS, i / STEPS % STEPS, i / STEPS / STEPS].map(|v| v * (u16::MAX / (STEPS - 1))))
            .collect();
        let near = |(codes, linear): (&[u16; 3], &[u16; 3])| {
            (0..3).all(|c| {
                let wanted = crate::texture::srgb_to_linear(f64::from(codes[c]) / 65535.0);
                (f64::from(linear[c]) / 65535.0 - wanted).abs() < 0.003
            })
        };
        codes.iter().zip(&self.linear(&codes)).all(near)
    }
}

/// Nothing stands for anything in a build that reads no profiles.
#[cfg(not(feature = "icc"))]
pub(super) struct Codes;

#[cfg(not(feature = "icc"))]
impl Codes {
    fn of(profile: &IccProfile) -> Result<Self, MeshError> {
        Err(profile.unsupported("this build reads none", "build with the cargo feature icc"))
    }

    /// As they are.
    pub fn linear(&self, codes: &[[u16; 3]]) -> Vec<[u16; 3]> {
        codes.to_vec()
    }

    fn are_srgb(&self) -> bool {
        true
    }
}

/// How the codes of a texture are read: by the profile that it embeds, or else by the options'; `None` for sRGB. What is
/// not sRGB is noted.
pub(super) fn codes_of(
    source: &Source,
    object: &str,
    embedded: Option<Vec<u8>>,
) -> Result<Option<Codes>, MeshError> {
    let Some(bytes) = embedded else {
        let Some(profile) = &source.options.icc else { return Ok(None) };
        source.note(object, format!("its colours are read by the ICC profile {:?}", profile.name));
        return profile.codes().map(Some);
    };
    let embedded = IccProfile { name: source.file.into(), bytes: bytes.into() };
    match embedded.codes() {
        Ok(codes) if codes.are_srgb() => Ok(None),
        Ok(codes) => {
            source.note(object, "its colours are read by the ICC profile that it embeds");
            Ok(Some(codes))
        }
        Err(MeshError::Invalid { reason, .. } | MeshError::Unsupported { reason, .. }) => {
            let text = format!(
                "the ICC profile that it embeds is left out, its colours are taken for sRGB: {reason}"
            );
            source.note(object, text);
            Ok(None)
        }
        Err(other) => Err(other),
    }
}
