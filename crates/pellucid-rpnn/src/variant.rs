//! The four architectures of the paper's Table 2: with and without weights shared over levels (≡L) and
//! over octants (≡O).

use std::ops::Range;

use pellucid_stencil::StencilSpec;

pub use pellucid_stencil::{FLIGHT_BINS, FirstFlight, OCTANTS};

/// The stencil that the networks read: 9 levels of 5 x 3 x 9 cells.
pub const STENCIL: StencilSpec = StencilSpec::paper();
/// Levels of the stencil hierarchy.
pub const LEVELS: usize = STENCIL.levels();
/// Cells of a level along x, y and z.
pub const CELLS_XYZ: [usize; 3] = STENCIL.cells();
/// Cells of a level.
pub const CELLS: usize = STENCIL.cells_per_level();
/// Features of a cell: sigma_s and sigma_a.
pub const FEATURES: usize = 2;
/// Inputs of a level.
pub const LEVEL_INPUTS: usize = CELLS * FEATURES;
/// Inputs of the network.
pub const INPUTS: usize = LEVELS * LEVEL_INPUTS;
/// Inputs of an octant: 3 x 2 x 5 cells with two features.
pub const OCTANT_INPUTS: usize = 60;

/// An architecture. Where weights are shared decides its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Variant {
    /// Every level has layers of its own over the whole stencil.
    #[serde(rename = "baseline")]
    Baseline,
    /// One block shared by all levels (isometric scaling, section 4.3).
    #[serde(rename = "L")]
    SharedLevels,
    /// Layers shared by the eight octants of each level (rotational invariance, section 4.3).
    #[serde(rename = "O")]
    SharedOctants,
    /// Both: the paper's proposal.
    #[serde(rename = "L+O")]
    SharedLevelsAndOctants,
}

/// What the network's last layer gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Head {
    /// One output, the radiance after a ReLU: the paper's form.
    #[default]
    Radiance,
    /// Four outputs J: the throughput that remains of a path after a first collision in each depth bin, and after a
    /// reflection at the far side. Radiance follows from them and the point's exact [`FirstFlight`].
    FirstFlight,
}

impl Head {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Radiance, Self::FirstFlight];
    /// Most outputs.
    pub const MOST_OUTPUTS: usize = FLIGHT_BINS + 1;

    /// Outputs a sample.
    pub const fn outputs(self) -> usize {
        match self {
            Self::Radiance => 1,
            Self::FirstFlight => Self::MOST_OUTPUTS,
        }
    }

    /// What outputs are about on average: where an untrained network starts.
    pub const fn mean_output(self) -> f32 {
        match self {
            Self::Radiance => 0.4,
            Self::FirstFlight => 0.6,
        }
    }

    /// The name used in files, tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiance => "radiance",
            Self::FirstFlight => "first-flight",
        }
    }

    /// The head of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|h| h.name() == name)
    }

    /// Radiance of each sample from the network's outputs `[sample][outputs]`; `flights` are the samples' first
    /// flights, of which [`Head::Radiance`] needs none.
    ///
    /// # Panics
    /// When the lengths do not agree.
    pub fn radiance(self, outputs: &[f32], flights: &[FirstFlight], radiance: &mut [f32]) {
        match self {
            Self::Radiance => radiance.copy_from_slice(outputs),
            Self::FirstFlight => {
                assert_eq!(flights.len(), radiance.len(), "a flight a sample");
                let samples = outputs.as_chunks::<{ Self::MOST_OUTPUTS }>().0;
                assert_eq!(samples.len(), radiance.len(), "outputs of every sample");
                for ((out, flight), j) in radiance.iter_mut().zip(flights).zip(samples) {
                    *out = flight.radiance(j).max(0.0);
                }
            }
        }
    }

    /// Derivatives by the outputs from those by the radiance that [`Head::radiance`] gave; where the ReLU cut a
    /// radiance off to zero, only what would raise it passes, or a network that is cut off everywhere would never
    /// learn again.
    ///
    /// # Panics
    /// When the lengths do not agree.
    pub fn derivatives(
        self,
        radiance: &[f32],
        d_radiance: &[f32],
        flights: &[FirstFlight],
        d_outputs: &mut [f32],
    ) {
        let passed = radiance.iter().zip(d_radiance).map(|(&l, &d)| if l > 0.0 { d } else { d.min(0.0) });
        match self {
            Self::Radiance => {
                assert_eq!(d_outputs.len(), radiance.len(), "an output a sample");
                d_outputs.iter_mut().zip(passed).for_each(|(out, d)| *out = d);
            }
            Self::FirstFlight => {
                assert_eq!(flights.len(), radiance.len(), "a flight a sample");
                let samples = d_outputs.as_chunks_mut::<{ Self::MOST_OUTPUTS }>().0;
                for ((out, flight), d) in samples.iter_mut().zip(flights).zip(passed) {
                    *out = flight.factors().map(|factor| d * factor);
                }
            }
        }
    }
}

