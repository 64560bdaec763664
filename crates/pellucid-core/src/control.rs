//! Progress reports and cancellation for long work.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Receives `(done, total)` from any worker thread. `done` may arrive out of order.
pub type Progress<'a> = dyn Fn(u64, u64) + Sync + 'a;

/// The caller asked for the work to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// What a caller hands to long work: a progress callback and a cancellation flag, both optional.
///
/// Work runs on the current rayon pool, so `ThreadPool::install` confines it.
///
/// ```
/// use pellucid_core::Control;
/// use std::sync::atomic::{AtomicBool, Ordering};
/// let stop = AtomicBool::new(false);
/// let control = Control::none().with_cancel(&stop);
/// assert!(control.check().is_ok());
/// stop.store(true, Ordering::Relaxed);
/// assert!(control.check().is_err());
/// ```
#[derive(Clone, Copy, Default)]
pub struct Control<'a> {
    progress: Option<&'a Progress<'a>>,
    cancel: Option<&'a AtomicBool>,
}

impl<'a> Control<'a> {
    /// Neither progress nor cancellation.
    pub fn none() -> Self {
        Self::default()
    }

    /// Reports progress to `progress`.
    pub fn with_progress(mut self, progress: &'a Progress<'a>) -> Self {
        self.progress = Some(progress);
        self
    }

    /// Stops with [`Cancelled`] soon after `flag` becomes true.
    pub fn with_cancel(mut self, flag: &'a AtomicBool) -> Self {
        self.cancel = Some(flag);
        self
    }

    /// The same cancellation flag without the progress callback, for inner steps.
    pub fn silent(&self) -> Self {
        Self { progress: None, cancel: self.cancel }
    }

    /// True once cancellation was asked for.
    pub fn cancelled(&self) -> bool {
        self.cancel.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }

    /// `Err(Cancelled)` once cancellation was asked for.
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.cancelled() { Err(Cancelled) } else { Ok(()) }
    }

    /// Reports that `done` of `total` units are finished.
    pub fn report(&self, done: u64, total: u64) {
        if let Some(progress) = self.progress {
            progress(done, total);
        }
    }

    /// Adds `n` to a shared counter and reports the sum: progress from parallel workers.
    pub fn advance(&self, counter: &AtomicU64, n: u64, total: u64) {
        let done = counter.fetch_add(n, Ordering::Relaxed) + n;
        self.report(done, total);
    }
}
