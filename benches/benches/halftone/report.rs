//! Tables, plot and pictures of the study.

use std::path::Path;

use pellucid::proof::{Picture, contact_sheet};
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::Row;
use super::grain::{Look, VIEWED_MM};
use super::plate::Plate;

/// Pixels across the picture of a plate.
const EDGE: u32 = 200;

pub fn cells(row: &Row) -> Vec<String> {
    let mut cells = vec![row.plate.to_owned(), row.color.to_owned(), row.method.to_owned()];
    cells.extend(row.grain.map(|v| format!("{v:.2}")));
    cells.extend([
        format!("{:.2}", row.shift),
        format!("{:.1}", row.flips),
        format!("{:.1}", row.rate / 1e6),
    ]);
    cells
}

const FIGURES: [&str; 6] = [">grain 0.045 mm", ">0.1 mm", ">0.2 mm", ">mean off by", ">flips", ">M voxels/s"];

pub fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[&["plate", "colour", "method"][..], &FIGURES].concat());
    rows.iter().for_each(|row| table.row(cells(row)));
    table
}

/// Names of a column in the order that they come in.
fn names(rows: &[Row], of: impl Fn(&Row) -> &'static str) -> Vec<&'static str> {
    let mut names = Vec::new();
    for row in rows {
        if !names.contains(&of(row)) {
            names.push(of(row));
        }
    }
    names
}

/// Means over colours: of squares for the grain.
fn mean(rows: &[&Row]) -> ([f64; 3], [f64; 3]) {
    let n = rows.len().max(1) as f64;
    let sum = |of: &dyn Fn(&Row) -> f64| rows.iter().map(|row| of(row)).sum::<f64>() / n;
    let grain = std::array::from_fn(|i| sum(&|row| row.grain[i].powi(2)).sqrt());
    (grain, [sum(&|row| row.shift), sum(&|row| row.flips), sum(&|row| row.rate)])
}

pub fn markdown(rows: &[Row]) -> String {
    let mut means = Table::new(&[&["plate", "method"][..], &FIGURES].concat());
    let mut add = |plate: &str, method: &str, some: &[&Row]| {
        let (grain, [shift, flips, rate]) = mean(some);
        let mut cells = vec![plate.to_owned(), method.to_owned()];
        cells.extend(grain.map(|v| format!("{v:.2}")));
        cells.extend([format!("{shift:.2}"), format!("{flips:.1}"), format!("{:.1}", rate / 1e6)]);
        means.row(cells);
    };
    let methods = names(rows, |row| row.method);
    for plate in names(rows, |row| row.plate) {
        for method in &methods {
            let some: Vec<&Row> =
                rows.iter().filter(|row| row.plate == plate && row.method == *method).collect();
            add(plate, method, &some);
        }
    }
    for method in &methods {
        let some: Vec<&Row> = rows.iter().filter(|row| row.method == *method).collect();
        add("(all)", method, &some);
    }
    format!(
        "A white plate whose upper 0.5 mm is one mixture, halftoned, against a plate of the homogeneous mixture. Grain: root \
         mean square Lab difference of the points seen, less its mean, over Gaussians of the surface, the paths' noise \
         taken out. Mean off by: CIEDE2000 of the mean colours. Flips: voxels that 2 % more of every ink changes, over the \
         fewest that could. Rates are of one thread, by what makes the whole plate.\n\n{}\n## By colour\n\n{}\n\
         Columns of the picture are plates in grey and skin, rows the methods in the table's order.\n\n\
         ![Plates](plates.png)\n",
        means.markdown(),
        table(rows).markdown()
    )
}

/// Grain by Gaussian, a panel a plate.
pub fn plot(rows: &[Row]) -> Plot {
    let methods = names(rows, |row| row.method);
    let panel = |plate: &'static str| {
        let of = |method: &&'static str| {
            let some: Vec<&Row> =
                rows.iter().filter(|row| row.plate == plate && row.method == *method).collect();
            let (grain, _) = mean(&some);
            let points = VIEWED_MM.iter().zip(grain).map(|(&mm, grain)| [mm, grain]).collect();
            Series { name: (*method).to_owned(), points }
        };
        Panel { title: plate.to_owned(), series: methods.iter().map(of).collect() }
    };
    let panels: Vec<Panel> = names(rows, |row| row.plate).into_iter().map(panel).collect();
    let drawn = panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.points);
    Plot {
        x: Axis { title: "Gaussian, mm".into(), range: [0.03, 0.3] },
        y: Axis::around("grain, Lab", drawn.map(|point| point[1])),
        panels,
    }
}

/// `plates.png`.
pub fn pictures(folder: &Path, looks: &[Vec<Look>], control: &Control<'_>) -> Result<(), Error> {
    let rows: Vec<Vec<Picture>> = looks
        .iter()
        .map(|looks| looks.iter().map(picture).collect::<Result<_, _>>())
        .collect::<Result<_, Error>>()?;
    contact_sheet(&rows, control)?.write_png(folder.join("plates.png"), control)?;
    Ok(())
}

/// The nearest point seen, pixel by pixel.
fn picture(look: &Look) -> Result<Picture, Error> {
    let half = Plate::half_seen_mm();
    let mut rgba = Vec::with_capacity((EDGE * EDGE * 4) as usize);
    for y in 0..EDGE {
        for x in 0..EDGE {
            let at = [x, y].map(|i| ((f64::from(i) + 0.5) / f64::from(EDGE) * 2.0 - 1.0) * half);
            let squared = |p: &[f64; 2]| (p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2);
            let nearest = look.raw.iter().min_by(|a, b| squared(&a.0).total_cmp(&squared(&b.0)));
            let [r, g, b] = nearest.map_or([0.0; 3], |p| p.1);
            rgba.extend([r, g, b, 1.0]);
        }
    }
    Ok(Picture::new(EDGE, EDGE, rgba)?)
}
