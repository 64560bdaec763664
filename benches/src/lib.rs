//! What the benchmarks and studies share.
//!
//! | module | owns |
//! | --- | --- |
//! | [`volumes`] | test volumes |
//! | [`dense`] | the dense tables that summed-area tables are compared with |
//! | [`appearance`] | colour differences, times of stencils, false colours |
//! | [`solids`] | halftoned solids of the studies |
//! | [`pixels`] | pictures that a study keeps |
//! | [`prints`] | models as prints before refinement |
//! | [`judged`] | objects with traced reference radiances |
//! | [`slab`] | slabs of continuous albedo, their tracer, and what refines them |
//! | [`study`] | settings, records, tables and plots of the studies |
#![forbid(unsafe_code)]

pub mod appearance;
pub mod dense;
pub mod faces;
pub mod judged;
pub mod pixels;
pub mod prints;
pub mod slab;
pub mod solids;
pub mod study;
pub mod volumes;
