//! What a file says of all its voxels, part by part.

use crate::blur::Edges;
use crate::joint_histogram::{Axes, Tally};
use crate::report::Counts;

/// What is known of some blocks once they are done.
#[derive(Debug)]
pub struct Summary {
    /// Voxels and cells.
    pub counts: Counts,
    /// Smallest and largest gradient magnitude at a hit, in working units; `None` without a hit.
    pub hit_gradient: Option<[f32; 2]>,
    /// The histograms.
    pub tally: Tally,
    /// Edges, where a spline is to be checked against their blur.
    pub edges: Option<Edges>,
}

impl Summary {
    /// Of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let hit_gradient = match (self.hit_gradient, other.hit_gradient) {
            (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
            (a, b) => a.or(b),
        };
        let edges = match (self.edges, other.edges) {
            (Some(mut edges), Some(others)) => {
                edges.append(others);
                Some(edges)
            }
            (a, b) => a.or(b),
        };
        Self { counts: self.counts.plus(&other.counts), hit_gradient, tally: self.tally.plus(other.tally), edges }
    }

    /// All there is, as numbers to be kept.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<u64> {
        let [low, high] = self.hit_gradient.unwrap_or([f32::NAN; 2]).map(|end| u64::from(end.to_bits()));
        let edges = self.edges.as_ref().map(Edges::to_numbers);
        let mut numbers = vec![low, high, edges.as_ref().map_or(u64::MAX, |edges| edges.len() as u64)];
        numbers.extend(self.counts.to_numbers());
        numbers.extend(edges.into_iter().flatten());
        numbers.extend(self.tally.to_numbers());
        numbers
    }

    /// What [`Self::to_numbers`] made numbers of, for a volume of `dims` voxels; `None` where those are others.
    #[must_use]
    pub fn from_numbers(numbers: &[u64], axes: &Axes, dims: [usize; 3]) -> Option<Self> {
        let [low, high, edge_numbers, rest @ ..] = numbers else { return None };
        let [low, high] = [low, high].map(|end| f32::from_bits(*end as u32));
        let (counts, rest) = rest.split_first_chunk()?;
        let with_edges = *edge_numbers != u64::MAX;
        let (own, rest) = rest.split_at_checked(if with_edges { usize::try_from(*edge_numbers).ok()? } else { 0 })?;
        let mut edges = with_edges.then(|| Edges::among(&[dims]));
        edges.iter_mut().for_each(|edges| edges.add_numbers(own));
        Some(Self {
            counts: Counts::from_numbers(*counts),
            hit_gradient: (!low.is_nan()).then_some([low, high]),
            tally: Tally::from_numbers(rest, axes)?,
            edges,
        })
    }
}
