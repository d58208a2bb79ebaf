//! How far roles are from the truth.

use super::{Expected, Truth};

/// A hit off by more than this is at another place than the boundary, in multiples of L_min.
const WRONG: f64 = 0.5;
/// A boundary that smoothing has shifted by no more than this is still the same one, in multiples of L_min: the faces of the
/// thinnest layer are farther apart.
const SHIFTED: f64 = 1.0;
/// The share of hits that the high percentile leaves above it.
const PERCENTILE: f64 = 0.99;

/// The roles that are judged.
#[derive(Clone, Copy, Debug)]
pub struct Roles<'a> {
    /// Signed distance of every voxel in multiples of L_min, not finite without a hit.
    pub distance: &'a [f32],
    /// Gradient magnitude at the hit.
    pub hit_gradient: &'a [f32],
    /// What turns that into stored value per world unit.
    pub gradient_scale: f64,
}

/// What was found of a set of voxels. Figures are absent where nothing could be counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// Voxels in the set.
    pub voxels: usize,
    /// Share of them with a hit.
    pub hit_rate: Option<f64>,
    /// Root mean square error of the hits' distance to the crossing, in multiples of L_min, wrong hits included.
    pub rms: Option<f64>,
    /// What 99 % of those errors stay below.
    pub p99: Option<f64>,
    /// The largest.
    pub max: Option<f64>,
    /// Share of the hits that are off by more than half a voxel.
    pub wrong_share: Option<f64>,
    /// Mean of `g / g_true − 1` over the hits.
    pub gradient_bias: Option<f64>,
    /// Its root mean square.
    pub gradient_rms: Option<f64>,
}

/// The accuracy of one method on one case.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Voxels within two blurs.
    pub near: Found,
    /// Of those, the ones beside the volume's border, which are not among the former.
    pub border: Found,
    /// Voxels from two to four blurs.
    pub around: Found,
    /// Root mean square error to the true surface of the hits within two blurs.
    pub surface_rms: Option<f64>,
    /// The smallest share, over the scene's boundaries, of near voxels with a hit within one voxel of the crossing: what is
    /// left of the weakest of them, be it shifted.
    pub weakest_boundary: Option<f64>,
    /// Share of voxels with a hit though no ray of theirs reaches a true surface.
    pub false_share: Option<f64>,
    /// The same beside the volume's border.
    pub border_false_share: Option<f64>,
    /// As [`Found::rms`] of the near voxels, against the roles that the same settings give without noise and rounding:
    /// the smoothed field's own crossing. Absent for cases without either, and where no settings give them.
    pub own_rms: Option<f64>,
}

impl Figures {
    /// Compares roles with the truth.
    #[must_use]
    pub fn new(truth: &Truth, roles: &Roles<'_>) -> Self {
        let to_surface = truth.near.iter().filter_map(|expected| Some(roles.hit(expected.voxel)? - expected.surface?));
        let false_share =
            |empty: &[usize]| share(empty.iter().filter(|&&voxel| roles.hit(voxel).is_some()).count(), empty.len());
        Self {
            near: Found::new(&truth.near, roles),
            border: Found::new(&truth.border, roles),
            around: Found::new(&truth.around, roles),
            surface_rms: root_mean_square(to_surface),
            weakest_boundary: weakest_boundary(&truth.near, roles),
            false_share: false_share(&truth.empty),
            border_false_share: false_share(&truth.border_empty),
            own_rms: None,
        }
    }

    /// Sets [`Self::own_rms`] by the `distance` that was found without noise.
    #[must_use]
    pub fn with_own(self, truth: &Truth, roles: &Roles<'_>, distance: &[f32]) -> Self {
        let own = |voxel: usize| Some(f64::from(distance[voxel])).filter(|distance| distance.is_finite());
        let errors = truth.near.iter().filter_map(|expected| Some(roles.hit(expected.voxel)? - own(expected.voxel)?));
        Self { own_rms: root_mean_square(errors), ..self }
    }
}

impl Roles<'_> {
    fn hit(&self, voxel: usize) -> Option<f64> {
        Some(f64::from(self.distance[voxel])).filter(|distance| distance.is_finite())
    }
}

impl Found {
    /// Compares a set of voxels with the truth.
    #[must_use]
    pub fn new(expected: &[Expected], roles: &Roles<'_>) -> Self {
        let mut errors = Vec::with_capacity(expected.len());
        let mut gradient_errors = Vec::with_capacity(expected.len());
        for expected in expected {
            if let Some(distance) = roles.hit(expected.voxel) {
                errors.push((distance - expected.crossing).abs());
                let gradient = f64::from(roles.hit_gradient[expected.voxel]) * roles.gradient_scale;
                gradient_errors.push(gradient / expected.gradient_magnitude - 1.0);
            }
        }
        errors.sort_by(f64::total_cmp);
        let hits = errors.len();
        let last = hits.saturating_sub(1);
        Self {
            voxels: expected.len(),
            hit_rate: share(hits, expected.len()),
            rms: root_mean_square(errors.iter().copied()),
            p99: errors.get((PERCENTILE * last as f64).ceil() as usize).copied(),
            max: errors.last().copied(),
            wrong_share: share(errors.iter().filter(|error| **error > WRONG).count(), hits),
            gradient_bias: (hits > 0).then(|| gradient_errors.iter().sum::<f64>() / hits as f64),
            gradient_rms: root_mean_square(gradient_errors.iter().copied()),
        }
    }
}

