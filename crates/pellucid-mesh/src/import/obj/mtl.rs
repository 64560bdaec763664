//! MTL libraries: `Kd` and `map_Kd` of each material.

use std::collections::BTreeMap;

use super::looks::{Mapping, unquoted};
use super::text;
use crate::MeshError;
use crate::import::format::without_mark;
use crate::import::parts;
use crate::import::source::{Source, quoted};

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the material library is damaged; export the model again";

/// A material of a library.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Material {
    /// What errors and notes call it.
    pub place: String,
    /// Linear `Kd`.
    pub color: Option<[f32; 3]>,
    pub map: Option<Map>,
    /// Opacity (`d`, or else 1 - `Tr`).
    pub alpha: Option<f32>,
    pub opacity_map: Option<Map>,
}

/// A `map_Kd` or `map_d`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    pub file: String,
    pub mapping: Mapping,
    pub clamp: bool,
}

/// What is noted of a material that is not opaque, where opacity does not count.
const IGNORED: &str = "its transparency is ignored: prints are opaque";

/// A library while it is read.
pub(super) struct Library<'s, 'a> {
    source: &'s Source<'a>,
    name: &'s str,
    /// `Kd` are linear and not sRGB.
    linear: bool,
}

impl<'s, 'a> Library<'s, 'a> {
    /// Adds the materials of a library to `materials`; those of a later library do not replace
    /// earlier ones.
    pub fn read(
        source: &'s Source<'a>,
        name: &'s str,
        bytes: &[u8],
        materials: &mut BTreeMap<String, Material>,
    ) -> Result<(), MeshError> {
        let bytes = without_mark(bytes);
        let library = Self { source, name, linear: bytes.starts_with(b"# Blender") };
        let mut current: Option<(String, Material)> = None;
        let mut keep = |done: Option<(String, Material)>, line: u64| {
            let Some((name, material)) = done else { return Ok(()) };
            if materials.len() as u64 >= source.limits.items {
                let reason = format!("there are more than {} materials", source.limits.items);
                let remedy = "simplify the model or raise ImportLimits::items";
                return Err(source.unsupported(library.at(line), reason, remedy));
            }
            materials.entry(name).or_insert(material);
            Ok(())
        };
        let mut last = 0;
        for (number, line) in text::Lines::new(bytes) {
            last = number;
            let line = line.trim_ascii();
            let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
            let (keyword, rest) = line.split_at(end);
            if keyword == b"newmtl" {
                keep(current.take(), number)?;
                let name = text::string(rest);
                let place = format!("{}, material {}", library.name, quoted(unquoted(&name)));
                current = Some((unquoted(&name).to_owned(), Material { place, ..Material::default() }));
            } else if let Some((_, material)) = &mut current {
                library.property(material, number, keyword, rest)?;
            }
        }
        keep(current, last)
    }

    /// A line of the library, as errors say it.
    fn at(&self, line: u64) -> String {
        format!("{}, line {line}", self.name)
    }

    fn property(
        &self,
        material: &mut Material,
        number: u64,
        keyword: &[u8],
        rest: &[u8],
    ) -> Result<(), MeshError> {
        let note = |text: &str| self.source.note(&material.place, text);
        let opaque = !self.source.options.opacity;
        match keyword.to_ascii_lowercase().as_slice() {
            b"kd" => material.color = self.color(material, number, rest)?,
            b"map_kd" => material.map = Some(self.map(number, rest)?),
            b"map_d" if opaque => note(IGNORED),
            b"map_d" => material.opacity_map = Some(self.map(number, rest)?),
            b"d" => match value(rest) {
                Some(d) if d < 1.0 && opaque => note(IGNORED),
                Some(d) => material.alpha = Some(d.clamp(0.0, 1.0) as f32),
                None => {}
            },
            // Some programs write an opacity of 1 as Tr 1.
            b"tr" => match value(rest).filter(|tr| *tr > 0.0 && *tr < 1.0) {
                Some(_) if opaque => note(IGNORED),
                Some(tr) => material.alpha = material.alpha.or(Some(1.0 - tr as f32)),
                None => {}
            },
            b"ke" if text::words(rest).filter_map(text::number).any(|c| c > 0.0) => {
                note("its emission is left out: only its diffuse colour is printed");
            }
            _ => {}
        }
        Ok(())
    }

