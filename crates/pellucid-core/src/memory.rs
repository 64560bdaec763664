//! Amounts of memory, to read and to be given, and what the system says of it.

use std::fmt;
use std::str::FromStr;

/// Units and their bytes; the first two are those that amounts are told in.
const UNITS: [(&str, f64); 4] =
    [("GiB", (1u64 << 30) as f64), ("MiB", (1u64 << 20) as f64), ("GB", 1e9), ("MB", 1e6)];

/// An amount of memory in bytes.
///
/// ```
/// use pellucid_core::Bytes;
/// assert_eq!("1.5GiB".parse::<Bytes>()?.0, 3 << 29);
/// assert_eq!(Bytes(900_000_000).to_string(), "858 MiB");
/// # Ok::<(), pellucid_core::Fault>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bytes(pub u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [(gib, in_gib), (mib, in_mib)] =
            [UNITS[0], UNITS[1]].map(|(unit, of)| (unit, self.0 as f64 / of));
        if in_gib >= 1.0 { write!(f, "{in_gib:.1} {gib}") } else { write!(f, "{in_mib:.0} {mib}") }
    }
}

impl FromStr for Bytes {
    type Err = crate::Fault;

    fn from_str(text: &str) -> Result<Self, crate::Fault> {
        let fault = || {
            crate::Fault::new("memory", format!("{text:?}"))
                .remedy("a number and GiB, MiB, GB or MB are needed, such as 8GiB")
        };
        let found = UNITS.iter().find_map(|(unit, of)| Some((text.strip_suffix(unit)?.trim(), of)));
        let (number, of) = found.ok_or_else(fault)?;
        let bytes = number.parse::<f64>().map_err(|_| fault())? * of;
        // The cast saturates.
        if bytes >= 1.0 { Ok(Self(bytes as u64)) } else { Err(fault()) }
    }
}

/// The process's peak resident memory in bytes, from Linux's `/proc`; `None` elsewhere.
pub fn peak_bytes() -> Option<u64> {
    line_of("/proc/self/status", "VmHWM:")
}

/// Bytes that the system can give without swapping, from Linux's `/proc`; `None` elsewhere.
pub fn free_bytes() -> Option<u64> {
    line_of("/proc/meminfo", "MemAvailable:")
}

/// A line of a file that counts in KiB.
fn line_of(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read_in_every_unit_and_nothing_else_is() {
        let read = |text: &str| text.parse::<Bytes>().ok().map(|bytes| bytes.0);
        assert_eq!(read("8GiB"), Some(8 << 30));
        assert_eq!(read("8 GB"), Some(8_000_000_000));
        assert_eq!(read("0.5MiB"), Some(1 << 19));
        for wrong in ["", "8", "GiB", "-1GiB", "0MB", "8 gib", "NaNGiB", "8GiBs"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn what_is_told_is_read_again() {
        for bytes in [Bytes(7 << 20), Bytes(3 << 30)] {
            assert_eq!(bytes.to_string().parse(), Ok(bytes));
        }
    }
}
