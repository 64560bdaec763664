//! The program as a user meets it.

mod common;
mod prepare;
mod training;
