//! What the roles of a phantom's voxels should be.

use glam::DVec3;
use voxrole_pack::GridGeometry;

use super::Case;
use crate::Result;
use crate::phantom::{Crossing, Quantization, Scene, TRUTH_REACH};

/// Voxels up to this many blurs from a boundary are near it: they hold almost all that is seen of it.
const NEAR: f64 = 2.0;
/// Up to this many blurs they are around it: its gradient is there down to 3e-4 of its largest.
const AROUND: f64 = 4.0;
/// How many voxels around boundaries are looked at, at most about.
const MOST_AROUND: usize = 20_000;
/// Boundaries closer than this to the last voxels, in voxels, depend on how the volume is continued beyond them.
const MARGIN: f64 = 4.0;

/// The exact role of a voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Index of the voxel, x fastest.
    pub voxel: usize,
    /// Signed distance along its gradient to the formula's zero crossing of f'', in multiples of L_min.
    pub crossing: f64,
    /// Signed distance to the sharp surface that was blurred, in multiples of L_min.
    pub surface: Option<f64>,
    /// Gradient magnitude on the crossing, in stored value per world unit.
    pub gradient_magnitude: f64,
    /// Which of the scene's boundaries is the nearest, where its parts are boundaries.
    pub boundary: Option<usize>,
}

/// The exact roles of a case's voxels. Voxels whose gradient leads to no crossing within the volume are in none of these
/// lists but the empty ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Voxels within two blurs of the true surface; of a scene without one, of their crossing.
    pub near: Vec<Expected>,
    /// The same, where the voxel or its crossing is less than four voxels from the volume's border.
    pub border: Vec<Expected>,
    /// A sample of the voxels from two to four blurs.
    pub around: Vec<Expected>,
    /// Voxels farther than d_max and two blurs from every true surface, at which no ray of theirs can arrive.
    pub empty: Vec<usize>,
    /// The same, less than four voxels from the volume's border, where noise is continued and smooths less well.
    pub border_empty: Vec<usize>,
    /// Stored numbers per unit of the scene's value.
    pub stored_per_value: f64,
}

impl Truth {
    /// Works out the truth of a case.
    ///
    /// # Errors
    /// As [`crate::phantom::Phantom::scene`].
    pub fn new(case: &Case) -> Result<Self> {
        let settings = case.phantom_settings();
        let scene = case.phantom.scene(&settings)?;
        let quantization = settings.quantization.or_else(|| Quantization::of(settings.scalar_type));
        let measures = Measures {
            scene: &scene,
            smallest_spacing: settings.geometry().smallest_spacing(),
            stored_per_value: quantization.map_or(1.0, |Quantization { plateaus: [low, high], .. }| {
                (high - low) / (scene.value_range[1] - scene.value_range[0])
            }),
            geometry: settings.geometry(),
        };
        Ok(measures.truth(case.blur))
    }
}

struct Measures<'a> {
    scene: &'a Scene,
    geometry: GridGeometry,
    smallest_spacing: f64,
    stored_per_value: f64,
}

