//! What the program says: results on standard output, everything else on standard error. A closed pipe or a full disk
//! behind either never ends the work.

use std::io::{self, Write};

/// Writes a line for people to standard error, if anybody listens.
pub fn note(line: impl AsRef<str>) {
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
