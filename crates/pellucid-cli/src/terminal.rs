//! What the program says: results on standard output, everything else on standard error. A closed pipe or a full disk
//! behind either never ends the work.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

static QUIET: AtomicBool = AtomicBool::new(false);

/// Leaves standard error to others from now on: to another member of a team, which says the same.
pub fn quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Writes a line for people to standard error, if anybody listens.
pub fn note(line: impl AsRef<str>) {
    if QUIET.load(Ordering::Relaxed) {
        return;
    }
    let _ = writeln!(io::stderr(), "{}", line.as_ref());
}

/// Writes results to standard output. A reader that has left is fine; another failure is told.
pub fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}
