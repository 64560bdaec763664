//! Progress bars on a terminal, a line a stage elsewhere.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use pellucid::stage::{Observer, Stage};

use crate::terminal::note;

/// Shows each stage with its rate and the time left.
pub struct Bars {
    terminal: bool,
    current: Mutex<Option<(Stage, ProgressBar, Instant)>>,
}

impl Bars {
    /// Bars when standard error is a terminal.
    pub fn new() -> Self {
        Self { terminal: std::io::stderr().is_terminal(), current: Mutex::new(None) }
    }
}

impl Observer for Bars {
    fn begin(&self, stage: Stage) {
        let bar = if self.terminal { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style =
            ProgressStyle::with_template("{prefix:>16} [{bar:32}] {percent:>3} %  {per_sec}  {eta} left");
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(stage.name());
        bar.enable_steady_tick(Duration::from_millis(200));
        if let Ok(mut current) = self.current.lock() {
            *current = Some((stage, bar, Instant::now()));
        }
    }

    fn progress(&self, _: Stage, done: u64, total: u64) {
        // A worker need not wait for another worker's report to be drawn.
        if let Ok(current) = self.current.try_lock()
            && let Some((_, bar, _)) = current.as_ref()
        {
            bar.set_length(total);
            bar.set_position(done.max(bar.position()).min(total));
        }
    }

    fn end(&self, stage: Stage) {
        let taken = self.current.lock().ok().and_then(|mut current| current.take());
        if let Some((_, bar, start)) = taken {
            bar.finish_and_clear();
            note(format!("{:>16}  {:.1} s", stage.name(), start.elapsed().as_secs_f64()));
        }
    }

    fn warn(&self, message: &str) {
        let line = format!("warning: {message}");
        match self.current.lock() {
            Ok(current) if self.terminal && current.is_some() => {
                if let Some((_, bar, _)) = current.as_ref() {
                    bar.println(line);
                }
            }
            _ => note(line),
        }
    }
}
