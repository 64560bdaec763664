//! `ConfigFile.xml` of a GCVF.

use std::fmt::Write;
use std::path::Path;

use pellucid_core::Fault;
use roxmltree::{Document, Node, ParsingOptions};

use super::{PREFIX, Resolution};
use crate::SliceError;
use crate::manifest::Manifest;

/// Most nodes of a file that is read: 255 materials have a tenth of that.
const MAX_NODES: u32 = 20_000;

/// One material of a GCVF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigMaterial {
    /// The printer's name of it.
    pub name: String,
    /// The colour that stands for it in the images.
    pub rgba: [u8; 4],
    /// Number of voxels of it.
    pub voxels: u64,
}

/// What a GCVF says of its images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Edges of the voxels.
    pub resolution: Resolution,
    /// Width and height of the images.
    pub slice_size: [u32; 2],
    /// Number of the bottom image.
    pub start: u32,
    /// Number of images.
    pub slices: u32,
    /// Most materials besides the background.
    pub max_colors: u32,
    /// What stands before an image's number.
    pub prefix: String,
    /// Colour of empty space.
    pub background: [u8; 4],
    /// The materials.
    pub materials: Vec<ConfigMaterial>,
}

impl Config {
    pub(super) fn of(manifest: &Manifest, resolution: Resolution, max_colors: u32) -> Self {
        let materials = manifest.materials.iter().map(|m| ConfigMaterial {
            name: m.resin.clone().unwrap_or_else(|| m.name.clone()),
            rgba: m.rgba,
            voxels: m.voxels,
        });
        let [width, height, _] = manifest.size;
        Self {
            resolution,
            slice_size: [width, height],
            start: 0,
            slices: manifest.layers,
            max_colors,
            prefix: PREFIX.into(),
            background: manifest.background,
            materials: materials.collect(),
        }
    }

    pub(super) fn to_xml(&self) -> String {
        let [xdpi, ydpi] = self.resolution.dpi;
        let [width, height] = self.slice_size;
        let rgba = |[r, g, b, a]: [u8; 4]| format!("{r} {g} {b} {a}");
        let mut xml = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<GCVF>\n  <Version>2</Version>\n  <Resolution>\n    \
             <XDpi>{xdpi}</XDpi>\n    <YDpi>{ydpi}</YDpi>\n    \
             <SliceThicknessNanoMeter>{}</SliceThicknessNanoMeter>\n  </Resolution>\n  <SliceDimensions>\n    \
             <SliceWidth>{width}</SliceWidth>\n    <SliceHeight>{height}</SliceHeight>\n  </SliceDimensions>\n  \
             <SliceRange>\n    <StartIndex>{}</StartIndex>\n    <NumberOfSlices>{}</NumberOfSlices>\n  \
             </SliceRange>\n  <BitDepth>4</BitDepth>\n  <MaxNumberOfColors>{}</MaxNumberOfColors>\n  \
             <DataSemantics>Materials</DataSemantics>\n  <CreationMode>MODEL_ONLY</CreationMode>\n  \
             <ImageFilePrefix>{}</ImageFilePrefix>\n  <MaterialList>\n    \
             <BackGroundMaterialRGBA>{}</BackGroundMaterialRGBA>\n",
            self.resolution.layer_nm,
            self.start,
            self.slices,
            self.max_colors,
            escaped(&self.prefix),
            rgba(self.background)
        );
        for m in &self.materials {
            // Writing to a string cannot fail.
            let _ = writeln!(
                xml,
                "    <Material>\n      <Name>{}</Name>\n      <RGBA>{}</RGBA>\n      \
                 <VoxelCount>{}</VoxelCount>\n    </Material>",
                escaped(&m.name),
                rgba(m.rgba),
                m.voxels
            );
        }
        xml + "  </MaterialList>\n</GCVF>\n"
    }

    pub(super) fn parse(xml: &str, path: &Path) -> Result<Self, SliceError> {
        // Without a document type there are no entities of the file's own.
        let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
        let document = Document::parse_with_options(xml, options)
            .map_err(|e| SliceError::file(path, format!("is not readable XML: {e}")))?;
        let root = Element { node: document.root_element(), path };
        if !root.node.has_tag_name("GCVF") {
            return Err(SliceError::file(path, "is not that of a GCVF"));
        }
        let version: u32 = root.child("Version")?.number()?;
        if version != 2 {
            let fault = Fault::new(path.display().to_string(), format!("has version {version}"));
            return Err(SliceError::Unsupported(fault.remedy("this release reads 2")));
        }
        let (resolution, size) = (root.child("Resolution")?, root.child("SliceDimensions")?);
        let (range, list) = (root.child("SliceRange")?, root.child("MaterialList")?);
        let material = |node| {
            let m = Element { node, path };
            Ok(ConfigMaterial {
                name: m.child("Name")?.text().to_owned(),
                rgba: m.child("RGBA")?.rgba()?,
                voxels: m.child("VoxelCount")?.number()?,
            })
        };
        let config = Self {
            resolution: Resolution {
                dpi: [resolution.child("XDpi")?.number()?, resolution.child("YDpi")?.number()?],
                layer_nm: resolution.child("SliceThicknessNanoMeter")?.number()?,
            },
            slice_size: [size.child("SliceWidth")?.number()?, size.child("SliceHeight")?.number()?],
            start: range.child("StartIndex")?.number()?,
            slices: range.child("NumberOfSlices")?.number()?,
            max_colors: root.child("MaxNumberOfColors")?.number()?,
            prefix: root.child("ImageFilePrefix")?.text().to_owned(),
            background: list.child("BackGroundMaterialRGBA")?.rgba()?,
            materials: list
                .node
                .children()
                .filter(|n| n.has_tag_name("Material"))
                .map(material)
                .collect::<Result<_, SliceError>>()?,
        };
        config.check(path)?;
        Ok(config)
    }

    fn check(&self, path: &Path) -> Result<(), SliceError> {
        let invalid = |reason: String| Err(SliceError::file(path, reason));
        if self.materials.len() > 255 {
            return invalid(format!("has {} materials, and a grid holds 255", self.materials.len()));
        }
        let mut seen = vec![self.background];
        for m in &self.materials {
            if seen.contains(&m.rgba) {
                return invalid(format!("material {:?} has a colour in use, {:?}", m.name, m.rgba));
            }
            seen.push(m.rgba);
        }
        if self.start.checked_add(self.slices).is_none() {
            return invalid(format!("has {} slices from number {} on", self.slices, self.start));
        }
        Ok(())
    }
}

