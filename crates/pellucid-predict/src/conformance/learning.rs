//! What a pass learned is taken in once, and can be saved.

use super::{Case, DRAW, Trial, Violation};
use crate::{Draw, Learned, Pass, Predictor};

/// Absorbing a pass twice is absorbing it once, it changes nothing but later predictions, and the memory of two passes
/// restores a predictor bound anew, byte for byte. A predictor that learns nothing says so, and refuses what others
/// learned.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn learning(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "learning", predictor, case };
    let mut bound = trial.fresh(&case.labels)?;
    trial.ensure(bound.memory().is_empty(), "it remembers something before it learned anything")?;
    trial.worked("absorbing nothing", bound.absorb(&Learned::default()))?;
    let foreign = Learned {
        predictor: "somebody else".into(),
        passes: vec![0],
        values: vec![1.0, 2.0],
        ..Learned::default()
    };
    trial.ensure(bound.absorb(&foreign).is_err(), "it absorbed what another predictor learned")?;
    let (before, seen) = trial.predict(&*bound, &case.points, DRAW)?;
    if seen.learned.is_empty() {
        return trial.ensure(bound.memory().is_empty(), "it remembers what no pass learned");
    }
    trial.ensure(bound.memory().is_empty(), "it learned without being told to")?;
    trial.ensure(
        seen.learned.passes == [DRAW.pass.number()],
        format!("a pass learned as {:?}", seen.learned.passes),
    )?;

    trial.worked("absorbing a pass", bound.absorb(&seen.learned))?;
    let once = bound.memory();
    trial.worked("absorbing it again", bound.absorb(&seen.learned))?;
    trial.ensure(bound.memory() == once, "a pass was absorbed twice")?;
    let next = Draw::new(DRAW.seed, Pass::Loop(3));
    let (_, second) = trial.predict(&*bound, &case.points, next)?;
    trial.worked("absorbing a second pass", bound.absorb(&second.learned))?;
    let memory = bound.memory();
    trial.ensure(memory != once, "the second pass left no trace")?;
    trial.worked("absorbing the first pass late", bound.absorb(&seen.learned))?;
    trial.worked("absorbing its own memory", bound.absorb(&memory))?;
    trial.ensure(bound.memory() == memory, "passes were absorbed twice")?;

    let mut restored = trial.fresh(&case.labels)?;
    trial.worked("absorbing a memory", restored.absorb(&memory))?;
    trial.ensure(restored.memory() == memory, "a memory did not survive a round trip")?;
    let third = Draw::new(DRAW.seed, Pass::Loop(4));
    let (expected, learned) = trial.predict(&*bound, &case.points, third)?;
    let (values, relearned) = trial.predict(&*restored, &case.points, third)?;
    trial.same("with a restored memory", &expected, &values)?;
    trial.ensure(learned.learned == relearned.learned, "a restored memory learns something else")?;
    let (fresh, _) = trial.predict(&*trial.fresh(&case.labels)?, &case.points, third)?;
    trial.ensure(fresh != expected, "the memory does not matter")?;
    let (again, _) = trial.predict(&*trial.fresh(&case.labels)?, &case.points, DRAW)?;
    trial.same("a pass without memory", &before, &again)
}
