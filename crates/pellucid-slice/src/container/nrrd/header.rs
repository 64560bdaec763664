//! The header of a NRRD file: lines of text up to an empty one.

use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::path::Path;

use pellucid_core::Fault;
use pellucid_voxel::Pitch;

use crate::SliceError;
use crate::manifest::Manifest;

/// Longest header that is read.
const MAX_BYTES: u64 = 1 << 16;

/// The header of a volume of labels.
pub(super) fn text(manifest: &Manifest) -> String {
    let ([x, y, z], mm, corner) = (manifest.size, manifest.pitch_mm, manifest.origin_mm);
    let [cx, cy, cz]: [f64; 3] = std::array::from_fn(|a| corner[a] + mm[a] / 2.0);
    let [px, py, pz] = mm;
    let mut text = format!(
        "NRRD0004\n# labels of a print, 0 is air\ntype: uint8\ndimension: 3\nspace: 3D-right-handed\n\
         sizes: {x} {y} {z}\nspace directions: ({px},0,0) (0,{py},0) (0,0,{pz})\ncenterings: cell cell cell\n\
         kinds: domain domain domain\nencoding: gzip\nspace units: \"mm\" \"mm\" \"mm\"\n\
         space origin: ({cx},{cy},{cz})\n"
    );
    for m in &manifest.materials {
        let name = m.name.replace('\\', "\\\\").replace('\n', "\\n");
        let [r, g, b, a] = m.rgba;
        text += &format!("material {0}:={name}\nrgba {0}:={r} {g} {b} {a}\n", m.label);
    }
    text + "\n"
}

/// What a header says of a volume of labels.
pub(super) struct Header {
    /// Voxels along x, y, z.
    pub size: [u32; 3],
    pub pitch: Pitch,
    /// Centre of voxel (0, 0, 0).
    pub centre_mm: [f64; 3],
    pub gzip: bool,
    /// Label, name and colour.
    pub materials: Vec<(u8, String, [u8; 4])>,
    /// Length of the header.
    pub bytes: u64,
}

impl Header {
    /// Reads up to the empty line.
    pub fn read(from: &mut impl BufRead, path: &Path) -> Result<Self, SliceError> {
        let mut lines = Lines { from: from.take(MAX_BYTES), path, bytes: 0 };
        let magic = lines.next()?;
        if !["NRRD0001", "NRRD0002", "NRRD0003", "NRRD0004", "NRRD0005"].contains(&magic.as_str()) {
            return Err(SliceError::file(path, "is not a NRRD file"));
        }
        let (mut fields, mut pairs) = (BTreeMap::new(), BTreeMap::new());
        loop {
            let line = lines.next()?;
            if line.is_empty() {
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            let parts = line.split_once(':').map(|(key, rest)| (key, rest.strip_prefix('='), rest));
            let twice = match parts {
                Some((key, Some(value), _)) => pairs.insert(key.to_owned(), value.to_owned()),
                Some((key, None, value)) => fields.insert(key.replace(' ', ""), value.trim().to_owned()),
                None => return Err(SliceError::file(path, format!("line {line:?} is no field"))),
            };
            if twice.is_some() {
                return Err(SliceError::file(path, format!("{line:?} is said twice")));
            }
        }
        Fields { path, fields }.header(materials(path, &pairs)?, lines.bytes)
    }
}

/// Lines of text up to a bound.
struct Lines<'a, R> {
    from: std::io::Take<R>,
    path: &'a Path,
    bytes: u64,
}

impl<R: BufRead> Lines<'_, R> {
    fn next(&mut self) -> Result<String, SliceError> {
        let mut line = Vec::new();
        let read = self
            .from
            .read_until(b'\n', &mut line)
            .map_err(|e| SliceError::reading(self.path, e, "the header"))?;
        self.bytes += read as u64;
        match line.pop() {
            Some(b'\n') => {}
            _ => return Err(SliceError::file(self.path, "has no empty line after its header")),
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        String::from_utf8(line).map_err(|_| SliceError::file(self.path, "its header is no text"))
    }
}

/// Fields by name, without spaces.
struct Fields<'a> {
    path: &'a Path,
    fields: BTreeMap<String, String>,
}

