//! Pictures that a study keeps.

use pellucid::proof::Picture;
use serde::{Deserialize, Serialize};

use crate::appearance::Error;

/// A picture that can be kept.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pixels {
    width: u32,
    height: u32,
    rgba: Vec<f32>,
}

impl Pixels {
    /// Of a picture.
    pub fn of(picture: &Picture) -> Self {
        Self { width: picture.width(), height: picture.height(), rgba: picture.rgba().to_vec() }
    }

    /// The picture.
    ///
    /// # Errors
    /// When a file that was kept is damaged.
    pub fn picture(&self) -> Result<Picture, Error> {
        Ok(Picture::new(self.width, self.height, self.rgba.clone())?)
    }
}