/// An element, and the file that it is in.
#[derive(Clone, Copy)]
struct Element<'a, 'input> {
    node: Node<'a, 'input>,
    path: &'a Path,
}

impl<'a, 'input> Element<'a, 'input> {
    fn child(self, name: &str) -> Result<Self, SliceError> {
        let mut found = self.node.children().filter(|n| n.has_tag_name(name));
        let parent = self.node.tag_name().name();
        match (found.next(), found.next()) {
            (Some(node), None) => Ok(Self { node, ..self }),
            (None, _) => Err(SliceError::file(self.path, format!("{parent} has no {name}"))),
            _ => Err(SliceError::file(self.path, format!("{parent} has more than one {name}"))),
        }
    }

    fn text(self) -> &'a str {
        self.node.text().unwrap_or_default().trim()
    }

    fn number<T: std::str::FromStr>(self) -> Result<T, SliceError> {
        self.text().parse().map_err(|_| self.wrong("a whole number"))
    }

    fn rgba(self) -> Result<[u8; 4], SliceError> {
        let values: Option<Vec<u8>> = self.text().split_whitespace().map(|v| v.parse().ok()).collect();
        values.and_then(|v| v.try_into().ok()).ok_or_else(|| self.wrong("four numbers from 0 to 255"))
    }

    fn wrong(self, expected: &str) -> SliceError {
        let name = self.node.tag_name().name();
        SliceError::file(self.path, format!("{name} is {:?}, and must be {expected}", self.text()))
    }
}

fn escaped(text: &str) -> String {
    // Characters that XML cannot hold at all stand for nothing in a name either.
    let known = |c: char| !c.is_control();
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .chars()
        .filter(|&c| known(c))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> Config {
        let material = |name: &str, rgba, voxels| ConfigMaterial { name: name.into(), rgba, voxels };
        Config {
            resolution: Resolution { dpi: [600, 300], layer_nm: 27_000 },
            slice_size: [7, 5],
            start: 0,
            slices: 30,
            max_colors: 6,
            prefix: "layer_".into(),
            background: [0, 0, 0, 255],
            materials: vec![
                material("VeroCY-V", [0, 90, 158, 255], 12),
                material("a < b & c", [1, 2, 3, 255], u64::MAX),
            ],
        }
    }

    #[test]
    fn the_text_reads_back_and_errors_name_what_is_wrong() {
        let (path, good) = (Path::new("a.gcvf/ConfigFile.xml"), config().to_xml());
        assert_eq!(Config::parse(&good, path).unwrap(), config());
        for (from, to, words) in [
            ("<Version>2", "<Version>3", "has version 3"),
            ("<XDpi>600</XDpi>", "", "Resolution has no XDpi"),
            ("<XDpi>600</XDpi>", "<XDpi>600</XDpi><XDpi>600</XDpi>", "more than one XDpi"),
            ("<XDpi>600", "<XDpi>600.5", "XDpi is \"600.5\", and must be a whole number"),
            ("<SliceWidth>7", "<SliceWidth>-7", "SliceWidth"),
            ("1 2 3 255", "1 2 3", "four numbers"),
            ("1 2 3 255", "0 90 158 255", "colour in use"),
            ("<StartIndex>0", "<StartIndex>4294967295", "from number 4294967295"),
            ("GCVF>", "GVCF>", "is not that of a GCVF"),
            ("</GCVF>", "", "is not readable XML"),
            (
                "<GCVF>",
                "<!DOCTYPE GCVF [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]><GCVF>",
                "is not readable XML",
            ),
        ] {
            assert!(good.contains(from), "{from}");
            let error = Config::parse(&good.replace(from, to), path).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("ConfigFile.xml"), "{words}: {error}");
        }
        let many = good.replace("<Material>", &format!("{}<Material>", "<x/>".repeat(30_000)));
        assert!(Config::parse(&many, path).is_err());
        let deep = format!("{}{}", "<a>".repeat(15_000), "</a>".repeat(15_000));
        assert!(Config::parse(&deep, path).is_err());
    }
}
