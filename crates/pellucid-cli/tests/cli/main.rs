//! The command line as a user meets it.

mod common;
mod prepare;
mod training;
