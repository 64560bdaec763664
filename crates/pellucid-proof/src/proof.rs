//! The whole proof: every state of a print's colours in every view.

use std::path::Path;

use pellucid_core::Control;
use pellucid_voxel::{LabelGrid, Surface};

use crate::{Picture, ProofError, View, Visibility, contact_sheet};

/// Pictures of some states of a print's surface colours, a row a view.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Proof {
    /// Names of the states: the columns.
    pub states: Vec<String>,
    /// The views and, of each, a picture of every state.
    pub rows: Vec<(View, Vec<Picture>)>,
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
        Ok(Self { states: states.iter().map(|(name, _)| (*name).to_owned()).collect(), rows })
    }

    /// Writes a contact sheet as PNG.
    ///
    /// # Errors
    /// [`ProofError::Io`], [`ProofError::Cancelled`].
    pub fn write_png(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        let rows: Vec<Vec<Picture>> = self.rows.iter().map(|(_, pictures)| pictures.clone()).collect();
        contact_sheet(&rows, control)?.write_png(path, control)
    }

    /// Writes every picture as a linear layer `STATE.VIEW` of one EXR file.
    ///
    /// # Errors
    /// As [`write_exr`](crate::write_exr).
    #[cfg(feature = "exr")]
    pub fn write_exr(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        let layers: Vec<(String, &Picture)> = self
            .rows
            .iter()
            .flat_map(|(view, pictures)| {
                self.states.iter().zip(pictures).map(|(state, p)| (format!("{state}.{}", view.name()), p))
            })
            .collect();
        crate::write_exr(path, &layers, control)
    }
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
}
