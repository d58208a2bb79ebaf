//! Crossings pinned down on a smooth reconstruction.

use super::{Tracer, Work};
use crate::reconstruction::{EdgeSample, Smooth};
use crate::root_finder::{Probed, RootFinder, bisect, chandrupatla};
use crate::sampler::Ray;

/// How far from a trilinear crossing that of a smooth reconstruction is looked for, in multiples of L_min. On
/// edges blurred by 0.7 voxels and more the two differ by a few hundredths.
const WINDOWS: [f32; 3] = [0.1, 0.25, 0.6];

impl Tracer<'_> {
    /// The crossing of a smooth reconstruction near a trilinear one, or that itself where there is none near. `None` where
    /// the ray leaves the volume.
    #[inline(always)]
    pub(super) fn refined(
        &self,
        smooth: &Smooth<'_>,
        up: &Ray,
        crossing: f32,
        work: &mut Work,
    ) -> Option<Probed<EdgeSample>> {
        let first = self.edge(smooth, up, crossing, work)?;
        // Upwards f'' falls from + to − at an authentic edge.
        let is_inside = first.1 > 0.0;
        let mut near = first;
        for window in WINDOWS {
            let Some(far) = self.edge(smooth, up, if is_inside { crossing + window } else { crossing - window }, work)
            else {
                break;
            };
            if (far.1 > 0.0) != is_inside {
                let (inside, outside) = if is_inside { (near, far) } else { (far, near) };
                return self.between(smooth, up, [inside, outside], work);
            }
            near = far;
        }
        Some(first)
    }

    /// The crossing of a smooth reconstruction between a place where f'' is positive and one where it is not.
    #[inline(always)]
    fn between(
        &self,
        smooth: &Smooth<'_>,
        up: &Ray,
        [inside, outside]: [Probed<EdgeSample>; 2],
        work: &mut Work,
    ) -> Option<Probed<EdgeSample>> {
        if self.root_finder == RootFinder::Bisection {
            let t = bisect(
                inside.0,
                outside.0,
                #[inline(always)]
                |t| matches!(self.edge(smooth, up, t, work), Some((_, edge, _)) if edge > 0.0),
            );
            return self.edge(smooth, up, t, work);
        }
        Some(chandrupatla(
            inside,
            outside,
            #[inline(always)]
            |t| match self.edge(smooth, up, t, work) {
                Some((_, edge, sample)) => (edge, sample),
                // Both ends lie in the volume, and so does what is between them.
                None => (f32::NAN, inside.2),
            },
        ))
    }

    /// A place on a ray with what a smooth reconstruction has there, or `None` outside the volume.
    #[inline(always)]
    fn edge(&self, smooth: &Smooth<'_>, up: &Ray, t: f32, work: &mut Work) -> Option<Probed<EdgeSample>> {
        let place = self.sampler.place(up, t)?;
        work.evaluations += 1;
        let sample = smooth.at(&place);
        Some((t, sample.edge, sample))
    }
}
