//! What every step of an import shares: the file's name, the limits, and the notes.

use std::cell::{Cell, RefCell};
use std::path::Path;

use super::{Format, ImportLimits, ImportOptions, LengthUnit, ReadAs};
use crate::{MeshError, Note};

/// Most notes kept of one import; a file with thousands of odd parts repeats itself.
const MAX_NOTES: usize = 64;

/// The model being imported.
pub(super) struct Source<'a> {
    pub file: &'a str,
    /// Folder that relative URIs start from; none for a model given as bytes alone.
    pub folder: Option<&'a Path>,
    pub limits: &'a ImportLimits,
    pub options: &'a ImportOptions,
    /// Bytes that other files may still bring in.
    pub budget: Cell<u64>,
    notes: RefCell<Vec<Note>>,
}

impl<'a> Source<'a> {
    pub fn new(file: &'a str, folder: Option<&'a Path>, options: &'a ImportOptions) -> Self {
        let limits = &options.limits;
        let budget = Cell::new(limits.file_bytes);
        Self { file, folder, limits, options, budget, notes: RefCell::default() }
    }

    /// How a file of this format is read: by the options, or else by its own unit and the format's
    /// habits.
    pub fn read_as(&self, format: Format, unit: Option<LengthUnit>) -> ReadAs {
        let habit = format.habit();
        ReadAs {
            format,
            unit: self.options.unit.or(unit).unwrap_or(habit.unit),
            up: self.options.up.unwrap_or(habit.up),
            color: self.options.color,
        }
    }

    pub fn invalid(
        &self,
        object: impl Into<String>,
        reason: impl Into<String>,
        remedy: impl Into<String>,
    ) -> MeshError {
        MeshError::invalid(self.file, object, reason, remedy)
    }

    pub fn unsupported(
        &self,
        object: impl Into<String>,
        reason: impl Into<String>,
        remedy: impl Into<String>,
    ) -> MeshError {
        MeshError::unsupported(self.file, object, reason, remedy)
    }

    pub fn io(&self, object: impl Into<String>, source: std::io::Error, remedy: &str) -> MeshError {
        MeshError::Io { file: self.file.into(), object: object.into(), source, remedy: remedy.into() }
    }

    /// Keeps a note, once.
    pub fn note(&self, object: impl Into<String>, text: impl Into<String>) {
        let note = Note { object: object.into(), text: text.into() };
        let mut notes = self.notes.borrow_mut();
        if notes.len() < MAX_NOTES && !notes.contains(&note) {
            notes.push(note);
        }
    }

    pub fn into_notes(self) -> Vec<Note> {
        self.notes.into_inner()
    }
}

/// `mesh 3 "Body"`: what errors call an element of the file.
pub(super) fn label(kind: &str, index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) if !name.is_empty() => format!("{kind} {index} {}", quoted(name)),
        _ => format!("{kind} {index}"),
    }
}

/// Text from the file, escaped and cut to a readable length.
pub(super) fn quoted(text: &str) -> String {
    const LONGEST: usize = 80;
    let mut short: String = text.chars().take(LONGEST).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    format!("{short:?}")
}
