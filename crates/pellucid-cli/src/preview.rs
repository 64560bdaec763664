//! `pellucid preview`: what a model will look like before anything is refined.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use pellucid::core::memory::peak_bytes;
use pellucid::job::{PreviewReport, ProofFiles};
use pellucid::{Monitor, PredictorKind, PrintJob};

use crate::progress::Bars;
use crate::subject::Subject;
use crate::{Failure, terminal};

/// Share of the surface from which a warning is worth a line.
const WORTH_TELLING: f64 = 0.01;

/// Arguments of `pellucid preview`.
#[derive(clap::Args)]
#[command(args_override_self = true)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Folder to create: preview.html, preview.png, preview.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace an output folder of an earlier preview
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    args.subject.use_threads()?;
    let (mut settings, earlier) = args.subject.settings()?;
    // Nothing is refined, so nothing is to be chosen.
    if settings.predictor == PredictorKind::Auto {
        settings.predictor = PredictorKind::MonteCarlo;
    }
    let job = PrintJob::new(settings)?;
    job.check_preview_output(&args.out, args.force)?;
    let bars = Bars::new();
    let model = args.subject.import(job.settings().clear_from_alpha, earlier.as_ref(), &bars)?;
    let monitor = Monitor::new(&bars, cancel).with_peak_memory(peak_bytes);
    let files = ProofFiles { html: ProofFiles::built().html, glb: false };
    let mut force = args.force;
    let preview = job.preview(
        &model,
        |coarse, monitor| {
            let report = coarse.write(files, &args.out, force, monitor)?;
            // The finer one takes the place of this one.
            force = true;
            let [x, ..] = report.pitch_mm;
            let place = args.out.display();
            terminal::note(format!(
                "a coarse preview, by voxels of {x:.2} mm, is in {place}; a finer one follows"
            ));
            Ok(())
        },
        &monitor,
    )?;
    let report = preview.write(files, &args.out, force, &monitor)?;
    terminal::print(&summary(&report, &args.out))?;
    Ok(())
}

/// What a user looks for first.
fn summary(report: &PreviewReport, out: &Path) -> String {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let [x, y, z] = report.extent_mm;
    let mut text = format!(
        "{x:.1} x {y:.1} x {z:.1} mm, {} surface voxels\n\
         unrefined, off the texture by {:.2} dE2000 (mean over 0.1 mm): {} out of gamut, {} too thin, {} cross-talk\n",
        report.surface_voxels,
        report.error.mean,
        percent(report.shares.out_of_gamut),
        percent(report.shares.too_thin),
        percent(report.shares.cross_talk),
    );
    if report.out_of_gamut > WORTH_TELLING {
        let share = percent(report.out_of_gamut);
        text += &format!("{share} of the surface asks for a colour that cannot be printed there\n");
    }
    if report.thin.below_1_mm > WORTH_TELLING {
        let share = percent(report.thin.below_1_mm);
        text += &format!("{share} of the surface lies on less than 1 mm of material\n");
    }
    text + &format!("wrote {}\n", out.display())
}
