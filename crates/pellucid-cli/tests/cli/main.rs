//! The command line as a user meets it.

mod calibrate;
mod clear;
mod common;
mod prepare;
mod preview;
mod proof;
mod readme;
mod spectral;
mod texture;
mod training;
