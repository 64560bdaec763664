//! What a member's messages took.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::{Duration, Instant};

/// What a member's messages took so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Traffic {
    /// Times that the members met.
    pub meetings: u64,
    /// Bytes that this member held of what was added up, gathered or sent on.
    pub bytes: u64,
    /// Time in meetings, most of it waiting for the slowest.
    pub wall: Duration,
    /// Processor time of this thread in meetings: MPI waits busily.
    pub processor: Duration,
}

/// Adds up traffic.
#[derive(Debug, Default)]
pub(crate) struct Meter(Mutex<Traffic>);

impl Meter {
    /// One meeting over `bytes`.
    pub(crate) fn meet<T>(&self, bytes: usize, work: impl FnOnce() -> T) -> T {
        let (start, before) = (Instant::now(), thread_time());
        let result = work();
        let mut traffic = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        traffic.meetings += 1;
        traffic.bytes += bytes as u64;
        traffic.wall += start.elapsed();
        traffic.processor += thread_time().saturating_sub(before);
        result
    }

    pub(crate) fn traffic(&self) -> Traffic {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Processor time of this thread, from Linux's `/proc`; nothing elsewhere.
fn thread_time() -> Duration {
    time_of("/proc/thread-self/schedstat").unwrap_or_default()
}

/// Processor time of this process, all its living threads, from Linux's `/proc`; `None` elsewhere.
pub fn process_time() -> Option<Duration> {
    let threads = std::fs::read_dir("/proc/self/task").ok()?;
    let of = |thread: std::io::Result<std::fs::DirEntry>| time_of(thread.ok()?.path().join("schedstat"));
    Some(threads.filter_map(of).sum())
}

/// The first number of a `schedstat`: nanoseconds on a processor.
fn time_of(path: impl AsRef<std::path::Path>) -> Option<Duration> {
    let text = std::fs::read_to_string(path).ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}
