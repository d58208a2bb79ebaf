//! How blurred the edges of a volume are.

use rayon::prelude::*;

use crate::boundary::{Role, Tracer, Work};
use crate::bspline::Evaluator;
use crate::region::{Region, lattice_stride};

/// Voxels that are looked at, at most about this many: enough for a median.
const MOST_VOXELS: usize = 200_000;
/// Edges with less than this share of the strong ones' gradient magnitude are not looked at: noise, and thin partial
/// volumes.
const LEAST_STRENGTH: f32 = 0.25;
/// Which share of the edges found counts as the strong ones.
const STRONG: f32 = 0.95;
/// Fewer edges than this say nothing.
const LEAST_EDGES: usize = 50;
/// Edges that face an axis count where they are at least this share of all.
const LEAST_SHARE: f32 = 0.1;

/// One edge.
#[derive(Clone, Copy, Debug)]
struct Edge {
    gradient_magnitude: f32,
    /// In multiples of L_min.
    blur: f32,
    /// The axis along which the fewest samples lie across it.
    axis: usize,
}

/// Edges as they were found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeStatistics {
    /// Median standard deviation of the Gaussian that blurs them, in multiples of L_min.
    pub blur: f32,
    /// The same of those edges alone that face each axis, where there are enough of them.
    pub blur_facing: [Option<f32>; 3],
    /// Median step across them, in working units: that of a Gaussian's profile with the gradient magnitude found.
    pub step: f32,
}

impl EdgeStatistics {
    /// The blur in samples of whichever axis samples its edges worst, after a further Gaussian of `sigma` in multiples of
    /// L_min.
    #[must_use]
    pub fn samples_across(&self, spacing: [f32; 3], sigma: f64) -> f64 {
        let samples = |blur: f32, spacing: f32| f64::from(blur).hypot(sigma) / f64::from(spacing);
        let facing = self.blur_facing.into_iter().zip(spacing);
        facing
            .filter_map(|(blur, spacing)| Some(samples(blur?, spacing)))
            .reduce(f64::min)
            .unwrap_or_else(|| samples(self.blur, 1.0))
    }
}

/// Edges at a lattice of voxels, by which to tell how blurred a volume is.
///
/// A step blurred by a Gaussian of deviation s has g = A·exp(−t²/2s²) along its normal, so that `(ln g)'' = −1/s²` at every
/// point: three values of g around each crossing give s, and the median over many crossings is robust against corners and
/// what noise remains. Between two edges g falls to 0, so that the faces of layers thinner than three blurs look sharper
/// than they are, by up to √2. (The scale of an edge from its derivatives: Elder and Zucker, *Local scale control
/// for edge detection and blur estimation*, IEEE PAMI 20(7), 1998.)
#[derive(Debug)]
pub struct Edges {
    /// Every how many voxels along each axis is looked at.
    stride: usize,
    found: Vec<Edge>,
}

impl Edges {
    /// For parts of these dimensions, which are looked at together.
    #[must_use]
    pub fn among(parts: &[[usize; 3]]) -> Self {
        Self { stride: lattice_stride(parts, MOST_VOXELS), found: Vec::new() }
    }

    /// Looks at the voxels of the lattice in `region` of a volume, whose voxels from `origin` on the tracer sees.
    pub fn look(&mut self, tracer: &Tracer<'_>, spline: &Evaluator<'_>, region: &Region, origin: [usize; 3]) {
        let stride = self.stride;
        let along = |axis: usize| (region.start[axis].next_multiple_of(stride)..region.end[axis]).step_by(stride);
        let slices: Vec<usize> = along(2).collect();
        let edge = |voxel: [usize; 3]| edge_at(tracer, spline, std::array::from_fn(|axis| voxel[axis] - origin[axis]));
        self.found.par_extend(
            slices
                .into_par_iter()
                .flat_map_iter(|k| along(1).flat_map(move |j| along(0).map(move |i| [i, j, k])).filter_map(edge)),
        );
    }

    /// Adds what was found elsewhere.
    pub fn append(&mut self, mut other: Self) {
        self.found.append(&mut other.found);
    }

    /// The blur of the stronger edges, or `None` where there are hardly any. The order in which they were found does not
    /// matter.
    #[must_use]
    pub fn statistics(&self) -> Option<EdgeStatistics> {
        let mut edges = self.found.clone();
        if edges.len() < LEAST_EDGES {
            return None;
        }
        edges.sort_by(|a, b| a.gradient_magnitude.total_cmp(&b.gradient_magnitude));
        let strong = edges[(STRONG * (edges.len() - 1) as f32) as usize].gradient_magnitude;
        edges.retain(|edge| edge.gradient_magnitude >= LEAST_STRENGTH * strong);
        let least = ((LEAST_SHARE * edges.len() as f32) as usize).max(LEAST_EDGES);
        let blur_facing = [0, 1, 2].map(|axis| {
            let facing: Vec<f32> = edges.iter().filter(|edge| edge.axis == axis).map(|edge| edge.blur).collect();
            (facing.len() >= least).then(|| median(facing))
        });
        let steps =
            edges.iter().map(|edge| edge.gradient_magnitude * edge.blur * std::f32::consts::TAU.sqrt()).collect();
        Some(EdgeStatistics {
            blur: median(edges.iter().map(|edge| edge.blur).collect()),
            blur_facing,
            step: median(steps),
        })
    }

    /// What was found, as numbers to be kept.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<u64> {
        let packed = |edge: &Edge| {
            [u64::from(edge.gradient_magnitude.to_bits()) << 32 | u64::from(edge.blur.to_bits()), edge.axis as u64]
        };
        self.found.iter().flat_map(packed).collect()
    }

    /// Adds what [`Self::to_numbers`] made numbers of.
    pub fn add_numbers(&mut self, numbers: &[u64]) {
        let edge = |numbers: &[u64; 2]| Edge {
            gradient_magnitude: f32::from_bits((numbers[0] >> 32) as u32),
            blur: f32::from_bits(numbers[0] as u32),
            axis: numbers[1] as usize,
        };
        self.found.extend(numbers.as_chunks().0.iter().map(edge));
    }
}

/// The edge on the ray of a voxel, if there is one nearby.
fn edge_at(tracer: &Tracer<'_>, spline: &Evaluator<'_>, voxel: [usize; 3]) -> Option<Edge> {
    let Role::Hit(hit) = tracer.role(voxel, &mut Work::default()) else { return None };
    // Nearby, where the straight ray is surely the edge's own normal.
    if hit.distance.abs() > 3.0 {
        return None;
    }
    let sampler = tracer.sampler();
    let ray = sampler.ray(voxel, hit.normal * spline.per_length());
    let g = |t: f32| Some(spline.jet(&sampler.place(&ray, t)?).gradient.length());
    let [before, on, after] = [-1.0, 0.0, 1.0].map(|offset| g(offset - hit.distance));
    let curvature = 2.0 * on?.ln() - before?.ln() - after?.ln();
    let across = hit.normal.abs() / spline.per_length();
    (curvature > 0.0).then(|| Edge {
        gradient_magnitude: on.unwrap_or(0.0),
        blur: curvature.sqrt().recip(),
        axis: across.max_position(),
    })
}

fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
