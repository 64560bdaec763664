//! The whole proof: every state of a print's colours in every view.

use std::path::Path;

use pellucid_core::Control;
use pellucid_voxel::{LabelGrid, Surface};

use crate::{Picture, ProofError, View, Visibility, contact_sheet, false_color};

/// CIEDE2000 at the upper end of the colours of [`Proof::write_error_png`], whose lower end is 0.
pub const ERROR_SCALE: f32 = 20.0;

/// CIEDE2000 between the marks of the scale.
const MARK: f32 = 5.0;
/// Pixels that a mark cuts out of the scale.
const CUT: f32 = 3.0;
/// Pixels across the scale.
const SCALE_WIDTH: u32 = 16;

/// Pictures of some states of a print's surface colours, a row a view.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Proof {
    /// Names of the states: the columns.
    pub states: Vec<String>,
    /// The views and, of each, a picture of every state.
    pub rows: Vec<(View, Vec<Picture>)>,
    /// Of each view, in which three parts an error divides, CIEDE2000 in the place of red, green and blue; empty where
    /// none was given.
    pub errors: Vec<Picture>,
}

impl Proof {
    /// Draws states, each a name and a linear colour of every surface voxel, from some views. The longer edge of a
    /// picture has `edge` pixels.
    ///
    /// # Errors
    /// As [`Visibility::trace`] and [`Visibility::shade`].
    pub fn draw(
        labels: &LabelGrid,
        surface: &Surface,
        views: &[View],
        edge: u32,
        states: &[(&str, &[[f32; 3]])],
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let silent = control.silent();
        let mut rows = Vec::with_capacity(views.len());
        for (done, view) in views.iter().enumerate() {
            control.report(done as u64, views.len() as u64);
            let seen = Visibility::trace(labels, surface, view, edge, &silent)?;
            let pictures = states.iter().map(|(_, colors)| seen.shade(colors, &silent));
            rows.push((view.clone(), pictures.collect::<Result<_, _>>()?));
        }
        control.report(views.len() as u64, views.len() as u64);
        let states = states.iter().map(|(name, _)| (*name).to_owned()).collect();
        Ok(Self { states, rows, errors: Vec::new() })
    }

    /// [`Proof::draw`], and an error of every surface voxel in three parts, CIEDE2000 that sum to it.
    ///
    /// # Errors
    /// As there.
    pub fn draw_with_errors(
        labels: &LabelGrid,
        surface: &Surface,
        views: &[View],
        edge: u32,
        states: &[(&str, &[[f32; 3]])],
        errors: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let all: Vec<_> = states.iter().copied().chain([("", errors)]).collect();
        let mut proof = Self::draw(labels, surface, views, edge, &all, control)?;
        proof.states.pop();
        proof.errors = proof.rows.iter_mut().filter_map(|(_, pictures)| pictures.pop()).collect();
        Ok(proof)
    }

    /// Writes a contact sheet as PNG.
    ///
    /// # Errors
    /// [`ProofError::Io`], [`ProofError::Cancelled`].
    pub fn write_png(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        let rows: Vec<Vec<Picture>> = self.rows.iter().map(|(_, pictures)| pictures.clone()).collect();
        contact_sheet(&rows, control)?.write_png(path, control)
    }

    /// Writes the errors in [false colours](false_color) as PNG: rows of views; columns for the whole error and for each
    /// part, 0 to [`ERROR_SCALE`], what is more like that; beside them the scale from 0 below to [`ERROR_SCALE`] above,
    /// cut at every 5.
    ///
    /// # Errors
    /// [`ProofError::Io`], [`ProofError::Cancelled`].
    pub fn write_error_png(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        let row = |parts: &Picture| -> Result<Vec<Picture>, ProofError> {
            let whole = colored(parts, |[r, g, b, _]| r + g + b)?;
            let [first, second, third] = [0, 1, 2].map(|c| colored(parts, |pixel| pixel[c]));
            Ok(vec![whole, first?, second?, third?, scale(parts.height())?])
        };
        let rows = self.errors.iter().map(row).collect::<Result<Vec<_>, _>>()?;
        contact_sheet(&rows, control)?.write_png(path, control)
    }

    /// Writes every picture as a linear layer `STATE.VIEW` of one EXR file, and errors, not coloured, as `error.VIEW`:
    /// their parts in CIEDE2000 as R, G and B.
    ///
    /// # Errors
    /// As [`write_exr`](crate::write_exr).
    #[cfg(feature = "exr")]
    pub fn write_exr(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        let mut layers: Vec<(String, &Picture)> = self
            .rows
            .iter()
            .flat_map(|(view, pictures)| {
                self.states.iter().zip(pictures).map(|(state, p)| (format!("{state}.{}", view.name()), p))
            })
            .collect();
        let errors = self.rows.iter().zip(&self.errors);
        layers.extend(errors.map(|((view, _), p)| (format!("error.{}", view.name()), p)));
        crate::write_exr(path, &layers, control)
    }
}

/// A picture of some quantity of another's pixels, in false colours.
fn colored(parts: &Picture, quantity: impl Fn([f32; 4]) -> f32) -> Result<Picture, ProofError> {
    let pixels = parts.rgba().as_chunks::<4>().0.iter();
    let color = |&pixel: &[f32; 4]| {
        let [r, g, b] = false_color(quantity(pixel) / ERROR_SCALE);
        [r, g, b, pixel[3]]
    };
    Picture::new(parts.width(), parts.height(), pixels.flat_map(color).collect())
}

