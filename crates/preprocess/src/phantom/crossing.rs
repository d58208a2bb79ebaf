//! The role of a point on the formula itself: the nearest authentic zero crossing of f'' along its own gradient.

use glam::DVec3;
use rayon::prelude::*;
use voxrole_pack::GridGeometry;

use super::Scene;
use super::derivatives::Derivatives;
use super::volume::fill;
use crate::Result;

/// Samples along a ray per length of [`Scene::smallest_detail`]. Two crossings of a blurred field are further apart than
/// one blur, wherever between them g changes by more than rounding.
const SAMPLES_PER_DETAIL: f64 = 4.0;

/// Width to which bisection narrows a crossing, as a share of [`Scene::smallest_detail`].
const TOLERANCE: f64 = 1e-10;

/// How far to both sides of a point with f'' = 0 is looked at, as a share of [`Scene::smallest_detail`], to tell a maximum
/// of g from a minimum and from a plateau.
const PROBE: f64 = 1e-4;

/// Share of the parts' gradient magnitudes below which their sum is taken to vanish: what is left has the direction of
/// rounding errors, as in the very middle of a slab.
const CANCELLED: f64 = 1e-8;

/// Where the authentic edge of a point lies, and what the field is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance along the point's own gradient in world units, positive for a point on the high-value side.
    pub distance: f64,
    /// Gradient magnitude on the crossing, in value per world unit.
    pub gradient_magnitude: f64,
    /// Value on the crossing.
    pub value: f64,
}

/// A straight line through a point along its gradient, in one of the two directions.
struct Ray<'a> {
    scene: &'a Scene,
    origin: DVec3,
    /// Unit vector along which the ray runs.
    direction: DVec3,
    /// 1 where it runs towards growing values, −1 where towards falling ones.
    uphill: f64,
}

/// What a ray is asked at a place.
struct Sample {
    /// Rise of the gradient magnitude along the ray, `±f''`.
    rise: f64,
    /// Whether the field still grows the way it did at the ray's origin.
    keeps_direction: bool,
}

impl Ray<'_> {
    fn derivatives(&self, t: f64) -> Derivatives {
        self.scene.derivatives(self.origin + t * self.direction)
    }

    /// `None` where the gradient vanishes.
    fn sample(&self, t: f64) -> Option<Sample> {
        let derivatives = self.derivatives(t);
        let direction = derivatives.direction()?;
        Some(Sample {
            rise: self.uphill * direction.dot(derivatives.hessian * direction),
            keeps_direction: self.uphill * direction.dot(self.direction) > 0.0,
        })
    }

    /// Distance along the ray to the first place within `reach` where g stops rising on an unreversed gradient.
    fn first_crossing(&self, reach: f64, detail: f64) -> Option<f64> {
        let step = detail / SAMPLES_PER_DETAIL;
        let count = (reach / step).ceil();
        let mut rising_at = None;
        let mut index = 0.0;
        // From the origin on, for a ray that starts on a minimum of g rises only after it.
        while index <= count {
            let t = (index * step).min(reach);
            let Sample { rise, keeps_direction } = self.sample(t)?;
            if !keeps_direction {
                rising_at = None;
            } else if rise > 0.0 {
                rising_at = Some(t);
            } else if rise < 0.0
                && let Some(rising) = rising_at.take()
            {
                return Some(self.bisect(rising, t, TOLERANCE * detail));
            }
            index += 1.0;
        }
        None
    }

    /// Halves a bracket in which g stops rising until it is `tolerance` wide, or as narrow as `f64` allows.
    fn bisect(&self, mut rising: f64, mut falling: f64, tolerance: f64) -> f64 {
        while falling - rising > tolerance {
            let middle = 0.5 * (rising + falling);
            if middle <= rising || middle >= falling {
                break;
            }
            if self.sample(middle).is_some_and(|sample| sample.rise > 0.0) {
                rising = middle;
            } else {
                falling = middle;
            }
        }
        0.5 * (rising + falling)
    }

    fn crossing(&self, t: f64) -> Crossing {
        Crossing {
            // Uphill of the point the boundary is on its high side, so that the point is on the boundary's low side.
            distance: -self.uphill * t,
            gradient_magnitude: self.derivatives(t).gradient_magnitude(),
            value: self.scene.value(self.origin + t * self.direction),
        }
    }
}

