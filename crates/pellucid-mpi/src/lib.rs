//! Pellucid on many machines, over MPI.
//!
//! [`World`] is the team of all processes that `mpirun` started. Handed to
//! [`PrintJob::with_team`](pellucid::PrintJob::with_team) it makes a job of one process one of many, with the same bytes.
//! The program `pellucid-mpi` runs the commands of `pellucid` that way.
//!
//! ```no_run
//! use std::sync::Arc;
//! use pellucid::{Monitor, PrintJob, PrintSettings, Workspace, mesh};
//! use pellucid_mpi::World;
//!
//! let universe = mpi::initialize().ok_or("MPI is there already")?;
//! let team: Arc<dyn pellucid::core::Team> = Arc::new(World::of(&universe));
//! let job = PrintJob::new(PrintSettings::default())?.with_team(Arc::clone(&team))?;
//! let model = mesh::import_path("model.glb", &mesh::ImportLimits::default())?;
//! let prepared = job.prepare(&model, &Workspace::none(), &Monitor::silent())?;
//! if team.rank() == 0 {
//!     prepared.write("print".as_ref(), false, &Monitor::silent())?;
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod traffic;
mod world;

pub use traffic::{Traffic, process_time};
pub use world::World;