fn weakest_boundary(near: &[Expected], roles: &Roles<'_>) -> Option<f64> {
    let count = near.iter().filter_map(|expected| expected.boundary).max()? + 1;
    let mut counts = vec![[0_usize; 2]; count];
    for (expected, boundary) in near.iter().filter_map(|expected| Some((expected, expected.boundary?))) {
        let kept = roles.hit(expected.voxel).is_some_and(|distance| (distance - expected.crossing).abs() <= SHIFTED);
        counts[boundary][0] += usize::from(kept);
        counts[boundary][1] += 1;
    }
    counts.into_iter().filter_map(|[kept, all]| share(kept, all)).min_by(f64::total_cmp)
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn root_mean_square(errors: impl Iterator<Item = f64>) -> Option<f64> {
    let (squares, count) =
        errors.fold((0.0, 0_usize), |(squares, count), error| (error.mul_add(error, squares), count + 1));
    (count > 0).then(|| (squares / count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::Case;
    use super::*;
    use crate::phantom::Phantom;

    /// A small ball, and roles that are exactly right.
    fn exact() -> (Truth, Vec<f32>, Vec<f32>) {
        let case = Case { blur: 1.0, ..Case::base(Phantom::Ball, 36) };
        let mut truth = Truth::new(&case).expect("a ball");
        let mut distance = vec![f32::NAN; 36 * 36 * 36];
        let mut gradient = distance.clone();
        for expected in truth.near.iter_mut().chain(&mut truth.border).chain(&mut truth.around) {
            distance[expected.voxel] = expected.crossing as f32;
            gradient[expected.voxel] = expected.gradient_magnitude as f32;
            // What f32 holds is the truth here.
            expected.crossing = f64::from(distance[expected.voxel]);
        }
        (truth, distance, gradient)
    }

    fn figures(truth: &Truth, distance: &[f32], hit_gradient: &[f32]) -> Figures {
        Figures::new(truth, &Roles { distance, hit_gradient, gradient_scale: 1.0 })
    }

    #[test]
    fn exact_roles_have_no_error() {
        let (truth, distance, gradient) = exact();
        let Figures { near, around, surface_rms, weakest_boundary, own_rms, .. } =
            figures(&truth, &distance, &gradient);
        assert!(near.voxels > 300 && around.voxels > 300);
        for found in [near, around] {
            assert_eq!([found.rms, found.p99, found.max, found.wrong_share], [Some(0.0); 4]);
            assert_eq!(found.hit_rate, Some(1.0));
            assert!(found.gradient_rms.is_some_and(|error| error < 1e-6));
        }
        assert!(surface_rms.is_some_and(|error| error < 1e-6));
        assert_eq!((weakest_boundary, own_rms), (Some(1.0), None));
    }

    #[test]
    fn one_shifted_hit_is_wrong() {
        let (truth, mut distance, gradient) = exact();
        distance[truth.near[7].voxel] += 0.6;
        let near = figures(&truth, &distance, &gradient).near;
        let count = near.voxels as f64;
        assert_eq!((near.wrong_share, near.hit_rate), (Some(1.0 / count), Some(1.0)));
        assert!((near.max.expect("hits") - 0.6).abs() < 1e-6 && near.p99 == Some(0.0));
        assert!((near.rms.expect("hits") - 0.6 / count.sqrt()).abs() < 1e-6);
        distance[truth.near[7].voxel] -= 0.2;
        assert_eq!(figures(&truth, &distance, &gradient).near.wrong_share, Some(0.0));
    }

    #[test]
    fn lost_voxels_lower_the_hit_rate_alone() {
        let (truth, mut distance, gradient) = exact();
        distance[truth.near[3].voxel] = f32::NAN;
        distance[truth.near[4].voxel] = f32::INFINITY;
        let found = figures(&truth, &distance, &gradient);
        let expected = 1.0 - 2.0 / found.near.voxels as f64;
        assert!((found.near.hit_rate.expect("voxels") - expected).abs() < 1e-12);
        assert_eq!((found.near.rms, found.near.wrong_share), (Some(0.0), Some(0.0)));
        assert!((found.weakest_boundary.expect("a boundary") - expected).abs() < 1e-12);
    }

    #[test]
    fn hits_far_from_everything_are_false_and_gradients_are_compared() {
        let (mut truth, mut distance, mut gradient) = exact();
        let unused: Vec<usize> = (0..distance.len()).filter(|&voxel| distance[voxel].is_nan()).take(10).collect();
        distance[unused[0]] = 1.0;
        truth.empty = unused;
        gradient.iter_mut().for_each(|g| *g *= 0.9);
        let found = figures(&truth, &distance, &gradient);
        assert_eq!(found.false_share, Some(0.1));
        assert!((found.near.gradient_bias.expect("hits") + 0.1).abs() < 1e-6);
        let nothing = figures(&truth, &vec![f32::NAN; distance.len()], &gradient).near;
        assert_eq!((nothing.hit_rate, nothing.rms, nothing.max, nothing.wrong_share), (Some(0.0), None, None, None));
    }

    #[test]
    fn the_fields_own_crossing_takes_no_shift_for_an_error() {
        let (truth, distance, gradient) = exact();
        let shifted: Vec<f32> = distance.iter().map(|distance| distance + 0.125).collect();
        let roles = Roles { distance: &shifted, hit_gradient: &gradient, gradient_scale: 1.0 };
        let found = Figures::new(&truth, &roles).with_own(&truth, &roles, &shifted);
        assert_eq!(found.own_rms, Some(0.0));
        assert!((found.near.rms.expect("hits") - 0.125).abs() < 1e-6);
    }
}
