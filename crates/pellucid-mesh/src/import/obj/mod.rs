//! Wavefront OBJ with MTL libraries.
//!
//! Read: `v` with a weight or a colour after it (`v x y z r g b`), `vt`, `f` of any number of corners
//! (`v`, `v/vt`, `v//vn`, `v/vt/vn`, negative indices), `mtllib` (names with spaces, quoted or several
//! on a line), `usemtl`, comments, lines continued by `\`; of a library `newmtl`, `Kd`, and `map_Kd` with
//! its options `-o`, `-s` and `-clamp`. Polygons are cut into triangles, concave ones too.
//!
//! A face's colour is the most detailed that the file gives: the texture of its material, or else its
//! vertices' colours, or else the material's `Kd`, or else [`ImportOptions::color`]. They are not
//! multiplied: beside a `map_Kd` programs leave any `Kd` (0, 0.6, 0.8), which is noted. Colours are sRGB
//! as displays show them; only the `Kd` of libraries that Blender wrote are linear, as it writes them.
//!
//! Left out with a note: lines, points, free-form curves and surfaces, emission, and transparency (`d`, `Tr`, `map_d`, the alpha of
//! textures and vertices) unless [`ImportOptions::opacity`](crate::ImportOptions::opacity) asks for it. Normals
//! and smoothing groups change no colour. An `mtllib` that is not there is refused, as a missing texture
//! is: the colours would be lost.
//!
//! [`ImportOptions::color`]: crate::ImportOptions::color

mod face;
mod looks;
mod mtl;

use std::borrow::Cow;

use super::format::without_mark;
use super::parts::admit_vertex;
use super::source::{Source, quoted};
use super::{Format, parts, text};
use crate::{MeshError, Model};
use face::Faces;
use looks::Looks;

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the file is damaged or no valid OBJ; export it again";

/// Reads a model.
pub(super) fn read(source: &Source, bytes: &[u8]) -> Result<Model, MeshError> {
    let mut reader = Reader {
        source,
        positions: Vec::new(),
        colors: Vec::new(),
        coords: Vec::new(),
        looks: Looks::new(source.options.color),
        faces: Faces::new(source, source.read_as(Format::Obj, None)),
    };
    let mut lines = text::Lines::new(without_mark(bytes));
    while let Some((number, line)) = lines.next() {
        // A comment ends with its line, whatever its last character.
        if line.trim_ascii_start().starts_with(b"#") {
            continue;
        }
        let line = joined(line, &mut lines);
        reader.line(number, &line)?;
    }
    reader.faces.parts.finish("export a mesh with faces (f)")
}

/// A line with those that continue it.
fn joined<'t>(line: &'t [u8], lines: &mut text::Lines<'t>) -> Cow<'t, [u8]> {
    let mut whole = Cow::Borrowed(line);
    while let Some(start) = whole.strip_suffix(b"\\") {
        let kept = start.len();
        let whole = whole.to_mut();
        whole.truncate(kept);
        whole.push(b' ');
        match lines.next() {
            Some((_, next)) => whole.extend_from_slice(next),
            None => break,
        }
    }
    whole
}

struct Reader<'s, 'a> {
    source: &'s Source<'a>,
    positions: Vec<[f64; 3]>,
    /// Linear colours and opacities of vertices; as long as `positions` once a vertex has one.
    colors: Vec<Option<[f32; 4]>>,
    coords: Vec<[f32; 2]>,
    looks: Looks,
    faces: Faces<'s, 'a>,
}

impl Reader<'_, '_> {
    fn line(&mut self, number: u64, line: &[u8]) -> Result<(), MeshError> {
        let source = self.source;
        let object = || format!("line {number}");
        let line = line.trim_ascii();
        let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
        let (keyword, rest) = line.split_at(end);
        match keyword {
            b"v" => self.vertex(number, rest)?,
            b"vt" => {
                admit_vertex(source, self.coords.len(), object)?;
                let [u, v] =
                    numbers(rest).and_then(|n| Some([*n.first()?, *n.get(1).unwrap_or(&0.0)])).ok_or_else(
                        || source.invalid(object(), "vt needs one to three finite numbers", REEXPORT),
                    )?;
                let coord = [u as f32, v as f32];
                if !coord.iter().all(|c| c.is_finite()) {
                    return Err(source.invalid(object(), "a texture coordinate is too large", REEXPORT));
                }
                self.coords.push(coord);
            }
            b"f" | b"fo" => {
                let geometry =
                    face::Geometry { positions: &self.positions, colors: &self.colors, coords: &self.coords };
                self.faces.add(number, rest, &geometry, &mut self.looks)?;
            }
            b"mtllib" => self.looks.load(source, &object(), &text::string(rest))?,
            b"usemtl" => self.looks.choose(source, &object(), &text::string(rest)),
            b"l" | b"p" => source.note("file", "points and lines are left out"),
            b"curv" | b"curv2" | b"surf" | b"cstype" => {
                source.note("file", "free-form curves and surfaces are left out");
            }
            _ => {}
        }
        Ok(())
    }

    /// `v x y z`, with a weight, a colour, or a colour and an opacity after it.
    fn vertex(&mut self, number: u64, rest: &[u8]) -> Result<(), MeshError> {
        let source = self.source;
        let object = || format!("line {number}");
        admit_vertex(source, self.positions.len(), object)?;
        let (position, color) = match numbers(rest).as_deref() {
            Some([x, y, z] | [x, y, z, _]) => ([*x, *y, *z], None),
            Some([x, y, z, r, g, b]) => ([*x, *y, *z], Some([*r, *g, *b, 1.0])),
            Some([x, y, z, r, g, b, a]) => ([*x, *y, *z], Some([*r, *g, *b, *a])),
            _ => {
                let reason =
                    format!("{} is not v with 3, 4, 6 or 7 finite numbers", quoted(&text::string(rest)));
                return Err(source.invalid(object(), reason, REEXPORT));
            }
        };
        if color.is_some() && self.colors.is_empty() {
            self.colors.resize(self.positions.len(), None);
        }
        self.positions.push(position);
        if let Some([r, g, b, a]) = color {
            if [r, g, b].iter().any(|c| !(0.0..=1.0).contains(c)) {
                source.note(object(), "a vertex colour outside 0..1 was clamped");
            }
            let [r, g, b] = parts::linear([r, g, b]);
            self.colors.push(Some([r, g, b, a.clamp(0.0, 1.0) as f32]));
        } else if !self.colors.is_empty() {
            self.colors.push(None);
        }
        Ok(())
    }
}

/// All numbers of a line up to a comment; at most eight.
fn numbers(rest: &[u8]) -> Option<Vec<f64>> {
    text::words(rest).take_while(|word| word[0] != b'#').take(8).map(text::number).collect()
}
