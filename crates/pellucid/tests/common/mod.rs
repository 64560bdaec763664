//! What tests of whole jobs share.

use pellucid::PrintSettings;
use pellucid::refine::Effort;

/// As few paths, points and iterations as a job can do with.
pub fn quick() -> PrintSettings {
    let mut settings = PrintSettings {
        spp: Some(4),
        judge: Effort { points: 100, point_passes: 2, surface_passes: 2 },
        judge_spp: 2,
        judge_point_spp: 16,
        proof_edge: 32,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(2);
    settings.descent.opening_steps = 1;
    settings
}
