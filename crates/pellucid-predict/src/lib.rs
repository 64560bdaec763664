//! Predictors of the appearance of translucent prints.
//!
//! [`Predictor`] says how appearance is predicted; bound to an [`Object`] it becomes a [`BoundPredictor`], which holds
//! the tables and volumes of that one object and predicts the radiance of its surface points.
#![forbid(unsafe_code)]

pub mod error;
pub mod identity;
pub mod object;
pub mod predictor;

pub use error::PredictError;
pub use identity::{Identity, WeightsIdentity};
pub use object::{Object, ObjectId};
pub use predictor::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Learned, MaterialGradient, Pass, Predictor,
};
