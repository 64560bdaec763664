//! The command line as a user meets it.

mod calibrate;
mod clear;
mod common;
mod prepare;
mod proof;
mod texture;
mod training;