/// One dense layer: where its parameters lie in the flat vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name in weight files, such as `level3.b`.
    pub name: String,
    /// Values out.
    pub outputs: usize,
    /// Values in.
    pub inputs: usize,
    /// The matrix, `[outputs][inputs]`.
    pub weight: Range<usize>,
    /// The bias, `[outputs]`, empty for layers without one.
    pub bias: Range<usize>,
}

/// The layers of one stencil level, as positions in [`Layout::layers`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Two dense layers on the input: octant layers with ≡O, the first level's layers of the baseline.
    pub entry: Option<[usize; 2]>,
    /// The bias-free product with the new level's values.
    pub a: Option<usize>,
    /// The products with the state of the finer levels and with the mixture; absent at the first level
    /// of variants without ≡L.
    pub bc: Option<[usize; 2]>,
}

/// Where every parameter of a variant lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// All layers in file order.
    pub layers: Vec<Layer>,
    /// The layers of each level; shared levels repeat the same positions.
    pub blocks: [Block; LEVELS],
    /// The three layers of the end.
    pub end: [usize; 3],
    /// Number of parameters.
    pub parameters: usize,
}

impl Variant {
    /// All four, in the paper's order.
    pub const ALL: [Variant; 4] =
        [Self::Baseline, Self::SharedLevels, Self::SharedOctants, Self::SharedLevelsAndOctants];

    /// The name used in files, tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::SharedLevels => "L",
            Self::SharedOctants => "O",
            Self::SharedLevelsAndOctants => "L+O",
        }
    }

    /// The variant of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|v| v.name() == name)
    }

    /// Whether levels share their block (≡L).
    pub fn shares_levels(self) -> bool {
        matches!(self, Self::SharedLevels | Self::SharedLevelsAndOctants)
    }

    /// Whether octants share their layers (≡O).
    pub fn shares_octants(self) -> bool {
        matches!(self, Self::SharedOctants | Self::SharedLevelsAndOctants)
    }

    /// Width of the state passed from level to level: 270, or 8 x 60 with ≡O.
    pub fn width(self) -> usize {
        if self.shares_octants() { OCTANTS * OCTANT_INPUTS } else { LEVEL_INPUTS }
    }

    /// Number of trainable values with [`Head::Radiance`] (the paper's Table 2).
    ///
    /// ```
    /// use pellucid_rpnn::Variant;
    /// assert_eq!(Variant::ALL.map(Variant::parameters), [2_046_871, 365_851, 3_767_341, 706_861]);
    /// ```
    pub fn parameters(self) -> usize {
        self.layout(Head::Radiance).parameters
    }

    /// Where every parameter lies.
    pub fn layout(self, head: Head) -> Layout {
        let mut b = Builder { layers: Vec::new(), next: 0 };
        let width = self.width();
        let mut shared: Option<Block> = None;
        let blocks = std::array::from_fn(|level| {
            if let (true, Some(block)) = (self.shares_levels(), shared) {
                return block;
            }
            let prefix =
                if self.shares_levels() { "level".to_owned() } else { format!("level{}", level + 1) };
            let first = level == 0 && !self.shares_levels();
            let entry = if self.shares_octants() {
                Some(
                    ["octant1", "octant2"]
                        .map(|n| b.dense(&format!("{prefix}.{n}"), OCTANT_INPUTS, OCTANT_INPUTS)),
                )
            } else if first {
                Some(
                    ["dense1", "dense2"]
                        .map(|n| b.dense(&format!("{prefix}.{n}"), LEVEL_INPUTS, LEVEL_INPUTS)),
                )
            } else {
                None
            };
            let has_a = if self.shares_octants() { self.shares_levels() } else { !first };
            let a = has_a.then(|| b.product(&format!("{prefix}.a"), width, width));
            let bc = (!first).then(|| ["b", "c"].map(|n| b.dense(&format!("{prefix}.{n}"), width, width)));
            let block = Block { entry, a, bc };
            shared = Some(block);
            block
        });
        let end_width = if self.shares_octants() { OCTANT_INPUTS } else { LEVEL_INPUTS };
        let end = [
            b.dense("end1", end_width, end_width),
            b.dense("end2", end_width, end_width),
            b.dense("end3", head.outputs(), end_width),
        ];
        Layout { layers: b.layers, blocks, end, parameters: b.next }
    }
}

