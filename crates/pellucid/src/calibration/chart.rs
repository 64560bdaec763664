//! The chart as voxels and as a table.

use std::fmt::Write as _;

use pellucid_color::calibration::{Patch, Stack};
use pellucid_core::Control;
use pellucid_halftone::{BlueNoiseMask, Thresholds};
use pellucid_slice::PrintTarget;
use pellucid_voxel::{AIR, Channels, Frame, LabelGrid, Material, MaterialTable};

use super::layout::{Area, Layout};
use super::series::{self, BED_MM, Layers};
use crate::PrintError;

/// Most voxels of a chart.
const MAX_VOXELS: f64 = 4e9;

/// Which resins a chart has, by the names of a printer's palette.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartSettings {
    /// The white that inks are measured over.
    pub white: String,
    /// The black that inks are measured over.
    pub black: String,
    /// All others.
    pub inks: Vec<String>,
    /// Seed of the mixtures' halftone.
    pub seed: u64,
}

impl Default for ChartSettings {
    fn default() -> Self {
        let name = str::to_owned;
        Self {
            white: name("white"),
            black: name("black"),
            inks: ["cyan", "magenta", "yellow"].map(name).to_vec(),
            seed: 0,
        }
    }
}

/// A patch and where it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPatch {
    /// Name and layers.
    pub patch: Patch,
    /// Its middle, seen from above with the most cut corner far left: x from the left, y from the far edge, in mm.
    pub center_mm: [f64; 2],
    pub(super) area: Area,
}

/// A plate to print and to measure: 8 by 7 cells, 56 x 49 x 7 mm, for three inks.
///
/// A bed of white 0.81 mm deep lies over black. Patches are 6 mm wide: layers of one resin sunk into the bed, or going
/// through it to the black, all flush. A field of white 6 mm deep is read at nine places.
///
/// ```
/// use pellucid::calibration::{Chart, ChartSettings};
/// use pellucid::slice::PrintTarget;
/// let chart = Chart::new(&PrintTarget::j750(), &ChartSettings::default())?;
/// assert!(chart.table().lines().nth(1).unwrap().starts_with("W1,fit,"));
/// assert_eq!(chart.patches().iter().filter(|p| p.patch.check).count(), 9);
/// # Ok::<(), pellucid::PrintError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Chart {
    settings: ChartSettings,
    patches: Vec<ChartPatch>,
    rows: usize,
    materials: MaterialTable,
    frame: Frame,
}

impl Chart {
    /// For a printer whose palette has all the materials.
    ///
    /// # Errors
    /// [`PrintError::Invalid`] for no ink or names that repeat or cannot stand in a table, [`PrintError::Slice`] for a
    /// material without colour or more of them than the printer takes at once, [`PrintError::Unsupported`] for a pitch
    /// that makes too many voxels.
    pub fn new(printer: &PrintTarget, settings: &ChartSettings) -> Result<Self, PrintError> {
        if settings.inks.is_empty() {
            return Err(PrintError::invalid("chart", "no inks; name at least one besides white and black"));
        }
        let names = settings.inks.iter().chain([&settings.black, &settings.white]);
        // Only names matter: what the materials do is what will be measured.
        let material = |name: &String| Material {
            name: name.clone(),
            sigma_s: vec![0.0],
            sigma_a: vec![0.0],
            g: 0.0.into(),
        };
        let channels = Channels::Named(vec!["unknown".into()]);
        let materials = MaterialTable::over(channels, names.map(material).collect())?;
        pellucid_slice::check_materials(printer, &materials, 1..=materials.len() as u8)?;

        let pitch = printer.pitch();
        let layers = Layers::new(pitch.mm()[2]);
        let mut rest = series::patches(&layers, settings)?.into_iter();
        let layout = Layout::new(rest.len())?;
        let deep = series::deep(&layers, settings)?;
        let mut patches = Vec::new();
        for (i, center_mm) in layout.deep_readings().into_iter().enumerate() {
            let patch = Patch { id: format!("W{}", i + 1), stack: deep.clone(), check: false };
            patches.push(ChartPatch { patch, center_mm, area: layout.deep() });
        }
        for (id, area) in layout.cells() {
            let Some(patch) = rest.next() else { break };
            patches.push(ChartPatch { patch: Patch { id, ..patch }, center_mm: area.center_mm(), area });
        }
        let [width, depth] = layout.size_mm();
        let cells = |mm: f64, axis: usize| (mm / pitch.mm()[axis]).round().max(1.0);
        let (x, y, z) = (cells(width, 0), cells(depth, 1), layers.total());
        if x * y * f64::from(z) > MAX_VOXELS {
            let fault =
                pellucid_core::Fault::new("printer, pitch", format!("{x} x {y} x {z} voxels of a chart"));
            return Err(PrintError::Unsupported(fault.remedy("take a coarser pitch")));
        }
        let frame = Frame::new([0.0; 3], pitch, [x as u32, y as u32, z])?;
        let rows = layout.rows();
        Ok(Self { settings: settings.clone(), patches, rows, materials, frame })
    }

