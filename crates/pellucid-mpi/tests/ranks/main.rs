//! The program under `mpirun`: the same bytes on any number of processes, also after one was killed.
#![cfg(target_os = "linux")]

mod common;
mod killed;
mod prints;
mod sets;
