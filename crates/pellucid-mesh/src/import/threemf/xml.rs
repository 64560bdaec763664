//! XML as a stream of elements with their namespaces.

use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::{QName, ResolveResult};
use quick_xml::reader::NsReader;

use super::REEXPORT;
use crate::MeshError;
use crate::import::format::without_mark;
use crate::import::source::Source;

/// Elements within elements at most.
const DEEPEST: u32 = 256;

/// The namespaces that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Core,
    Materials,
    Production,
    Other,
}

impl Space {
    pub fn of(uri: &str) -> Self {
        match uri {
            "http://schemas.microsoft.com/3dmanufacturing/core/2015/02" => Self::Core,
            "http://schemas.microsoft.com/3dmanufacturing/material/2015/02" => Self::Materials,
            "http://schemas.microsoft.com/3dmanufacturing/production/2015/06" => Self::Production,
            _ => Self::Other,
        }
    }
}

/// An element's start.
pub(super) struct Tag<'i> {
    pub space: Space,
    start: BytesStart<'i>,
}

impl Tag<'_> {
    /// Its name without prefix.
    pub fn name(&self) -> &str {
        self.start.local_name().into_inner()
    }

    /// Whether it is a core element of that name.
    pub fn is_core(&self, name: &str) -> bool {
        self.space == Space::Core && self.name() == name
    }

    /// The attribute of a name as it is written, prefix and all.
    pub fn text(&self, name: &str) -> Option<String> {
        let mut attributes = self.start.attributes();
        let attributes = attributes.with_checks(false);
        let found = attributes.flatten().find(|a| a.key == QName(name))?;
        found.normalized_value(XmlVersion::Implicit1_0).ok().map(|text| text.into_owned())
    }

    /// Calls `each` with the name and the raw text of every attribute: numbers need no more.
    pub fn each(&self, mut each: impl FnMut(&str, &str)) {
        let mut attributes = self.start.attributes();
        for attribute in attributes.with_checks(false).flatten() {
            each(attribute.key.into_inner(), &attribute.value);
        }
    }
}

pub(super) enum Token<'i> {
    Open(Tag<'i>),
    Close,
    End,
}

/// A document while it is read.
pub(super) struct Xml<'s, 'a, 'i> {
    source: &'s Source<'a>,
    /// The part's name.
    pub part: &'s str,
    text: &'i str,
    reader: NsReader<&'i [u8]>,
    depth: u32,
}

impl<'s, 'a, 'i> Xml<'s, 'a, 'i> {
    pub fn new(source: &'s Source<'a>, part: &'s str, bytes: &'i [u8]) -> Result<Self, MeshError> {
        let text = std::str::from_utf8(without_mark(bytes)).map_err(|_| {
            source.unsupported(part, "its text is not UTF-8", "export the model again with UTF-8 XML")
        })?;
        let mut reader = NsReader::from_str(text);
        reader.config_mut().expand_empty_elements = true;
        Ok(Self { source, part, text, reader, depth: 0 })
    }

    /// The next start or end of an element.
    pub fn token(&mut self) -> Result<Token<'i>, MeshError> {
        loop {
            let event =
                self.reader.read_event().map_err(|e| self.broken(&format!("it is no valid XML: {e}")))?;
            match event {
                Event::Start(start) => {
                    let space = match self.reader.resolver().resolve_element(start.name()).0 {
                        ResolveResult::Bound(uri) => Space::of(uri.into_inner()),
                        _ => Space::Other,
                    };
                    self.depth += 1;
                    if self.depth > DEEPEST {
                        return Err(self.broken("its elements are nested too deep"));
                    }
                    return Ok(Token::Open(Tag { space, start }));
                }
                Event::End(_) => {
                    self.depth = self.depth.saturating_sub(1);
                    return Ok(Token::Close);
                }
                Event::DocType(_) => return Err(self.broken("it has a document type definition")),
                Event::Eof if self.depth > 0 => return Err(self.broken("it is cut short")),
                Event::Eof => return Ok(Token::End),
                _ => {}
            }
        }
    }

    /// Passes over the rest of the element that was opened last.
    pub fn skip(&mut self) -> Result<(), MeshError> {
        let outside = self.depth.saturating_sub(1);
        while self.depth > outside {
            self.token()?;
        }
        Ok(())
    }

    /// Calls `each` with every child of the element that was opened last. `each` reads the child to
    /// its end and says so, or leaves it to be passed over.
    pub fn children(
        &mut self,
        mut each: impl FnMut(&mut Self, &Tag<'i>) -> Result<bool, MeshError>,
    ) -> Result<(), MeshError> {
        loop {
            match self.token()? {
                Token::Open(tag) => {
                    if !each(self, &tag)? {
                        self.skip()?;
                    }
                }
                Token::Close | Token::End => return Ok(()),
            }
        }
    }

    /// The text of an attribute in a namespace.
    pub fn attribute(&self, tag: &Tag, space: Space, name: &str) -> Option<String> {
        let mut attributes = tag.start.attributes();
        let found = attributes.with_checks(false).flatten().find(|a| {
            let (found, local) = self.reader.resolver().resolve_attribute(a.key);
            let bound = matches!(found, ResolveResult::Bound(uri) if Space::of(uri.into_inner()) == space);
            bound && local.into_inner() == name
        })?;
        found.normalized_value(XmlVersion::Implicit1_0).ok().map(|text| text.into_owned())
    }

    fn broken(&self, reason: &str) -> MeshError {
        let at =
            (self.reader.error_position().min(self.reader.buffer_position()) as usize).min(self.text.len());
        let line = 1 + self.text.as_bytes()[..at].iter().filter(|&&b| b == b'\n').count();
        self.source.invalid(format!("{}, line {line}", self.part), reason, REEXPORT)
    }
}
