//! How blurred the edges of a volume are.

use rayon::prelude::*;

use crate::boundary::{Role, Tracer, Work};
use crate::bspline::Evaluator;
use crate::sampler::Sampler;

/// Voxels that are looked at, at most about this many: enough for a median.
const MOST_VOXELS: usize = 200_000;
/// Edges with less than this share of the strong ones' gradient magnitude are not looked at: noise, and thin partial
/// volumes.
const LEAST_STRENGTH: f32 = 0.25;
/// Which share of the edges found counts as the strong ones.
const STRONG: f32 = 0.95;
/// Fewer edges than this say nothing.
const LEAST_EDGES: usize = 50;

/// Edges as they were found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeStatistics {
    /// Median standard deviation of the Gaussian that blurs them, in multiples of L_min.
    pub blur: f32,
    /// Median step across them, in working units: that of a Gaussian's profile with the gradient magnitude found.
    pub step: f32,
}

/// The blur of the stronger edges of a volume, or `None` where there are hardly any.
///
/// A step blurred by a Gaussian of deviation s has g = A·exp(−t²/2s²) along its normal, so that `(ln g)'' = −1/s²` at every
/// point: three values of g around each crossing give s, and the median over many crossings is robust against corners and
/// what noise remains. Between two edges g falls to 0, so that the faces of layers thinner than three blurs look sharper
/// than they are, by up to √2. (The scale of an edge from its derivatives: Elder and Zucker, *Local scale control
/// for edge detection and blur estimation*, IEEE PAMI 20(7), 1998.)
#[must_use]
pub fn edge_statistics(tracer: &Tracer<'_>, spline: &Evaluator<'_>, dims: [usize; 3]) -> Option<EdgeStatistics> {
    let sampler = Sampler::new(dims);
    let [nx, ny, nz] = dims;
    let stride = (1..).find(|stride| dims.map(|dim| dim.div_ceil(*stride)).iter().product::<usize>() <= MOST_VOXELS)?;
    let along = |len: usize| (0..len).step_by(stride);
    let edge = |voxel: [usize; 3]| {
        let Role::Hit(hit) = tracer.role(voxel, &mut Work::default()) else { return None };
        // Nearby, where the straight ray is surely the edge's own normal.
        if hit.distance.abs() > 3.0 {
            return None;
        }
        let ray = sampler.ray(voxel, hit.normal * spline.per_length());
        let g = |t: f32| Some(spline.jet(&sampler.place(&ray, t)?).gradient.length());
        let [before, on, after] = [-1.0, 0.0, 1.0].map(|offset| g(offset - hit.distance));
        let curvature = 2.0 * on?.ln() - before?.ln() - after?.ln();
        (curvature > 0.0).then(|| [on.unwrap_or(0.0), curvature.sqrt().recip()])
    };
    let slices: Vec<usize> = along(nz).collect();
    let mut edges: Vec<[f32; 2]> = slices
        .into_par_iter()
        .flat_map_iter(|k| along(ny).flat_map(move |j| along(nx).map(move |i| [i, j, k])).filter_map(edge))
        .collect();
    if edges.len() < LEAST_EDGES {
        return None;
    }
    edges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let strong = edges[(STRONG * (edges.len() - 1) as f32) as usize][0];
    edges.retain(|[g, _]| *g >= LEAST_STRENGTH * strong);
    let middle = edges.len() / 2;
    let mut steps: Vec<f32> = edges.iter().map(|[g, blur]| g * blur * std::f32::consts::TAU.sqrt()).collect();
    let (_, &mut step, _) = steps.select_nth_unstable_by(middle, f32::total_cmp);
    let (_, &mut [_, blur], _) = edges.select_nth_unstable_by(middle, |a, b| a[1].total_cmp(&b[1]));
    Some(EdgeStatistics { blur, step })
}
