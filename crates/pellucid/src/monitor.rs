//! Runs stages: tells the observer, hands out control, keeps the times.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use pellucid_core::Control;

use crate::report::StageTime;
use crate::stage::{Observer, Silent, Stage};

static NEVER: AtomicBool = AtomicBool::new(false);

/// Who watches a job: an observer that is told of stages, a flag that stops it within 100 ms, and the stages' times.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use pellucid::Monitor;
/// use pellucid::stage::Silent;
/// let cancel = AtomicBool::new(false);
/// let monitor = Monitor::new(&Silent, &cancel);
/// assert!(monitor.times().is_empty());
/// ```
pub struct Monitor<'a> {
    observer: &'a dyn Observer,
    cancel: &'a AtomicBool,
    times: Mutex<Vec<StageTime>>,
    peak_memory: Option<fn() -> Option<u64>>,
}

impl<'a> Monitor<'a> {
    /// A monitor of an observer and a cancellation flag.
    pub fn new(observer: &'a dyn Observer, cancel: &'a AtomicBool) -> Self {
        Self { observer, cancel, times: Mutex::new(Vec::new()), peak_memory: None }
    }

    /// The same with a function that measures the process's peak memory in bytes, for the report.
    pub fn with_peak_memory(mut self, measure: fn() -> Option<u64>) -> Self {
        self.peak_memory = Some(measure);
        self
    }

    /// A monitor of the same observer and flag with times of its own, for work that is done again more exactly: its
    /// warnings are left to that.
    pub(crate) fn provisional<T>(&self, work: impl FnOnce(&Monitor<'_>) -> T) -> T {
        work(&Monitor::new(&WithoutWarnings(self.observer), self.cancel))
    }

    /// Runs one stage; its time counts also when it fails.
    pub fn run<T>(&self, stage: Stage, work: impl FnOnce(&Control<'_>) -> T) -> T {
        let progress = |done, total| self.observer.progress(stage, done, total);
        let control = Control::none().with_cancel(self.cancel).with_progress(&progress);
        self.observer.begin(stage);
        let start = Instant::now();
        let result = work(&control);
        let seconds = start.elapsed().as_secs_f64();
        self.observer.end(stage);
        if let Ok(mut times) = self.times.lock() {
            match times.iter_mut().find(|t| t.stage == stage.name()) {
                Some(time) => time.seconds += seconds,
                None => times.push(StageTime { stage: stage.name().to_owned(), seconds }),
            }
        }
        result
    }

    /// Tells the observer something that the user should know.
    pub fn warn(&self, message: &str) {
        self.observer.warn(message);
    }

    pub(crate) fn peak_memory_bytes(&self) -> Option<u64> {
        self.peak_memory.and_then(|measure| measure())
    }

    /// Wall times of the stages so far, in the order of their beginnings.
    pub fn times(&self) -> Vec<StageTime> {
        self.times.lock().map(|times| times.clone()).unwrap_or_default()
    }
}

struct WithoutWarnings<'a>(&'a dyn Observer);

impl Observer for WithoutWarnings<'_> {
    fn begin(&self, stage: Stage) {
        self.0.begin(stage);
    }

    fn progress(&self, stage: Stage, done: u64, total: u64) {
        self.0.progress(stage, done, total);
    }

    fn end(&self, stage: Stage) {
        self.0.end(stage);
    }
}

impl Monitor<'static> {
    /// A monitor that tells nobody and never stops.
    pub fn silent() -> Self {
        Monitor::new(&Silent, &NEVER)
    }
}