    /// The map of a line that must have one.
    fn map(&self, number: u64, rest: &[u8]) -> Result<Map, MeshError> {
        map(&text::string(rest)).ok_or_else(|| {
            let reason = format!("{} does not name a texture", quoted(&text::string(rest)));
            self.source.invalid(self.at(number), reason, REEXPORT)
        })
    }

    /// `Kd r g b` or `Kd grey`; spectra and CIE XYZ are left out.
    fn color(&self, material: &Material, number: u64, rest: &[u8]) -> Result<Option<[f32; 3]>, MeshError> {
        let words: Vec<&[u8]> = text::words(rest).take_while(|w| w[0] != b'#').take(4).collect();
        if matches!(words.first(), Some(&(b"spectral" | b"xyz"))) {
            self.source.note(&material.place, "a Kd other than RGB is left out");
            return Ok(None);
        }
        let values: Option<Vec<f64>> = words.into_iter().map(text::number).collect();
        let rgb = match values.as_deref() {
            Some([grey]) => [*grey; 3],
            Some([r, g, b]) => [*r, *g, *b],
            _ => {
                let reason = format!("Kd {} is no colour", quoted(&text::string(rest)));
                return Err(self.source.invalid(self.at(number), reason, REEXPORT));
            }
        };
        if rgb.iter().any(|c| !(0.0..=1.0).contains(c)) {
            self.source.note(&material.place, "its Kd is outside 0..1 and was clamped");
        }
        Ok(Some(if self.linear { rgb.map(|c| c.clamp(0.0, 1.0) as f32) } else { parts::linear(rgb) }))
    }
}

/// The one number of a line.
fn value(rest: &[u8]) -> Option<f64> {
    text::words(rest).next().and_then(text::number)
}

/// Options and file name of a `map_Kd`; the name is all that follows the options.
fn map(rest: &str) -> Option<Map> {
    let mut mapping = Mapping::PLAIN;
    let mut clamp = false;
    let mut rest = rest.trim();
    while rest.starts_with('-') {
        let (option, tail) = rest.split_once(char::is_whitespace)?;
        rest = tail.trim_start();
        match option {
            "-o" | "-s" | "-t" => {
                let (values, tail) = up_to_three(rest);
                rest = tail;
                let target = if option == "-o" { &mut mapping.offset } else { &mut mapping.scale };
                if option != "-t" {
                    target.iter_mut().zip(values).for_each(|(t, v)| *t = v as f32);
                }
            }
            "-mm" => {
                for _ in 0..2 {
                    rest = rest.split_once(char::is_whitespace)?.1.trim_start();
                }
            }
            _ => {
                let (argument, tail) = rest.split_once(char::is_whitespace)?;
                clamp |= option == "-clamp" && argument == "on";
                rest = tail.trim_start();
            }
        }
    }
    let file = unquoted(rest);
    let finite = mapping.scale.iter().chain(&mapping.offset).all(|c| c.is_finite());
    (finite && !file.is_empty()).then(|| Map { file: file.to_owned(), mapping, clamp })
}

/// One to three leading numbers, the last of which cannot be all of the file's name.
fn up_to_three(mut rest: &str) -> (Vec<f64>, &str) {
    let mut values = Vec::new();
    while values.len() < 3
        && let Some((word, tail)) = rest.split_once(char::is_whitespace)
        && let Some(value) = text::number(word.as_bytes())
    {
        values.push(value);
        rest = tail.trim_start();
    }
    (values, rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_before_a_name_with_spaces() {
        let plain = Map { file: "my skin.png".into(), mapping: Mapping::PLAIN, clamp: false };
        for rest in
            ["my skin.png", " \"my skin.png\" ", "-blendu on -bm 1 my skin.png", "-mm 0 1 my skin.png"]
        {
            assert_eq!(map(rest).as_ref(), Some(&plain), "{rest}");
        }
        let moved = map("-clamp on -o 0.5 0.25 0 -s 2 3 7 days.png").unwrap();
        assert_eq!(moved.mapping, Mapping { scale: [2.0, 3.0], offset: [0.5, 0.25] });
        assert!(moved.clamp && moved.file == "days.png", "{moved:?}");
        assert_eq!(map("-o 1 2.png").unwrap().file, "2.png");
        for rest in ["", "\"\"", "-clamp", "-clamp on", "-o 1e39 a.png", "-mm 0 1"] {
            assert_eq!(map(rest), None, "{rest:?}");
        }
    }
}
