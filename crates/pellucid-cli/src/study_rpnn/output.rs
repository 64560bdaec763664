//! The study's table and text.

use std::fmt::Write;

use pellucid::predictor::Sharing;
use pellucid::rpnn::variant::LEVELS;

use super::Candidate;
use super::scores::Row;

/// Paths that plain tracing traces in the time of a network, by the time of the most paths measured.
pub fn equal_time_paths(rows: &[Row], network: &str) -> f64 {
    let whole = || rows.iter().filter(|r| r.class.is_none());
    let ours = whole().find(|r| r.predictor == network);
    let most = whole().max_by_key(|r| r.spp);
    match (ours, most) {
        (Some(ours), Some(most)) => f64::from(most.spp) * ours.microseconds / most.microseconds,
        _ => 1.0,
    }
}

/// All rows as comma-separated values.
pub fn csv(rows: &[Row]) -> String {
    let mut out =
        String::from("set,class,predictor,paths,microseconds_a_sample,samples,rmse,bias,p95,mean_de2000\n");
    for r in rows {
        let class = r.class.map_or("all".to_owned(), |c| format!("{c:?}"));
        let _ = writeln!(
            out,
            "{},{class},\"{}\",{},{:.3},{},{:.5},{:.5},{:.5},{:.3}",
            r.set, r.predictor, r.spp, r.microseconds, r.samples, r.rmse, r.bias, r.p95, r.delta_e
        );
    }
    out
}

/// The report.
pub fn markdown(rows: &[Row], candidates: &[Candidate], pictures: &[(String, String, f64)]) -> String {
    let mut out = String::from(
        "# Network and Monte Carlo on held-out volumes\n\n\
         Written by `pellucid study rpnn`. A sample is one surface point in one channel. RMSE and bias are in linear \
         radiance, 0 to 1, the labels' own variance taken out of the RMSE; dE2000 is the mean over points relative to \
         the print's white, label noise included. Times are processor time on one thread; a network's contains the \
         extraction of its stencils, not the summed-area table. ",
    );
    let Sharing { fine_levels, block } = Sharing::default();
    let _ = write!(
        out,
        "\"Coarse levels shared\" is the network as prints use it: the points of a block of {block} x {block} x \
         {block} voxels share what it makes of the {} coarsest levels. ",
        LEVELS - fine_levels
    );
    out.push_str(
        "Monte Carlo is this project's vectorised tracer, timed at its largest number of paths and in proportion \
         below.\n\n",
    );
    for c in candidates {
        let _ = writeln!(
            out,
            "- {}: {} parameters. {}",
            c.name,
            c.weights.variant().parameters(),
            c.provenance.history
        );
    }
    let mut sets: Vec<&str> = rows.iter().map(|r| r.set.as_str()).collect();
    sets.dedup();
    for set in &sets {
        let of_set: Vec<&Row> = rows.iter().filter(|r| r.set == *set).collect();
        let samples = of_set.first().map_or(0, |r| r.samples);
        let _ = writeln!(out, "\n## {set}: {samples} samples\n");
        out.push_str("| predictor | us a sample | RMSE | bias | 95 % below | mean dE2000 |\n| --- | ---: | ---: | ---: | ---: | ---: |\n");
        for r in of_set.iter().filter(|r| r.class.is_none()) {
            let _ = writeln!(
                out,
                "| {} | {:.1} | {:.4} | {:+.4} | {:.4} | {:.2} |",
                r.predictor, r.microseconds, r.rmse, r.bias, r.p95, r.delta_e
            );
        }
    }
    out.push_str("\n## By shape, at equal time\n\nThe first network as prints use it; `rpnn.csv` has all. Monte Carlo's RMSE is scaled from its largest number of paths to the network's time of the set, as the inverse root of the number of paths.\n\n| set | shape | samples | network's RMSE | Monte Carlo paths in its time | their RMSE |\n| --- | --- | ---: | ---: | ---: | ---: |\n");
    for set in &sets {
        let of_set: Vec<&Row> = rows.iter().filter(|r| r.set == *set).collect();
        let most = of_set.iter().map(|r| r.spp).max().unwrap_or(0);
        let whole = of_set.iter().find(|r| r.class.is_none() && r.spp == most);
        for r in of_set.iter().filter(|r| candidates.first().is_some_and(|c| c.name_in_use() == r.predictor))
        {
            let mc = of_set.iter().find(|m| m.class == r.class && m.spp == most);
            let (Some(whole), Some(mc)) = (whole, mc) else { continue };
            let paths = f64::from(most) * r.microseconds / whole.microseconds;
            let _ = writeln!(
                out,
                "| {set} | {} | {} | {:.4} | {:.0} | {:.4} |",
                r.class.map_or("all".to_owned(), |c| format!("{c:?}")),
                r.samples,
                r.rmse,
                paths,
                mc.rmse * (f64::from(most) / paths).sqrt()
            );
        }
    }
    if !pictures.is_empty() {
        out.push_str("\n## Pictures\n\nFrom the left: reference (1024 paths), prediction, its error. Rows: the networks in the order above, then Monte Carlo in the first one's time. Errors are the mean over channels: red too light, blue too dark, full colour at 0.1.\n");
        for (file, set, paths) in pictures {
            let _ = write!(
                out,
                "\nA volume of {set}; {paths:.0} paths take the first network's time:\n\n![{set}]({file})\n"
            );
        }
    }
    out
}