impl Fields<'_> {
    fn header(&self, materials: Vec<(u8, String, [u8; 4])>, bytes: u64) -> Result<Header, SliceError> {
        if !["uint8", "uint8_t", "uchar", "unsigned char"].contains(&self.need("type")?) {
            return self.unsupported("type", "labels are uint8");
        }
        if self.need("dimension")? != "3" {
            return self.unsupported("dimension", "labels have the axes x, y, z");
        }
        if self.fields.contains_key("datafile") {
            return self.unsupported("datafile", "save data and header as one file");
        }
        for skip in ["lineskip", "byteskip"] {
            if self.fields.get(skip).is_some_and(|n| n != "0") {
                return self.unsupported(skip, "save the file without");
            }
        }
        if self.fields.get("spaceunits").is_some_and(|u| u.split_whitespace().any(|unit| unit != "\"mm\"")) {
            return self.unsupported("spaceunits", "lengths are mm");
        }
        let gzip = match self.need("encoding")? {
            "gzip" | "gz" => true,
            "raw" => false,
            _ => return self.unsupported("encoding", "save it as raw or gzip"),
        };
        let mut size = [0; 3];
        let sizes: Vec<&str> = self.need("sizes")?.split_whitespace().collect();
        if sizes.len() != 3 {
            return self.invalid("sizes", "must be three numbers");
        }
        for (size, text) in size.iter_mut().zip(sizes) {
            match text.parse() {
                Ok(number) => *size = number,
                Err(_) => return self.invalid("sizes", "must be whole numbers that fit a grid"),
            }
        }
        let pitch = Pitch::new(self.edges()?).map_err(|e| SliceError::from(e).in_file(self.path))?;
        let centre_mm = match self.fields.get("spaceorigin") {
            Some(text) => match vectors(text).as_deref() {
                Some(&[centre]) => centre,
                _ => return self.invalid("spaceorigin", "must be one vector of three numbers"),
            },
            // A volume without a place has its corner at 0.
            None => pitch.mm().map(|edge| edge / 2.0),
        };
        Ok(Header { size, pitch, centre_mm, gzip, materials, bytes })
    }

    /// Edges of a voxel in mm.
    fn edges(&self) -> Result<[f64; 3], SliceError> {
        if self.fields.contains_key("spacedirections") {
            return match vectors(self.need("spacedirections")?).as_deref() {
                Some(&[[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]) => Ok([x, y, z]),
                _ => self.unsupported("spacedirections", "axes are x, y, z, and not turned"),
            };
        }
        let edges: Option<Vec<f64>> =
            self.need("spacings")?.split_whitespace().map(|number| number.parse().ok()).collect();
        match edges.as_deref() {
            Some(&[x, y, z]) => Ok([x, y, z]),
            _ => self.invalid("spacings", "must be three numbers"),
        }
    }

    fn need(&self, field: &str) -> Result<&str, SliceError> {
        let missing = || SliceError::file(self.path, format!("its header has no field {field:?}"));
        self.fields.get(field).map(String::as_str).ok_or_else(missing)
    }

    fn fault(&self, field: &str, reason: &str) -> (String, String) {
        let value = self.fields.get(field).map_or("", String::as_str);
        (format!("{}: {field}", self.path.display()), format!("{value:?}; {reason}"))
    }

    fn invalid<T>(&self, field: &str, reason: &str) -> Result<T, SliceError> {
        let (subject, reason) = self.fault(field, reason);
        Err(SliceError::invalid(subject, reason))
    }

    fn unsupported<T>(&self, field: &str, reason: &str) -> Result<T, SliceError> {
        let (subject, reason) = self.fault(field, reason);
        Err(SliceError::Unsupported(Fault::new(subject, reason)))
    }
}

/// Vectors of three numbers, `(1,0,0) (0,2,0)`.
fn vectors(text: &str) -> Option<Vec<[f64; 3]>> {
    let parts = text.split(')').map(str::trim);
    let parts: Vec<&str> = parts.collect();
    let (last, parts) = parts.split_last()?;
    let vector = |part: &&str| {
        let numbers: Vec<f64> =
            part.strip_prefix('(')?.split(',').map(|n| n.trim().parse().ok()).collect::<Option<_>>()?;
        numbers.try_into().ok()
    };
    if last.is_empty() { parts.iter().map(vector).collect() } else { None }
}

/// Labels whose pairs `material N` and `rgba N` are there, ascending.
fn materials(
    path: &Path,
    pairs: &BTreeMap<String, String>,
) -> Result<Vec<(u8, String, [u8; 4])>, SliceError> {
    let mut found = Vec::new();
    for label in 1..=255u8 {
        let (name, color) = (pairs.get(&format!("material {label}")), pairs.get(&format!("rgba {label}")));
        let (Some(name), Some(color)) = (name, color) else { continue };
        let rgba: Option<Vec<u8>> = color.split_whitespace().map(|v| v.parse().ok()).collect();
        let Some(rgba) = rgba.and_then(|v| v.try_into().ok()) else {
            let reason = format!("rgba {label} is {color:?}, and must be four numbers from 0 to 255");
            return Err(SliceError::file(path, reason));
        };
        found.push((label, unescaped(name), rgba));
    }
    Ok(found)
}

fn unescaped(text: &str) -> String {
    let mut out = String::new();
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        out.push(match (c, c == '\\') {
            (_, true) => match characters.next() {
                Some('n') => '\n',
                Some(other) => other,
                None => '\\',
            },
            (c, false) => c,
        });
    }
    out
}
