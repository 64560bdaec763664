//! Calibration of a printer's materials: a chart to print, and what its measurements say.
//!
//! [`Chart`] is a small plate with layers of every resin; it is printed, measured, and its table filled in.
//! [`fit`](pellucid_color::calibration::fit) turns that into a material table for
//! [`PrintSettings`](crate::PrintSettings), and [`write_fit`] into files.

mod chart;
mod files;
mod layout;
mod map;
mod series;

pub use chart::{Chart, ChartPatch, ChartSettings};
pub use files::{CALIBRATION_FILE, CHART_FILE, MAP_FILE, MATERIALS_FILE, write_chart, write_fit};
