//! A refinement between two steps, as a value that can be stored.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};

use pellucid_core::random::mix;
use pellucid_predict::Learned;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{RefineError, RefineReport, RefineSettings};

/// First line of a stored refinement.
const HEADER: &str = "pellucid refinement 1";

/// A refinement between two steps: what [`Refinement::resume`](crate::Refinement::resume) needs, without labels, since
/// they follow from the state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved<S> {
    /// [`Strategy::name`](crate::Strategy::name).
    pub strategy: String,
    /// [`Strategy::settings`](crate::Strategy::settings).
    pub strategy_settings: BTreeMap<String, f64>,
    /// The loop's settings.
    pub settings: RefineSettings,
    /// [`Object::id`](pellucid_predict::Object::id).
    pub object: u64,
    /// Digested of targets, viewing and inks.
    pub colors: u64,
    /// The next iteration.
    pub iteration: u32,
    /// The state of the next iteration; of the last one when all are done.
    pub state: S,
    /// The state of the best iteration so far, without history.
    pub best: Option<S>,
    /// What happened so far.
    pub report: RefineReport,
    /// What the predictor learned so far.
    #[serde(with = "crate::packed::Learned")]
    pub memory: Learned,
}

impl<S> Saved<S> {
    /// The same with another form of the states.
    pub(crate) fn map<T>(self, mut state: impl FnMut(S) -> T) -> Saved<T> {
        let (own, best) = (state(self.state), self.best.map(state));
        Saved {
            strategy: self.strategy,
            strategy_settings: self.strategy_settings,
            settings: self.settings,
            object: self.object,
            colors: self.colors,
            iteration: self.iteration,
            state: own,
            best,
            report: self.report,
            memory: self.memory,
        }
    }
}

impl<S: Serialize> Saved<S> {
    /// Writes a line of text, a digest, and JSON with long arrays packed, of which it holds some kilobytes at a time. Every
    /// number comes back as it was.
    ///
    /// # Errors
    /// Those of `out`; when the strategy's state does not serialise.
    pub fn write_to(&self, mut out: impl Write + Seek) -> io::Result<()> {
        // The digest begins with the length, which is known only after all was written once.
        let mut counted = Digested::new(0, io::sink());
        serde_json::to_writer(&mut counted, self)?;
        let start = out.stream_position()?;
        write!(out, "{HEADER}\n{:016x}\n", 0)?;
        let mut digest = Digested::new(counted.length, &mut out);
        serde_json::to_writer(&mut digest, self)?;
        let value = digest.value();
        let end = out.stream_position()?;
        out.seek(SeekFrom::Start(start + HEADER.len() as u64 + 1))?;
        write!(out, "{value:016x}")?;
        out.seek(SeekFrom::Start(end))?;
        Ok(())
    }

    /// What [`Saved::write_to`] writes.
    ///
    /// # Errors
    /// [`RefineError::Unsupported`] when the strategy's state does not serialise.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RefineError> {
        let mut bytes = io::Cursor::new(Vec::new());
        self.write_to(&mut bytes).map_err(|e| RefineError::unsupported("strategy's state", e.to_string()))?;
        Ok(bytes.into_inner())
    }
}

impl<S: DeserializeOwned> Saved<S> {
    /// From [`Saved::to_bytes`]. Takes memory in proportion to the bytes.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when the bytes are not of a refinement, or damaged; [`RefineError::Unsupported`] when
    /// another version wrote them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RefineError> {
        Self::read_from(bytes, bytes.len() as u64)
    }

    /// From what [`Saved::write_to`] wrote, `length` bytes of it. Beside the value it holds one of its arrays at a time.
    ///
    /// # Errors
    /// As [`Saved::from_bytes`]; also when `input` fails, whose error is not kept.
    pub fn read_from(mut input: impl Read, length: u64) -> Result<Self, RefineError> {
        let invalid = |reason: &str| RefineError::invalid("checkpoint", reason);
        let head = HEADER.len() + 1 + 16 + 1;
        let mut bytes = Vec::new();
        let read = input.by_ref().take(head as u64).read_to_end(&mut bytes);
        let mut lines = bytes.split(|&b| b == b'\n');
        let header = lines.next().unwrap_or_default();
        if header != HEADER.as_bytes() {
            return Err(match header.starts_with(b"pellucid refinement ") {
                true => RefineError::unsupported("checkpoint", "is of another version; begin anew"),
                false => invalid("is not of a refinement"),
            });
        }
        let (Ok(_), Some(sum), Some([])) = (read, lines.next(), lines.next()) else {
            return Err(invalid("is cut off"));
        };
        let json = length.saturating_sub(head as u64);
        let mut digest = Digested::new(json, input.take(json));
        let saved = serde_json::from_reader(io::BufReader::new(&mut digest));
        // What is damaged is said to be so, whatever else is wrong with it then.
        let rest = io::copy(&mut digest, &mut io::sink());
        if rest.is_err() || sum != format!("{:016x}", digest.value()).as_bytes() {
            return Err(invalid("is damaged: its digest differs"));
        }
        saved.map_err(|e| invalid(&e.to_string()))
    }
}

/// Bytes that pass through, with their digest and number.
struct Digested<T> {
    through: T,
    state: u64,
    /// Bytes of a word that is not whole yet.
    word: [u8; 8],
    length: u64,
}

impl<T> Digested<T> {
    /// Of `length` bytes.
    fn new(length: u64, through: T) -> Self {
        Self { through, state: mix(length.wrapping_add(1)), word: [0; 8], length: 0 }
    }

    fn take(&mut self, mut bytes: &[u8]) {
        let known = (self.length % 8) as usize;
        self.length += bytes.len() as u64;
        if known > 0 {
            let count = bytes.len().min(8 - known);
            self.word[known..known + count].copy_from_slice(&bytes[..count]);
            bytes = &bytes[count..];
            if known + count < 8 {
                return;
            }
            self.whole(self.word);
        }
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|&word| self.whole(word));
        self.word[..rest.len()].copy_from_slice(rest);
    }

    fn whole(&mut self, word: [u8; 8]) {
        self.state = mix(self.state.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from_le_bytes(word));
    }

    fn value(&self) -> u64 {
        let rest = &self.word[..(self.length % 8) as usize];
        rest.iter().fold(self.state, |state, &b| mix(state ^ u64::from(b)))
    }
}

impl<W: Write> Write for Digested<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.through.write(bytes)?;
        self.take(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.through.flush()
    }
}

impl<R: Read> Read for Digested<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.through.read(bytes)?;
        self.take(&bytes[..read]);
        Ok(read)
    }
}
