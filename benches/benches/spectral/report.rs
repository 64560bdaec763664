//! Tables and plot of the study.

use pellucid_benches::study::{Axis, Panel, Plot, Series, Table};

use super::LIGHTS;
use super::compensation::Run;
use super::metamers::Ring;
use super::patches::Patch;
use super::prediction::{Bands, Cost};

/// All that was measured.
#[derive(Default)]
pub struct Found {
    pub rings: Vec<Ring>,
    pub costs: Vec<Cost>,
    pub bands: Vec<Bands>,
    pub patches: Vec<Patch>,
    pub lights: Vec<Run>,
}

impl Found {
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        if !self.rings.is_empty() {
            text += "## What mixtures allow\n\nThick blocks of homogeneous mixtures that give a colour under D65 within 0.5 \
                     CIEDE2000, with as little black as can be, as the separation chooses by default, and with as much \
                     as can be: share of black, and inconstancy from D65 to A. Means over colours of one chroma, of \
                     lightness 20 to 90. The last column is the bound for whatever chooses among equal mixtures.\n\n";
            text += &self.ring_table().markdown();
        }
        if !self.costs.is_empty() {
            text += "\n## Cost\n\nProcessor time a point, all channels together, on the unrefined halftone; root mean square error (mean over \
                     channels) and mean dE2000 under each light against 512 paths of every band, whose noise is taken out of the \
                     first only.\n\n";
            text += &self.cost_table().markdown();
        }
        if !self.bands.is_empty() {
            text += "\n## Held-out volumes\n\nRoot mean square error against 512 paths, their noise taken out, on volumes of the \
                     test set: mean over channels, and by band (the plot).\n\n";
            text += &self.band_table().markdown();
        }
        if !self.patches.is_empty() {
            text += "\n## Patches\n\nMean spectra within 0.15 mm of six surface voxels of the unrefined jug, named by their target's colour, by the network and by \
                     512 paths: root mean square difference over bands, and dE2000 under each light.\n\n";
            text += &self.patch_table().markdown();
            text += "\n![Spectra of patches](patches.svg)\n";
        }
        if !self.lights.is_empty() {
            text += "\n## Refining for several lights\n\nMean dE2000 over 0.1 mm of surface: to what the print should look like \
                     under each light, and from its look under D65 (inconstancy). Black is its share among the four inks. \
                     Columns of the pictures: D65, A, LED, F11, and inconstancy to A from 0 (dark violet) to 8 (light yellow); \
                     rows: refined for D65; for D65 and A; for D65, A and LED.\n\n";
            text += &self.light_table().markdown();
            let mut pictured: Vec<&str> =
                self.lights.iter().filter_map(|run| run.object.split(' ').next()).collect();
            pictured.dedup();
            for stem in pictured {
                text += &format!("\n![{stem} under four lights](lights-{stem}.png)\n");
            }
        }
        text
    }

    fn ring_table(&self) -> Table {
        let mut table = Table::new(&[
            ">chroma",
            ">colours",
            ">black, least",
            ">default",
            ">most",
            ">inconstancy, least black",
            ">default",
            ">most black",
            ">least of all",
        ]);
        for ring in &self.rings {
            let mut cells = vec![format!("{:.0}", ring.chroma), ring.colours.to_string()];
            cells.extend(ring.black.iter().chain(&ring.inconstancy).map(|v| format!("{v:.2}")));
            cells.push(format!("{:.2}", ring.least));
            table.row(cells);
        }
        table
    }

    fn cost_table(&self) -> Table {
        let mut table = Table::new(&[
            "object",
            ">points",
            "predictor",
            ">µs a point",
            ">over R, G, B",
            ">RMSE",
            ">dE D65",
            ">A",
            ">LED",
            ">F11",
        ]);
        for cost in &self.costs {
            let mut cells = vec![
                cost.object.clone(),
                cost.points.to_string(),
                cost.predictor.clone(),
                format!("{:.1}", cost.microseconds),
                format!("{:.2}", cost.over_rgb),
                format!("{:.4}", cost.rmse),
            ];
            for i in 0..LIGHTS.len() {
                cells.push(cost.delta_e.get(i).map_or(String::new(), |de| format!("{de:.2}")));
            }
            table.row(cells);
        }
        table
    }

    fn band_table(&self) -> Table {
        let mut table = Table::new(&["predictor", ">RMSE, mean", ">least", ">greatest"]);
        for bands in &self.bands {
            let values = || bands.rmse.iter().map(|(_, v)| *v);
            let mean = values().sum::<f64>() / bands.rmse.len().max(1) as f64;
            let (least, most) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
            table.row(
                [bands.predictor.clone()].into_iter().chain([mean, least, most].map(|v| format!("{v:.4}"))),
            );
        }
        table
    }

    fn patch_table(&self) -> Table {
        let mut table = Table::new(&["patch", ">points", ">RMSE", ">dE D65", ">A", ">LED", ">F11"]);
        for patch in &self.patches {
            let squares = patch.paths.iter().zip(&patch.network).map(|(a, b)| (a - b) * (a - b));
            let rmse = (squares.sum::<f64>() / patch.paths.len().max(1) as f64).sqrt();
            let mut cells = vec![patch.name.to_owned(), patch.points.to_string(), format!("{rmse:.4}")];
            cells.extend(patch.delta_e.iter().map(|de| format!("{de:.2}")));
            table.row(cells);
        }
        table
    }

    fn light_table(&self) -> Table {
        let mut table = Table::new(&[
            "object",
            ">points",
            "refined for",
            ">dE D65",
            ">A",
            ">LED",
            ">F11",
            ">inconstancy A",
            ">LED",
            ">F11",
            ">black",
            ">s",
        ]);
        let mut wanted: Option<&str> = None;
        for run in &self.lights {
            let number = |v: f64| format!("{v:.2}");
            let head = |what: String| vec![run.object.clone(), run.points.to_string(), what];
            if wanted != Some(&run.object) {
                wanted = Some(&run.object);
                let mut cells = head("(the target itself)".to_owned());
                cells.extend((0..LIGHTS.len()).map(|_| String::new()));
                cells.extend(run.wanted[1..].iter().map(|e| number(e.mean)));
                cells.extend([String::new(), String::new()]);
                table.row(cells);
            }
            let names: Vec<&str> = run.lights.iter().map(|light| light.name()).collect();
            let mut cells = head(if names.is_empty() { "(unrefined)".to_owned() } else { names.join(", ") });
            cells.extend(run.errors.iter().map(|e| number(e.mean)));
            cells.extend(run.inconstancy[1..].iter().map(|e| number(e.mean)));
            cells.extend([number(run.black), format!("{:.0}", run.seconds)]);
            table.row(cells);
        }
        table
    }

    /// Errors by band.
    pub fn table(&self) -> Table {
        let mut table = Table::new(&["predictor", "channel", ">rmse"]);
        for bands in &self.bands {
            for (channel, rmse) in &bands.rmse {
                table.row([bands.predictor.clone(), channel.clone(), format!("{rmse:.5}")]);
            }
        }
        table
    }

    pub fn plot(&self) -> Plot {
        let nm = |name: &str| name.strip_suffix(" nm").and_then(|n| n.parse::<f64>().ok());
        let series: Vec<Series> = self
            .bands
            .iter()
            .filter(|bands| bands.rmse.len() > 3)
            .map(|bands| Series {
                name: bands.predictor.trim_start_matches("31 bands: ").to_owned(),
                points: bands.rmse.iter().filter_map(|(name, v)| Some([nm(name)?, *v])).collect(),
            })
            .collect();
        let heights: Vec<f64> = series.iter().flat_map(|s| s.points.iter().map(|p| p[1])).collect();
        Plot {
            x: Axis { title: "wavelength, nm".into(), range: [400.0, 700.0] },
            y: Axis::around("RMSE", heights),
            panels: vec![Panel { title: "held-out volumes".into(), series }],
        }
    }
}

/// Radiance by wavelength, a panel a patch.
pub fn spectra(patches: &[Patch]) -> Plot {
    let series = |name: &str, nm: &[f64], radiance: &[f64]| Series {
        name: name.to_owned(),
        points: nm.iter().zip(radiance).map(|(&nm, &v)| [nm, v]).collect(),
    };
    Plot {
        x: Axis { title: "wavelength, nm".into(), range: [400.0, 700.0] },
        y: Axis { title: "radiance".into(), range: [0.01, 1.0] },
        panels: patches
            .iter()
            .map(|patch| Panel {
                title: patch.name.to_owned(),
                series: vec![
                    series("512 paths", &patch.nm, &patch.paths),
                    series("network", &patch.nm, &patch.network),
                ],
            })
            .collect(),
    }
}
