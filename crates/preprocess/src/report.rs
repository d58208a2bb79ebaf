//! What a run did, as `--report` writes it.

use std::time::Instant;

use serde::Serialize;

use crate::automatic::Choice;
use crate::bilateral::RangeWeights;
use crate::value_noise::NoisyValues;

/// Time, work and outcome of a run. All but the seconds are the same for any number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The input's file name; in what the program writes, the path that was typed.
    pub input: String,
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// Blocks that the volume was prepared in.
    pub blocks: usize,
    /// Blocks that an earlier run had finished.
    pub blocks_before: usize,
    /// Threads used.
    pub threads: usize,
    /// Seconds of each stage, in order.
    pub stages: Vec<Stage>,
    /// Seconds in total.
    pub seconds: f64,
    /// Estimated noise as a share of the value range.
    pub noise_share: f64,
    /// Values whose noise is stronger than that; absent where none is found to be.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub noise_by_value: Vec<NoisyValues>,
    /// σr used, as a share of the filtered fields' ranges, by field; absent without a bilateral filter.
    pub range_sigma: Vec<FieldSigma>,
    /// What `--method auto` found and chose; absent where nothing was left to it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub choice: Option<Choice>,
    /// What the user should know of the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
    /// Voxels and cells.
    pub counts: Counts,
    /// Length of the packed file.
    pub file_bytes: u64,
}

/// One stage.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    /// Its name.
    pub name: &'static str,
    /// How long it took.
    pub seconds: f64,
}

/// The bilateral filter of one field.
#[derive(Clone, Debug, Serialize)]
pub struct FieldSigma {
    /// The field.
    pub field: &'static str,
    /// σr over the field's range; 0 means that the filter left it as it was.
    pub share: f64,
    /// How the range weights were computed.
    pub weights: RangeWeights,
    /// The share of the field's boxes that were filtered; others hold one value only.
    pub boxes_filtered: f64,
}

/// Deterministic counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// All voxels.
    pub voxels: u64,
    /// Voxels whose stencil holds NaN or ±Inf.
    pub masked: u64,
    /// Voxels without a gradient above rounding and noise.
    pub flat: u64,
    /// Voxels whose rays met no mixed cell: nothing was sampled.
    pub skipped: u64,
    /// Voxels for which samples were taken.
    pub traced: u64,
    /// Trilinear samples taken along rays, the refinement of crossings included.
    pub samples: u64,
    /// Evaluations of a smooth reconstruction at crossings.
    pub evaluations: u64,
    /// Voxels with a boundary.
    pub hits: u64,
    /// Those whose boundary has less than twice the gradient that one must have at least.
    pub faint: u64,
    /// Voxels without one that are not masked.
    pub misses: u64,
    /// Cells of eight voxels.
    pub cells: u64,
    /// Cells in which f'' changes sign.
    pub mixed_cells: u64,
}

impl Counts {
    /// Of both.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let (a, b) = (self.to_numbers(), other.to_numbers());
        Self::from_numbers(std::array::from_fn(|index| a[index] + b[index]))
    }

    /// The counts in their order.
    #[must_use]
    pub fn to_numbers(&self) -> [u64; 12] {
        let Self {
            voxels,
            masked,
            flat,
            skipped,
            traced,
            samples,
            evaluations,
            hits,
            faint,
            misses,
            cells,
            mixed_cells,
        } = *self;
        [voxels, masked, flat, skipped, traced, samples, evaluations, hits, faint, misses, cells, mixed_cells]
    }

    /// Counts by their order.
    #[must_use]
    pub fn from_numbers(numbers: [u64; 12]) -> Self {
        let [voxels, masked, flat, skipped, traced, samples, evaluations, hits, faint, misses, cells, mixed_cells] =
            numbers;
        Self { voxels, masked, flat, skipped, traced, samples, evaluations, hits, faint, misses, cells, mixed_cells }
    }
}

/// Times stages.
pub struct Stopwatch {
    stages: Vec<Stage>,
    start: Instant,
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self::new()
    }
}

impl Stopwatch {
    /// Starts with the first stage.
    #[must_use]
    pub fn new() -> Self {
        Self { stages: Vec::new(), start: Instant::now() }
    }

    /// Ends the stage that runs since the last call; time of a stage that was there before is added to it.
    pub fn lap(&mut self, name: &'static str) {
        let seconds = self.start.elapsed().as_secs_f64();
        match self.stages.iter_mut().find(|stage| stage.name == name) {
            Some(stage) => stage.seconds += seconds,
            None => self.stages.push(Stage { name, seconds }),
        }
        self.start = Instant::now();
    }

    /// Seconds of all stages so far.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.stages.iter().map(|stage| stage.seconds).sum()
    }

    /// All stages.
    #[must_use]
    pub fn into_stages(self) -> Vec<Stage> {
        self.stages
    }
}
