//! Spectral images of OpenEXR files.

use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, f16, read};
use pellucid_core::files::read_bounded;

use super::SpectralImage;
use crate::{ImportLimits, MeshError};

/// Most channels of a file.
const MOST_CHANNELS: usize = 1024;

impl SpectralImage {
    /// Reads the first layer of an OpenEXR file: channels named by wavelength, as `T.550,000nm` (Fichet, Pacanowski and
    /// Wilkie 2021, reflective images), `550nm` or `550`. Others, such as a preview in R, G and B, are left out.
    ///
    /// # Errors
    /// [`MeshError::Io`]; [`MeshError::Invalid`] when it is no OpenEXR file or breaks a rule of [`SpectralImage::new`];
    /// [`MeshError::Unsupported`] for emission (`S0.550,000nm`), and what passes `file_bytes`, `texture_edge`,
    /// `texture_pixels` or `texture_bytes` of the limits.
    pub fn read_exr(path: impl AsRef<Path>, limits: &ImportLimits) -> Result<Self, MeshError> {
        let path = path.as_ref();
        let bytes = read_bounded(path, limits.file_bytes).map_err(|error| MeshError::Io {
            file: path.display().to_string(),
            object: "spectral image".into(),
            source: std::io::Error::other(error),
            remedy: "give an OpenEXR file with channels by wavelength".into(),
        })?;
        Self::from_exr(path.display().to_string(), &bytes, limits)
    }

    /// [`SpectralImage::read_exr`] of a file's bytes; `name` is what errors call it.
    ///
    /// # Errors
    /// As there, but for I/O.
    pub fn from_exr(name: impl Into<String>, bytes: &[u8], limits: &ImportLimits) -> Result<Self, MeshError> {
        let name = name.into();
        let broken = |error: exr::error::Error| {
            let remedy = "give an OpenEXR file with channels by wavelength";
            MeshError::invalid(name.clone(), "OpenEXR", error.to_string(), remedy)
        };
        let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
        check(&name, &meta, limits)?;
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(broken)?;
        let layer = image.layer_data;
        let size = [layer.size.0 as u32, layer.size.1 as u32];
        let mut bands = Vec::new();
        for channel in layer.channel_data.list {
            if let Some(nm) = wavelength(&channel.name.to_string()) {
                bands.push((nm, values(channel.sample_data)));
            }
        }
        Self::new(name, size, bands)
    }
}

/// Whether all headers ask for no more than the limits, before anything is allocated for them.
fn check(name: &str, meta: &MetaData, limits: &ImportLimits) -> Result<(), MeshError> {
    let beyond = |reason: String| {
        Err(MeshError::unsupported(name, "OpenEXR", reason, "give a smaller image, reflectances alone"))
    };
    for header in &meta.headers {
        let [width, height] = [header.layer_size.0, header.layer_size.1].map(|side| side as u64);
        let channels = &header.channels.list;
        let edge = width.max(height);
        if edge > u64::from(limits.texture_edge) || width * height > limits.texture_pixels {
            return beyond(format!("{width} x {height} pixels"));
        }
        if channels.len() > MOST_CHANNELS || width * height * channels.len() as u64 * 6 > limits.texture_bytes
        {
            return beyond(format!("{} channels of {width} x {height} pixels", channels.len()));
        }
        let named = |prefix: &str| channels.iter().any(|c| c.name.to_string().starts_with(prefix));
        if named("S0.") && !named("T.") {
            return beyond("it holds light that is sent out (S0.…nm), not reflectances (T.…nm)".into());
        }
    }
    Ok(())
}

/// The wavelength in nm that a channel's name tells.
fn wavelength(name: &str) -> Option<f64> {
    let number = name.strip_prefix("T.").unwrap_or(name);
    let number = number.strip_suffix("nm").unwrap_or(number);
    number.replace(',', ".").parse().ok()
}

fn values(samples: FlatSamples) -> Vec<f32> {
    match samples {
        FlatSamples::F32(values) => values,
        FlatSamples::F16(values) => values.into_iter().map(f16::to_f32).collect(),
        FlatSamples::U32(values) => values.into_iter().map(|v| v as f32).collect(),
    }
}
