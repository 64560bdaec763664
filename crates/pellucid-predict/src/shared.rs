//! One predictor's work shared out among the members of a team.

use std::sync::Arc;

use pellucid_core::team::{Deal, agree};
use pellucid_core::{Control, Team};
use pellucid_voxel::{LabelGrid, Tile};

use crate::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, Learned, MaterialGradient, Object,
    PredictError, Predictor,
};

/// Most points of a block that is dealt out: neighbours, which share caches.
const BLOCK: usize = 2048;
/// Blocks a member at least, so that slow regions are shared out as well.
const BLOCKS: usize = 8;

/// Predicts as another one does, bit for bit, each member of a team its part of the points; so for the gradient, where
/// the other one can ([`BoundPredictor::pullback_in`]).
///
/// Every member binds the same object, brings in the same labels and asks the same: labels need not be sent, radiances are.
/// Members whose labels differ are told so.
///
/// ```
/// use std::sync::Arc;
/// use pellucid_core::team::Threads;
/// use pellucid_predict::{Changed, Draw, MonteCarlo, Object, Pass, Predictor, Shared, predict_all};
/// use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
///
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [16; 3]).unwrap();
/// let labels = LabelGrid::from_tiles(frame, |_| Tile::Constant(5)); // a block of white
/// let control = Control::none();
/// let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
/// let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap());
/// let tracer = MonteCarlo::new(2).unwrap();
/// let predict = |predictor: &dyn Predictor| {
///     let mut bound = predictor.bind(Arc::clone(&object)).unwrap();
///     bound.update(&labels, Changed::Unknown, &Control::none()).unwrap();
///     predict_all(&*bound, &object, Draw::new(7, Pass::Proof), &Control::none()).unwrap()
/// };
/// let alone = predict(&tracer);
/// let together = Threads::run(2, |team| predict(&Shared::new(tracer, Arc::new(team))));
/// assert!(together.iter().all(|seen| *seen == alone));
/// ```
#[derive(Clone, Debug)]
pub struct Shared<P> {
    predictor: P,
    team: Arc<dyn Team>,
}

impl<P: Predictor> Shared<P> {
    /// A predictor whose work is a team's.
    pub fn new(predictor: P, team: Arc<dyn Team>) -> Self {
        Self { predictor, team }
    }
}

impl<P: Predictor> Predictor for Shared<P> {
    fn identity(&self) -> Identity {
        self.predictor.identity()
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        self.predictor.supports(object)
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        let bound = self.predictor.bind(Arc::clone(&object))?;
        if self.team.size() == 1 {
            return Ok(bound);
        }
        let name = self.predictor.identity().name;
        Ok(Box::new(BoundShared { bound, object, name, team: Arc::clone(&self.team), current: false }))
    }
}

struct BoundShared {
    bound: Box<dyn BoundPredictor>,
    object: Arc<Object>,
    name: String,
    team: Arc<dyn Team>,
    /// Every member holds the labels of the last update.
    current: bool,
}

impl BoundShared {
    fn check_current(&self) -> Result<(), PredictError> {
        if self.current { Ok(()) } else { Err(PredictError::before_update()) }
    }

    /// What this member came to, unless another one failed; the sums of both numbers over the members.
    fn meet<T>(
        &self,
        own: Result<T, PredictError>,
        counts: impl FnOnce(&T) -> [u64; 2],
    ) -> Result<(T, [u64; 2]), PredictError> {
        let mut sums = [0; 4];
        match &own {
            Ok(value) => sums[2..].copy_from_slice(&counts(value).map(|count| count as i64)),
            Err(PredictError::Cancelled) => sums[0] = 1,
            Err(_) => sums[1] = 1,
        }
        self.team.sum(&mut sums);
        let own = own?;
        match sums {
            [0, 0, first, second] => Ok((own, [first as u64, second as u64])),
            [_, 0, ..] => Err(PredictError::Cancelled),
            _ => Err(PredictError::failed(&*self.name, "another member of the team failed")),
        }
    }
}

impl BoundPredictor for BoundShared {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        // After a failure no member trusts what is said to have changed.
        let changed = if std::mem::take(&mut self.current) { changed } else { Changed::Unknown };
        let own = self.bound.update(labels, changed, control);
        self.meet(own, |()| [0; 2])?;
        if !agree(&*self.team, &contents(labels, changed)) {
            let reason = "the members of the team have come to different labels; run one program on all, on \
                          machines of one kind";
            return Err(PredictError::failed(&*self.name, reason));
        }
        self.current = true;
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.check_current()?;
        self.object.check_points(points, out.len())?;
        let members = self.team.size();
        let deal = Deal::new(points.len(), members, BLOCK.min(points.len() / (members * BLOCKS)));
        let channels = self.object.channels();
        let mine: Vec<u32> =
            deal.blocks(self.team.rank()).flat_map(|block| &points[block]).copied().collect();
        let mut values = vec![0.0; mine.len() * channels];
        let own = self.bound.predict(&mine, draw, &mut values, control);
        let (own, [outside_training, paths]) = self.meet(own, |d| [d.outside_training, d.paths])?;
        let counts: Vec<usize> = deal.counts().iter().map(|count| count * channels).collect();
        let mut all = vec![0.0; out.len()];
        self.team.gather(&values, &counts, &mut all);
        let mut rest = &all[..];
        for block in (0..members).flat_map(|rank| deal.blocks(rank)) {
            let (of_block, after) = rest.split_at(block.len() * channels);
            out[block.start * channels..block.end * channels].copy_from_slice(of_block);
            rest = after;
        }
        Ok(Diagnostics { outside_training, paths, learned: own.learned })
    }

    fn pullback(
        &self,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.check_current()?;
        self.bound.pullback_in(&*self.team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        self.bound.absorb(learned)
    }

    fn memory(&self) -> Learned {
        self.bound.memory()
    }
}

/// The labels that may have changed, as bytes.
fn contents(labels: &LabelGrid, changed: Changed<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut add = |tile: &Tile| match tile {
        Tile::Constant(label) => bytes.push(*label),
        Tile::Dense(voxels) => bytes.extend_from_slice(&voxels[..]),
    };
    match changed {
        Changed::Unknown => labels.tiles().iter().for_each(add),
        Changed::Tiles(tiles) => {
            tiles.iter().filter_map(|&t| labels.tiles().get(t as usize)).for_each(&mut add);
        }
    }
    bytes
}
