//! Labelled points of volumes, and files of them.
//!
//! | module | owns |
//! | --- | --- |
//! | `samples` | labelled points of a volume: stencils and radiance |
//! | `half_stencils` | stencils in half precision |
//! | `set_file` | the format of the files |
//! | `generate` | the files made in shards, resumed, verified |
//! | `stored` | the volumes of a set as the files hold them |
//! | `set` | a set in memory |
//! | `judge` | errors of predictions on a set |

mod generate;
mod half_stencils;
mod judge;
mod samples;
mod set;
mod set_file;
mod stored;

pub use generate::{SetInfo, file_name, generate, info, join, verify};
pub use half_stencils::{HalfStencils, STENCIL_VALUES};
pub use judge::{Errors, Judgement, judge};
pub(crate) use samples::permutation;
pub use samples::{Labelling, Sampler, Samples};
pub use set::LabelledSet;
pub use set_file::{SetHeader, Shard};
pub use stored::StoredVolumes;
