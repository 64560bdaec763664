//! OpenEXR files.

use std::collections::HashSet;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::path::Path;

use exr::meta::attribute::Chromaticities;
use exr::prelude::*;
use pellucid_core::{Control, files};

use crate::{Picture, ProofError};

type Layers = SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>;

/// Steps of progress.
const STEPS: u64 = 1000;

/// Primaries and white (D65) of Rec.709: x and y by CIE 1931.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Writes named linear pictures as the layers of one EXR file, 32-bit float R, G, B, A, losslessly compressed, whole
/// or not at all. Primaries and white are Rec.709's, and the file says so. It is put together in memory.
///
/// # Errors
/// [`ProofError::Invalid`] for no pictures, or a name that is empty or given twice; [`ProofError::Io`];
/// [`ProofError::Cancelled`].
pub fn write_exr(
    path: impl AsRef<Path>,
    pictures: &[(String, &Picture)],
    control: &Control<'_>,
) -> std::result::Result<(), ProofError> {
    check_names(pictures)?;
    let path = path.as_ref();
    let mut file = Stoppable { inner: Cursor::new(Vec::new()), control };
    let written = image(pictures, control)?
        .write()
        .on_progress(|part| control.report((part.clamp(0.0, 1.0) * STEPS as f64) as u64, STEPS))
        .to_buffered(&mut file);
    control.check()?;
    written.map_err(|error| files_error(path, error))?;
    Ok(files::write_whole_bytes(path, file.inner.get_ref())?)
}

fn check_names(pictures: &[(String, &Picture)]) -> std::result::Result<(), ProofError> {
    if pictures.is_empty() {
        return Err(ProofError::invalid("EXR layers", "none given; a file has at least one"));
    }
    let mut seen = HashSet::new();
    for (name, _) in pictures {
        if name.is_empty() || !seen.insert(name.as_str()) {
            return Err(ProofError::invalid("EXR layers", format!("name {name:?} is empty or given twice")));
        }
    }
    Ok(())
}

fn image(
    pictures: &[(String, &Picture)],
    control: &Control<'_>,
) -> std::result::Result<Image<Layers>, ProofError> {
    let mut layers = Layers::new();
    for (name, picture) in pictures {
        control.check()?;
        let plane = |c: usize| FlatSamples::F32(picture.rgba().iter().skip(c).step_by(4).copied().collect());
        let channels =
            ["R", "G", "B", "A"].iter().enumerate().map(|(c, &n)| AnyChannel::new(n, plane(c))).collect();
        layers.push(Layer::new(
            (picture.width() as usize, picture.height() as usize),
            LayerAttributes::named(name.as_str()),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(channels),
        ));
    }
    let bounds = layers.iter().fold(Vec2(1, 1), |b, l| Vec2(b.0.max(l.size.0), b.1.max(l.size.1)));
    let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions(bounds));
    attributes.chromaticities = Some(REC709);
    Ok(Image::from_layers(attributes, layers))
}

fn files_error(path: &Path, error: Error) -> ProofError {
    let source = match error {
        Error::Io(source) => source,
        other => io::Error::other(other.to_string()),
    };
    pellucid_core::FileError::at("write", path)(source).into()
}

/// Fails once cancelled, which ends the encoder.
struct Stoppable<'a, W> {
    inner: W,
    control: &'a Control<'a>,
}

impl<W: Write> Write for Stoppable<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.control.check().map_err(io::Error::other)?;
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<W: Seek> Seek for Stoppable<'_, W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn layers_keep_linear_values_of_every_channel() {
        let first = Picture::new(2, 1, vec![0.25, 1.5, -0.125, 1.0, 0.0, 7.0, 3.0, 0.5]).unwrap();
        let second = Picture::new(1, 3, (0..12).map(|v| v as f32 * 0.37).collect()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let layers = [("target.front".into(), &first), ("refined.front".into(), &second)];
        write_exr(&path, &layers, &Control::none()).unwrap();
        let image = read_all_flat_layers_from_file(&path).unwrap();
        assert_eq!(image.layer_data.len(), 2);
        let said = image.attributes.chromaticities.unwrap();
        assert_eq!((said.red, said.white), (Vec2(0.64, 0.33), Vec2(0.3127, 0.3290)));
        for (layer, (name, picture)) in image.layer_data.iter().zip(&layers) {
            assert_eq!(layer.attributes.layer_name.as_ref().unwrap().to_string(), *name);
            assert_eq!(layer.size, Vec2(picture.width() as usize, picture.height() as usize));
            for (c, channel) in ["R", "G", "B", "A"].iter().enumerate() {
                let read = layer.channel_data.list.iter().find(|l| l.name.to_string() == *channel).unwrap();
                let wanted: Vec<f32> = picture.rgba().iter().skip(c).step_by(4).copied().collect();
                assert_eq!(read.sample_data.values_as_f32().collect::<Vec<_>>(), wanted, "{name} {channel}");
            }
        }
    }

    #[test]
    fn names_are_given_once() {
        let picture = Picture::new(1, 1, vec![0.0; 4]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        for names in [vec![], vec!["a", "a"], vec![""]] {
            let layers: Vec<_> = names.iter().map(|n| (n.to_string(), &picture)).collect();
            assert!(matches!(write_exr(&path, &layers, &Control::none()), Err(ProofError::Invalid(_))));
        }
        assert!(!path.exists());
    }

    #[test]
    fn a_cancelled_file_leaves_nothing() {
        let picture = Picture::new(256, 256, (0..1 << 18).map(|v| v as f32).collect()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let stop = AtomicBool::new(false);
        let cut = |done: u64, _: u64| stop.store(done > 200, Ordering::Relaxed);
        let control = Control::none().with_cancel(&stop).with_progress(&cut);
        let error = write_exr(folder.path().join("a.exr"), &[("a".into(), &picture)], &control).unwrap_err();
        assert!(matches!(error, ProofError::Cancelled), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