impl Scene {
    /// The nearest authentic edge along the straight line through `point` in direction `±n`, `n = ∇f/‖∇f‖` at the point,
    /// on the side on which the gradient magnitude rises: uphill where f'' > 0, downhill where f'' < 0.
    ///
    /// An authentic edge is a zero crossing of `f'' = nᵀHn`, n that of each place, from + to − in the direction of growing
    /// values. It is found by samples a quarter of the smallest blur apart and bisected to 1e-10 of that blur. Where f'' is
    /// exactly 0 the point is on the edge itself if g has a maximum there; if g has a minimum both sides are searched and
    /// the nearer edge counts. `None` where nothing lies within `reach` (world units), or where the gradient vanishes or is
    /// below 1e-8 of that of a part, so that its direction is one of rounding.
    #[must_use]
    pub fn crossing(&self, point: DVec3, reach: f64) -> Option<Crossing> {
        let derivatives = self.derivatives(point);
        let normal = derivatives.direction().filter(|_| !self.parts_cancel(point, &derivatives))?;
        let detail = self.smallest_detail();
        let ray = |uphill: f64| Ray { scene: self, origin: point, direction: uphill * normal, uphill };
        let search = |uphill: f64| {
            let ray = ray(uphill);
            ray.first_crossing(reach, detail).map(|t| ray.crossing(t))
        };
        let second_derivative = derivatives.second_derivative();
        if second_derivative != 0.0 {
            return search(second_derivative.signum());
        }
        let [above, below] = [1.0, -1.0].map(|uphill| ray(uphill).sample(PROBE * detail).map(|sample| sample.rise));
        match (above?, below?) {
            (above, below) if above < 0.0 && below < 0.0 => Some(ray(1.0).crossing(0.0)),
            (above, below) if above > 0.0 && below > 0.0 => {
                let found = [search(1.0), search(-1.0)].into_iter().flatten();
                found.min_by(|a, b| a.distance.abs().total_cmp(&b.distance.abs()))
            }
            _ => None,
        }
    }

    fn parts_cancel(&self, point: DVec3, sum: &Derivatives) -> bool {
        if self.parts().nth(1).is_none() {
            return false;
        }
        let largest = self.parts().map(|part| part.derivatives(point).gradient_magnitude()).fold(0.0, f64::max);
        sum.gradient_magnitude() < CANCELLED * largest
    }

    /// [`Self::crossing`] of every voxel of a grid, x fastest, on all threads; the same for any number of them.
    ///
    /// Voxels farther than `reach` and two of the smallest blurs from every true surface are skipped and have none.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`] for a volume that does not fit.
    pub fn crossing_volume(&self, geometry: &GridGeometry, reach: f64) -> Result<Vec<Option<Crossing>>> {
        fill(geometry, |_, point| self.crossing_near(point, reach))
    }

    /// [`Self::crossing`] of the voxels with the given indices (x fastest), in their order, as
    /// [`Self::crossing_volume`] gives it.
    #[must_use]
    pub fn crossings_of(&self, geometry: &GridGeometry, voxels: &[usize], reach: f64) -> Vec<Option<Crossing>> {
        let world_from_index = geometry.world_from_index();
        let [width, height, _] = geometry.dims_usize();
        let of = |&voxel: &usize| {
            let index = [voxel % width, voxel / width % height, voxel / (width * height)].map(|i| i as f64);
            self.crossing_near(world_from_index.transform_point3(DVec3::from_array(index)), reach)
        };
        voxels.par_iter().with_min_len(64).map(of).collect()
    }

    /// [`Self::crossing`], but none far from every true surface.
    pub(super) fn crossing_near(&self, point: DVec3, reach: f64) -> Option<Crossing> {
        let limit = reach + 2.0 * self.smallest_detail();
        if self.signed_distance(point).is_some_and(|distance| distance.abs() > limit) {
            return None;
        }
        self.crossing(point, reach)
    }
}