    /// The patches: readings of the deep white, then cell by cell.
    pub fn patches(&self) -> &[ChartPatch] {
        &self.patches
    }

    /// Which label stands for which material; their coefficients are not known yet, and 0.
    pub fn materials(&self) -> &MaterialTable {
        &self.materials
    }

    /// The settings.
    pub fn settings(&self) -> &ChartSettings {
        &self.settings
    }

    pub(super) fn layout(&self) -> Layout {
        Layout::of_rows(self.rows)
    }

    /// The voxels. The chart lies flat; y grows towards the far edge.
    ///
    /// # Errors
    /// [`PrintError::Cancelled`].
    pub fn grid(&self, control: &Control<'_>) -> Result<LabelGrid, PrintError> {
        let mask = BlueNoiseMask::new(self.frame.pitch(), self.settings.seed, control)?;
        let layout = self.layout();
        let columns = Columns::new(self)?;
        let [width, height, depth] = self.frame.size();
        let mm = self.frame.pitch().mm();
        // Which column of layers each place has: one look-up a place, not a voxel.
        let kinds: Vec<u16> = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| {
                let at = [(f64::from(x) + 0.5) * mm[0], (f64::from(height - y) - 0.5) * mm[1]];
                columns.kind_at(self, &layout, at)
            })
            .collect();
        control.check()?;
        Ok(LabelGrid::from_fn(self.frame, |[x, y, z]| {
            let kind = kinds[(y * width + x) as usize];
            columns.label(kind, depth - 1 - z, || mask.threshold([x, y, z]))
        }))
    }

    /// The table to fill: patch, use, place, layers, and empty L\*a\*b\*.
    pub fn table(&self) -> String {
        let mut text = String::from("patch,use,x_mm,y_mm,stack,LAB_L,LAB_A,LAB_B\n");
        for ChartPatch { patch: Patch { id, stack, check }, center_mm: [x, y], .. } in &self.patches {
            let used = if *check { "check" } else { "fit" };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{id},{used},{x:.2},{y:.2},{},,,", quoted(stack));
        }
        text
    }
}