/// The colours from [`ERROR_SCALE`] above to 0 below, cut at every [`MARK`].
fn scale(height: u32) -> Result<Picture, ProofError> {
    let pixel = |row: u32| {
        let error = ERROR_SCALE * (1.0 - (row as f32 + 0.5) / height as f32);
        let mark = (error / MARK).round() * MARK;
        let inside = mark > 0.0 && mark < ERROR_SCALE;
        let cut = inside && (error - mark).abs() * height as f32 / ERROR_SCALE <= 0.5 * CUT;
        let [r, g, b] = false_color(error / ERROR_SCALE);
        [r, g, b, if cut { 0.0 } else { 1.0 }]
    };
    let rgba = (0..height).flat_map(|row| pixel(row).repeat(SCALE_WIDTH as usize));
    Picture::new(SCALE_WIDTH, height, rgba.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, Pitch, SurfaceOptions};

    #[test]
    fn every_state_is_drawn_in_every_view() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 10, 30]).unwrap();
        let labels = LabelGrid::from_fn(frame, |_| 1);
        let control = Control::none();
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
        let [red, blue] = [[0.6, 0.2, 0.1], [0.1, 0.2, 0.7]].map(|rgb| vec![rgb; surface.len()]);
        let states = [("target", &red[..]), ("refined", &blue[..])];
        let views = View::front_and_back();
        let proof = Proof::draw(&labels, &surface, &views, 32, &states, &control).unwrap();
        assert_eq!((proof.rows.len(), proof.states.len()), (2, 2));
        for (_, pictures) in &proof.rows {
            let [a, b] =
                [&pictures[0], &pictures[1]].map(|p| p.pixel(p.width() / 2, p.height() / 2).unwrap());
            // Shaded, so darker than the colour, but of its hue.
            assert!(a[0] > 2.0 * a[1] && b[2] > 2.0 * b[1], "{a:?} {b:?}");
        }
        assert!(Proof::draw(&labels, &surface, &views, 32, &[("short", &red[1..])], &control).is_err());
    }

    #[test]
    fn errors_are_drawn_beside_the_states_and_coloured_by_size() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 10, 30]).unwrap();
        let labels = LabelGrid::from_fn(frame, |_| 1);
        let control = Control::none();
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
        let red = vec![[0.6, 0.2, 0.1]; surface.len()];
        let parts = vec![[2.0, 9.0, 14.0]; surface.len()];
        let states = [("refined", &red[..])];
        let views = View::front_and_back();
        let plain = Proof::draw(&labels, &surface, &views, 32, &states, &control).unwrap();
        let proof =
            Proof::draw_with_errors(&labels, &surface, &views, 32, &states, &parts, &control).unwrap();
        assert_eq!((&proof.states, &proof.rows), (&plain.states, &plain.rows));
        assert_eq!((proof.errors.len(), plain.errors.len()), (2, 0));
        let picture = &proof.errors[0];
        let (width, height) = (picture.width(), picture.height());
        assert_eq!(picture.pixel(width / 2, height / 2).unwrap(), [2.0, 9.0, 14.0, 1.0]);

        let folder = tempfile::tempdir().unwrap();
        let [png, exr] = ["error.png", "proof.exr"].map(|name| folder.path().join(name));
        proof.write_error_png(&png, &control).unwrap();
        let mut reader = ::png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&png).unwrap()))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(info.width, 4 * (width + 8) + SCALE_WIDTH + 2 * 8);
        let pixel = |x: u32, y: u32| {
            let at = (y * info.width + x) as usize * 4;
            [pixels[at], pixels[at + 1], pixels[at + 2]]
        };
        let encoded = |error: f32| {
            false_color(error / ERROR_SCALE).map(|v| pellucid_color::space::srgb_encode_u8(f64::from(v)))
        };
        // The whole, more than the scale has, and each part.
        for (column, error) in [20.0, 2.0, 9.0, 14.0].into_iter().enumerate() {
            let x = 8 + column as u32 * (width + 8) + width / 2;
            assert_eq!(pixel(x, 8 + height / 2), encoded(error), "column {column}");
        }
        let x = 8 + 4 * (width + 8) + SCALE_WIDTH / 2;
        let column: Vec<[u8; 3]> = (0..height).map(|y| pixel(x, 8 + y)).collect();
        let cuts = column.windows(2).filter(|p| p[0] != [128; 3] && p[1] == [128; 3]).count();
        assert_eq!(cuts, 3, "at 5, 10 and 15: {column:?}");
        assert!(column[0][0] > 200 && column[height as usize - 1][1] < 30, "{column:?}");

        #[cfg(feature = "exr")]
        {
            proof.write_exr(&exr, &control).unwrap();
            let image = ::exr::prelude::read_all_flat_layers_from_file(&exr).unwrap();
            let names: Vec<String> = image
                .layer_data
                .iter()
                .map(|l| l.attributes.layer_name.as_ref().unwrap().to_string())
                .collect();
            assert_eq!(names, ["refined.front", "refined.back", "error.front", "error.back"]);
        }
        let _ = exr;
    }
}