struct Builder {
    layers: Vec<Layer>,
    next: usize,
}

impl Builder {
    fn dense(&mut self, name: &str, outputs: usize, inputs: usize) -> usize {
        let i = self.product(name, outputs, inputs);
        self.layers[i].bias = self.take(outputs);
        i
    }

    fn product(&mut self, name: &str, outputs: usize, inputs: usize) -> usize {
        let weight = self.take(outputs * inputs);
        let bias = self.next..self.next;
        self.layers.push(Layer { name: name.to_owned(), outputs, inputs, weight, bias });
        self.layers.len() - 1
    }

    fn take(&mut self, n: usize) -> Range<usize> {
        let start = self.next;
        self.next += n;
        start..self.next
    }
}

/// Positions within a level's 270 inputs of an octant's 60, ordered `[z 5][y 2][x 3][feature]` outward
/// from the centre. Bit 0 of `octant` mirrors x, bit 1 y, bit 2 z, so mirroring a stencil along an axis
/// exchanges octants whose indices differ in that bit.
pub fn octant_gather(octant: usize) -> [u16; OCTANT_INPUTS] {
    // The stencil's octants are numbered from the low corner and end at the centre.
    let inward = STENCIL.octant_index(octant ^ (OCTANTS - 1));
    std::array::from_fn(|i| (inward[inward.len() - 1 - i / FEATURES] * FEATURES + i % FEATURES) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_tile_the_flat_vector() {
        for (variant, head) in Variant::ALL.into_iter().flat_map(|v| Head::ALL.map(|h| (v, h))) {
            let layout = variant.layout(head);
            let mut next = 0;
            for layer in &layout.layers {
                assert_eq!(layer.weight, next..next + layer.outputs * layer.inputs, "{}", layer.name);
                assert_eq!(layer.bias.start, layer.weight.end);
                assert!(layer.bias.is_empty() || layer.bias.len() == layer.outputs);
                next = layer.bias.end;
            }
            assert_eq!(next, layout.parameters);
            assert_eq!(Variant::from_name(variant.name()), Some(variant));
        }
    }

    #[test]
    fn octants_cover_the_stencil_and_share_the_middle() {
        let mut seen = [0; LEVEL_INPUTS];
        for octant in 0..OCTANTS {
            for i in octant_gather(octant) {
                seen[usize::from(i)] += 1;
            }
        }
        assert!(seen.iter().all(|&n| n >= 1));
        let centre = (4 * 3 + 1) * 5 + 2;
        assert_eq!(seen[centre * 2], 8);
        assert_eq!(seen[0], 1);
        // Weights that were trained depend on this order.
        let (plain, mirrored) = (octant_gather(0), octant_gather(0b101));
        assert_eq!((plain[0], plain[2], plain[6], plain[12]), (67 * 2, 68 * 2, 72 * 2, 82 * 2));
        assert_eq!(
            (mirrored[0], mirrored[2], mirrored[6], mirrored[13]),
            (67 * 2, 66 * 2, 72 * 2, 52 * 2 + 1)
        );
    }
}