/// A cell of a table; names may have commas.
fn quoted(stack: &Stack) -> String {
    let text = stack.to_string();
    if text.contains([',', '"', ';']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// Layers from the top, by kind of place.
struct Columns {
    /// Air, margin, bed, then patches.
    stacks: Vec<Vec<Piece>>,
    /// What lies below all layers.
    black: u8,
}

/// Layers down to a depth (in layers) with the labels and thresholds of their mixture.
struct Piece {
    down_to: u32,
    labels: Vec<u8>,
    thresholds: Vec<u16>,
}

const OUTSIDE: u16 = 0;
const MARGIN: u16 = 1;
const BED: u16 = 2;
const FIRST_PATCH: u16 = 3;

impl Columns {
    fn new(chart: &Chart) -> Result<Self, PrintError> {
        let layers = Layers::new(chart.frame.pitch().mm()[2]);
        let label = |name: &str| chart.materials.label_of(name).unwrap_or(AIR);
        let (white, black) = (label(&chart.settings.white), label(&chart.settings.black));
        let pure =
            |label, mm| Piece { down_to: layers.count(mm), labels: vec![label], thresholds: Vec::new() };
        let mut stacks = vec![Vec::new(), Vec::new(), vec![pure(white, BED_MM)]];
        for patch in &chart.patches {
            let mut pieces = Vec::new();
            let mut down_to = 0;
            for layer in patch.patch.stack.layers().iter().filter(|l| l.thickness_mm().is_finite()) {
                down_to += layers.count(layer.thickness_mm());
                let labels: Vec<u8> = layer.parts().iter().map(|(name, _)| label(name)).collect();
                let fractions: Vec<f32> = layer.parts().iter().map(|(_, share)| *share as f32).collect();
                let mut thresholds = vec![0; labels.len() - 1];
                Thresholds::write(&fractions, &mut thresholds);
                pieces.push(Piece { down_to, labels, thresholds });
            }
            stacks.push(pieces);
        }
        Ok(Self { stacks, black })
    }

    fn kind_at(&self, chart: &Chart, layout: &Layout, at_mm: [f64; 2]) -> u16 {
        if layout.is_cut(at_mm) {
            return OUTSIDE;
        }
        if !layout.bed().contains(at_mm) {
            return MARGIN;
        }
        chart
            .patches
            .iter()
            .position(|patch| patch.area.contains(at_mm))
            .map_or(BED, |i| FIRST_PATCH + i as u16)
    }

    /// The label at a depth in layers, 0 at the top.
    fn label(&self, kind: u16, depth: u32, threshold: impl Fn() -> f32) -> u8 {
        if kind == OUTSIDE {
            return AIR;
        }
        let piece = self.stacks[usize::from(kind)].iter().find(|piece| depth < piece.down_to);
        match piece {
            None => self.black,
            Some(piece) if piece.labels.len() == 1 => piece.labels[0],
            Some(piece) => piece.labels[Thresholds::choose(&piece.thresholds, threshold())],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wide voxels and thin layers.
    fn printer(max_materials: u32) -> PrintTarget {
        let text = r#"{"name": "coarse", "pitch_mm": [0.25, 0.3, 0.03], "build_space_mm": [400, 400, 200],
            "max_materials": 6, "min_layers": 1, "row_order": "highest_y_first", "background": [0, 0, 0, 0],
            "palette": {"cyan": [0, 90, 158, 255], "magenta": [166, 33, 98, 255], "yellow": [200, 189, 3, 255],
            "black": [26, 26, 29, 255], "white": [240, 240, 240, 255]}}"#;
        PrintTarget::from_json(text).unwrap().with_max_materials(max_materials).unwrap()
    }

    #[test]
    fn voxels_are_what_the_table_says() {
        let chart = Chart::new(&printer(6), &ChartSettings::default()).unwrap();
        let grid = chart.grid(&Control::none()).unwrap();
        let [_, height, depth] = grid.size();
        let [dx, dy, dz] = grid.frame().pitch().mm();
        let table = Patch::parse_chart(&chart.table()).unwrap();
        assert_eq!(table.len(), chart.patches().len());
        for (row, placed) in table.iter().zip(chart.patches()) {
            assert_eq!((&row.id, row.check), (&placed.patch.id, placed.patch.check));
            let [x, y] = [(placed.center_mm[0] / dx) as u32, height - 1 - (placed.center_mm[1] / dy) as u32];
            let mut z = depth;
            for layer in row.stack.layers() {
                let count = match layer.thickness_mm() {
                    mm if mm.is_finite() => (mm / dz).round() as u32,
                    _ => z,
                };
                // In a mixture, the shares of the 2 mm about the middle.
                let (mut found, mut total) = (vec![0.0; layer.parts().len()], 0.0);
                for at in z - count..z {
                    for off in 0..64 {
                        let label = grid.get([x + off % 8 - 4, y + off / 8 - 4, at]);
                        let name = &chart.materials().get(label).unwrap().name;
                        let part = layer.parts().iter().position(|(n, _)| n == name);
                        found[part.unwrap_or_else(|| panic!("{}: {name} at {at}", row.id))] += 1.0;
                        total += 1.0;
                    }
                }
                for ((name, share), found) in layer.parts().iter().zip(found) {
                    assert!((found / total - share).abs() < 0.02, "{}: {name} {}", row.id, found / total);
                }
                z -= count;
            }
            assert_eq!(z, 0, "{}", row.id);
        }
    }

    #[test]
    fn a_mirrored_print_cannot_be_turned_to_look_right() {
        let chart = Chart::new(&printer(6), &ChartSettings::default()).unwrap();
        let grid = chart.grid(&Control::none()).unwrap();
        let [width, height, depth] = grid.size();
        let cut = |right: bool, near: bool| {
            let at = |step: u32| {
                let x = if right { width - 1 - step } else { step };
                let y = if near { 0 } else { height - 1 };
                grid.get([x, y, depth - 1])
            };
            (0..20).take_while(|&step| at(step) == AIR).count()
        };
        let corners = [cut(false, false), cut(true, false), cut(true, true), cut(false, true)];
        assert!(corners[0] > corners[1] && corners[1] > 0 && corners[2..] == [0, 0], "{corners:?}");
    }

    #[test]
    fn printers_and_names_that_do_not_fit_are_told() {
        let inks = |names: &[&str]| ChartSettings {
            inks: names.iter().map(|&n| n.to_owned()).collect(),
            ..ChartSettings::default()
        };
        let told = |printer: &PrintTarget, settings: &ChartSettings, part: &str| {
            let error = pellucid_core::chain(&Chart::new(printer, settings).unwrap_err());
            assert!(error.contains(part), "{error}");
        };
        told(&printer(3), &ChartSettings::default(), "5 are needed");
        told(&printer(6), &inks(&["gold"]), "gold");
        told(&printer(6), &inks(&[]), "no inks");
        told(&printer(6), &inks(&["cyan", "cyan"]), "used twice");
        told(&printer(6), &inks(&["white"]), "used twice");
        assert!(Chart::new(&printer(3), &inks(&["cyan"])).is_ok());
        let stop = std::sync::atomic::AtomicBool::new(true);
        let chart = Chart::new(&printer(6), &ChartSettings::default()).unwrap();
        let stopped = chart.grid(&Control::none().with_cancel(&stop));
        assert!(matches!(stopped, Err(PrintError::Cancelled)));
    }
}