impl Measures<'_> {
    /// `blur` is in multiples of L_min.
    fn truth(&self, blur: f64) -> Truth {
        let mut truth = Truth { stored_per_value: self.stored_per_value, ..Truth::default() };
        let (mut near, mut around) = (Vec::new(), Vec::new());
        for voxel in 0..self.geometry.voxel_count() {
            match self.surface(voxel).map(f64::abs) {
                None => near.push(voxel),
                Some(distance) if distance <= NEAR * blur => near.push(voxel),
                Some(distance) if distance <= AROUND * blur => around.push(voxel),
                Some(distance) if distance > TRUTH_REACH + NEAR * blur => {
                    let inside = self.margin(self.point(voxel)) >= MARGIN;
                    (if inside { &mut truth.empty } else { &mut truth.border_empty }).push(voxel);
                }
                Some(_) => {}
            }
        }
        let stride = around.len().div_ceil(MOST_AROUND).max(1);
        around = around.into_iter().step_by(stride).collect();
        for (expected, margin) in self.expected(&around) {
            if margin >= MARGIN {
                truth.around.push(expected);
            }
        }
        for (expected, margin) in self.expected(&near) {
            if expected.surface.is_some() || expected.crossing.abs() <= NEAR * blur {
                (if margin >= MARGIN { &mut truth.near } else { &mut truth.border }).push(expected);
            }
        }
        truth
    }

    /// The truth of voxels that have a crossing within the volume, and how many voxels from its border voxel and crossing
    /// are.
    fn expected(&self, voxels: &[usize]) -> Vec<(Expected, f64)> {
        let reach = TRUTH_REACH * self.smallest_spacing;
        let crossings = self.scene.crossings_of(&self.geometry, voxels, reach);
        let of = |(&voxel, crossing): (&usize, Option<Crossing>)| {
            let Crossing { distance, gradient_magnitude, .. } = crossing?;
            let point = self.point(voxel);
            let place = point - distance * self.scene.gradient(point).normalize_or_zero();
            let margin = self.margin(point).min(self.margin(place));
            let expected = Expected {
                voxel,
                crossing: distance / self.smallest_spacing,
                surface: self.surface(voxel),
                gradient_magnitude: gradient_magnitude * self.stored_per_value,
                boundary: self.nearest_boundary(point),
            };
            (margin >= 0.0).then_some((expected, margin))
        };
        voxels.iter().zip(crossings).filter_map(of).collect()
    }

    fn point(&self, voxel: usize) -> DVec3 {
        let [width, height, _] = self.geometry.dims_usize();
        let index = [voxel % width, voxel / width % height, voxel / (width * height)].map(|i| i as f64);
        self.geometry.world_from_index().transform_point3(DVec3::from_array(index))
    }

    /// Signed distance to the true surface in multiples of L_min.
    fn surface(&self, voxel: usize) -> Option<f64> {
        self.scene.signed_distance(self.point(voxel)).map(|distance| distance / self.smallest_spacing)
    }

    fn nearest_boundary(&self, point: DVec3) -> Option<usize> {
        let depths = self.scene.boundaries.iter().map(|boundary| boundary.surface.depth(point).abs());
        depths.enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(index, _)| index)
    }

    /// Voxels from a point to the centres of the volume's outermost voxels; negative outside.
    fn margin(&self, point: DVec3) -> f64 {
        let index = self.geometry.world_from_index().inverse().transform_point3(point);
        let last = DVec3::from_array(self.geometry.dims.map(|dim| f64::from(dim) - 1.0));
        index.min(last - index).min_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::Phantom;

    #[test]
    fn the_ball_is_known_in_all_its_parts() {
        let truth = Truth::new(&Case { blur: 1.0, ..Case::base(Phantom::Ball, 48) }).expect("a ball");
        // A shell of radius 15 and thickness 4, and one of the same middle and thickness 8 without it.
        let shell = |half: f64| 4.0 / 3.0 * std::f64::consts::PI * ((15.0 + half).powi(3) - (15.0 - half).powi(3));
        assert!((truth.near.len() as f64 / shell(2.0) - 1.0).abs() < 0.02, "{}", truth.near.len());
        assert!((truth.around.len() as f64 / (shell(4.0) - shell(2.0)) - 1.0).abs() < 0.02, "{}", truth.around.len());
        // The profile follows the distance, so that surface and crossing are one.
        let apart = |expected: &Expected| (expected.surface.unwrap_or(f64::NAN) - expected.crossing).abs();
        assert!(truth.near.iter().all(|expected| apart(expected) < 1e-6 && expected.boundary == Some(0)));
        let steepest = (2.0 * std::f64::consts::PI).sqrt().recip();
        assert!(truth.near.iter().all(|expected| (expected.gradient_magnitude - steepest).abs() < 1e-9));
        assert!(!truth.border_empty.is_empty() && truth.border.is_empty());
    }

    #[test]
    fn crossings_beyond_the_volume_are_not_expected() {
        let truth = Truth::new(&Case::base(Phantom::SlabPair, 32)).expect("slabs");
        assert!(truth.near.len() > 5000 && truth.border.len() > 2000);
        let faces: std::collections::BTreeSet<_> = truth.near.iter().map(|expected| expected.boundary).collect();
        assert_eq!(faces.len(), 4);
        let signal = Truth::new(&Case::base(Phantom::MarschnerLobb, 32)).expect("a signal");
        assert!(signal.near.iter().all(|expected| expected.surface.is_none() && expected.crossing.abs() <= 3.0));
        assert!(signal.near.len() > 3000 && signal.empty.is_empty());
    }

    #[test]
    fn gradients_are_in_stored_numbers() {
        let of = |dtype| Truth::new(&Case { dtype, ..Case::base(Phantom::Ball, 32) }).expect("a ball").near[0];
        let float = of(super::super::Dtype::F32).gradient_magnitude;
        let byte = of(super::super::Dtype::U8).gradient_magnitude;
        assert!((byte / float - 215.0).abs() < 1e-9);
    }
}
