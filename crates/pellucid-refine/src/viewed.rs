//! What a print looks like in several viewings.

use pellucid_core::{Control, ErrorStats};
use pellucid_voxel::Surface;

use crate::difference::{differences, lab_of};
use crate::problem::shown_in;
use crate::{Aim, RefineError, SurfaceSmoother};

/// Standard deviation in mm of the Gaussian after which errors are taken: what a viewer at 300 mm sees.
const VIEWED_MM: f64 = 0.1;

/// Errors of one appearance in several viewings, in CIEDE2000 after smoothing over 0.1 mm of surface.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Viewed {
    /// By viewing, to the printable target.
    pub errors: Vec<ErrorStats>,
    /// By viewing, from what is shown in the first viewing: colour inconstancy. The first is 0.
    pub inconstancy: Vec<ErrorStats>,
    /// By viewing, the same of the printable targets: a smooth reflectance too changes its colour a little.
    pub wanted_inconstancy: Vec<ErrorStats>,
    /// The inconstancy at every surface voxel, by viewing.
    pub maps: Vec<Vec<f32>>,
    /// The smoothed colours, linear RGB relative to the print's white, by viewing.
    pub shown: Vec<Vec<[f32; 3]>>,
}

impl Viewed {
    /// Looks at radiances of all surface voxels, `[point][channel]`; their noise counts as error.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when radiances or targets are not as many as voxels; [`RefineError::Cancelled`].
    pub fn of(
        surface: &Surface,
        aims: &[Aim<'_>],
        radiance: &[f32],
        control: &Control<'_>,
    ) -> Result<Self, RefineError> {
        let smoother = SurfaceSmoother::new(surface, VIEWED_MM, control)?;
        let mut found = Self::default();
        let mut first: Option<[Vec<[f32; 3]>; 2]> = None;
        for aim in aims {
            let points = surface.len();
            if radiance.len() != points * aim.viewing.channels() || aim.printable_target.len() != points {
                return Err(RefineError::invalid(
                    "radiance",
                    format!(
                        "{} values, target of {} for {points} surface voxels of {} channels",
                        radiance.len(),
                        aim.printable_target.len(),
                        aim.viewing.channels()
                    ),
                ));
            }
            let smooth = |colors: Vec<[f32; 3]>| smoother.smooth(colors, control);
            let shown = smooth(shown_in(aim.viewing, radiance))?;
            let own = [lab_of(&shown), lab_of(&smooth(aim.printable_target.to_vec())?)];
            found.errors.push(ErrorStats::of(differences(&own[0], &own[1])));
            let [shown_first, wanted_first] = first.get_or_insert_with(|| own.clone());
            let map = differences(&own[0], shown_first);
            found.inconstancy.push(ErrorStats::of(map.clone()));
            found.wanted_inconstancy.push(ErrorStats::of(differences(&own[1], wanted_first)));
            found.maps.push(map);
            found.shown.push(shown);
        }
        Ok(found)
    }
}
