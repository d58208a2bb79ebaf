//! From a voxel to the boundary that decides its role.
//!
//! Along a ray in direction ±n the rise of the gradient magnitude is `q(t) = ±f''(x ± t·n)`, because f'' is the
//! derivative of g along n. An authentic edge is where q falls from positive to negative: there g has a maximum, and f''
//! goes from + to − in the direction of growing f, whichever way the ray runs. The opposite crossing is a minimum of g, a
//! phantom edge, and is never a hit.

use glam::Vec3;

use crate::differentiation::Gradient;
use crate::directional_derivative::Derivatives;
use crate::reconstruction::Smooth;
use crate::root_finder::{HALVINGS, RootFinder, bisect, chandrupatla, first_fall_of_cubic};
use crate::sampler::{Corners, Ray, Sampler, Span};
use crate::settings::{Climb, Settings};
use crate::working_field::{WorkingField, voxels};
use crate::zero_crossing::CellDistances;

mod brackets;
mod floor;
mod leaping;
mod refinement;

pub(crate) use brackets::{Brackets, LANES};
pub use floor::{GRADIENT_FLOOR, GradientFloor};

use brackets::Bracket;

/// With steps above this share of L_min a ray could jump over a corner of a mixed cell unseen, so nothing is leapt over.
const LARGEST_LEAPING_STEP: f32 = 0.9;

/// Where a voxel stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// A sample of its stencil is NaN or infinite.
    Masked,
    /// No boundary within `d_max` along its gradient, or no gradient.
    Miss,
    /// A boundary.
    Hit(BoundaryHit),
}

/// The boundary of one voxel, in working units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryHit {
    /// Distance to it in multiples of L_min, positive for a voxel on the high-value side.
    pub distance: f32,
    /// Gradient magnitude there.
    pub gradient_magnitude: f32,
    /// Value there.
    pub value: f32,
    /// n at the voxel, in grid axes.
    pub normal: Vec3,
}

/// What tracing a voxel came to.
pub(crate) enum Traced {
    /// All is known.
    Role(Role),
    /// The boundary's place is still to be pinned down.
    Bracketed(Bracketed),
}

/// A voxel with a boundary somewhere within a bracket.
pub(crate) struct Bracketed {
    pub(crate) bracket: Bracket,
    /// 1 where the bracket lies on `up`, −1 where on the opposite ray.
    side: f32,
    up: Ray,
    normal: Vec3,
}

/// Where along a ray f'' changes its sign.
enum Crossing {
    Nowhere,
    At(f32),
    Within(Bracket),
}

impl Crossing {
    fn place(&self) -> Option<f32> {
        match self {
            Self::Nowhere => None,
            Self::At(t) => Some(*t),
            Self::Within(bracket) => Some(bracket.bisect()),
        }
    }
}

/// How much was done for a set of voxels; the same for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Voxels without a gradient above the floor.
    pub flat: u64,
    /// Voxels whose rays met no cell in which they could hit.
    pub skipped: u64,
    /// Voxels for which at least one sample was taken.
    pub traced: u64,
    /// Samples of f'' taken step by step along rays.
    pub samples: u64,
    /// Evaluations that pin crossings down: of trilinear f'', and of a smooth reconstruction.
    pub evaluations: u64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.flat += other.flat;
        self.skipped += other.skipped;
        self.traced += other.traced;
        self.samples += other.samples;
        self.evaluations += other.evaluations;
    }
}

/// Finds the boundary of single voxels.
pub struct Tracer<'a> {
    values: &'a [f32],
    gradient_magnitude: &'a [f32],
    second_derivative: &'a [f32],
    cells: Option<&'a CellDistances>,
    floor: &'a GradientFloor,
    /// What every boundary's gradient is above.
    least_gradient: f32,
    gradient: Gradient<'a>,
    smooth: Option<Smooth<'a>>,
    root_finder: RootFinder,
    sampler: Sampler,
    dims: [usize; 3],
    /// From a direction in units of L_min to voxels.
    index_from_length: Vec3,
    step: f32,
    /// Steps per unit of a ray's parameter, and a little less for rounding.
    safe_steps_per_length: f32,
    last_step: u32,
    /// Where it ends: the last step may be a shorter one.
    last_place: f32,
    d_max: f32,
    climb: Climb,
}

/// A ray, and the sign that makes f'' the rise of g along it.
#[derive(Clone, Copy)]
struct SignedRay {
    ray: Ray,
    sign: f32,
}

impl<'a> Tracer<'a> {
    /// A tracer over a field and its (possibly smoothed) derivatives. `cells` are those of the same f''. Crossings are
    /// refined on `smooth`, where there is one. Gradients up to `floor` are no boundary.
    #[must_use]
    pub fn new(
        field: &'a WorkingField,
        derivatives: &'a Derivatives,
        cells: &'a CellDistances,
        gradient: Gradient<'a>,
        smooth: Option<Smooth<'a>>,
        floor: &'a GradientFloor,
        settings: &Settings,
    ) -> Self {
        let step = settings.step as f32;
        let leaps = settings.skip && step <= LARGEST_LEAPING_STEP;
        Self {
            values: voxels(&field.values),
            gradient_magnitude: voxels(&derivatives.gradient_magnitude),
            second_derivative: voxels(&derivatives.second_derivative),
            cells: leaps.then_some(cells),
            floor,
            least_gradient: floor.least(),
            gradient,
            smooth,
            root_finder: settings.root_finder(),
            sampler: Sampler::new(field.dims()),
            dims: field.dims(),
            index_from_length: Vec3::from_array(field.spacing.map(f32::recip)),
            step,
            safe_steps_per_length: (1.0 - 1e-5) / step,
            last_step: (settings.d_max / settings.step * (1.0 - 1e-9)).ceil() as u32,
            last_place: settings.d_max as f32,
            // The last sample may lie at d_max itself, and so may a crossing but for rounding.
            d_max: (settings.d_max * (1.0 + 1e-6)) as f32,
            climb: settings.climb,
        }
    }

    /// Whether none of a run of voxels along x has a gradient that could be a boundary's, nor is masked.
    #[inline(always)]
    #[must_use]
    pub fn is_flat(&self, [x, y, z]: [usize; 3], len: usize) -> bool {
        let first = (z * self.dims[1] + y) * self.dims[0] + x;
        let gradients = &self.gradient_magnitude[first..first + len];
        let seconds = &self.second_derivative[first..first + len];
        let mut flat = true;
        for at in 0..len {
            flat &= gradients[at] <= self.least_gradient && !seconds[at].is_nan();
        }
        flat
    }

    /// The role of one voxel.
    pub fn role(&self, voxel: [usize; 3], work: &mut Work) -> Role {
        match self.trace(voxel, work) {
            Traced::Role(role) => role,
            Traced::Bracketed(bracketed) => self.role_at(&bracketed, bracketed.bracket.bisect(), work),
        }
    }

    /// The role of a voxel whose boundary was pinned down at parameter `t` of its bracket.
    #[inline(always)]
    pub(crate) fn role_at(&self, Bracketed { side, up, normal, .. }: &Bracketed, t: f32, work: &mut Work) -> Role {
        self.hit(up, side * t, *normal, work).map_or(Role::Miss, Role::Hit)
    }

    /// The role of one voxel, or where it has to be looked for.
    #[inline(always)]
    pub(crate) fn trace(&self, voxel: [usize; 3], work: &mut Work) -> Traced {
        let index = (voxel[2] * self.dims[1] + voxel[1]) * self.dims[0] + voxel[0];
        let second = self.second_derivative[index];
        if second.is_nan() {
            return Traced::Role(Role::Masked);
        }
        let is_steep = self.gradient_magnitude[index] > self.floor.at(voxel, self.values[index]);
        let gradient = if is_steep { self.gradient.at(voxel) } else { Vec3::ZERO };
        let magnitude = gradient.length();
        if magnitude <= GRADIENT_FLOOR {
            work.flat += 1;
            return Traced::Role(Role::Miss);
        }
        let normal = gradient / magnitude;
        let up = SignedRay { ray: self.sampler.ray(voxel, normal * self.index_from_length), sign: 1.0 };
        let down = SignedRay { ray: up.ray.reversed(), sign: -1.0 };
        let before = work.samples;
        let (crossing, side) = match self.climb {
            Climb::Literal => (self.literal(up, down, index, work).map_or(Crossing::Nowhere, Crossing::At), 1.0),
            Climb::Release => self.release(up, down, second, work),
        };
        *(if work.samples > before { &mut work.traced } else { &mut work.skipped }) += 1;
        match crossing {
            Crossing::Nowhere => Traced::Role(Role::Miss),
            Crossing::At(t) => Traced::Role(self.hit(&up.ray, side * t, normal, work).map_or(Role::Miss, Role::Hit)),
            Crossing::Within(bracket) => Traced::Bracketed(Bracketed { bracket, side, up: up.ray, normal }),
        }
    }

    /// Only a rise of g along the other ray stops a ray.
    ///
    /// Departs from the paper's wording, which stops a ray whose own samples of g fall: trilinear interpolation of a
    /// concave g lies below the grid's values, so near the maximum both rays seem to fall at once, and a fifth of the
    /// boundary's voxels would be lost. Which ray rises is read off f'' at the voxel itself, the derivative of g along n.
    ///
    /// Returns the crossing and the sign of its parameter on `up`.
    #[inline(always)]
    fn release(&self, up: SignedRay, down: SignedRay, second: f32, work: &mut Work) -> (Crossing, f32) {
        if second != 0.0 {
            let ray = if second > 0.0 { up } else { down };
            return (self.climb_from(ray, 0, second.abs(), work), ray.sign);
        }
        (self.off_plateau(up, down, work).map_or(Crossing::Nowhere, Crossing::At), 1.0)
    }

    /// Where the nearer of the two rays hits that start on a plateau of f''.
    fn off_plateau(&self, up: SignedRay, down: SignedRay, work: &mut Work) -> Option<f32> {
        // f'' is exactly 0: on a plateau of f'', a maximum of g or a minimum.
        let (first_up, first_down) = (self.leave_plateau(up, work), self.leave_plateau(down, work));
        match (first_up, first_down) {
            (Some((_, Rise::Falls(end))), Some((_, Rise::Falls(start)))) => Some(0.5 * (end - start)),
            _ => {
                let climbed = |first: Option<(u32, Rise)>, ray: SignedRay, work: &mut Work| match first {
                    Some((k, Rise::Rises)) => self.climb_from(ray, k, 0.0, work).place(),
                    _ => None,
                };
                let above = climbed(first_up, up, work);
                let below = climbed(first_down, down, work);
                nearest(above, below)
            }
        }
    }

    /// Refines a crossing seen between samples `start`, where q is positive, and `k`, where it is negative. If q is 0 in
    /// between, the crossing is the middle of that plateau. `None` when a masked voxel lies in between: then what
    /// changes the sign is unknown.
    #[inline(always)]
    fn refine(&self, signed: SignedRay, start: u32, k: u32, work: &mut Work) -> Crossing {
        let mut probe = Probe { tracer: self, signed, cell: None, known: true, work };
        let mut last_positive = k - 1;
        while last_positive > start && probe.rise(self.t(last_positive)) <= 0.0 {
            last_positive -= 1;
        }
        if probe.known && self.smooth.is_none() && self.root_finder == RootFinder::Bisection && last_positive + 1 == k {
            return self.bracket([self.t(last_positive), self.t(k)], probe);
        }
        let begin = self.fall([self.t(last_positive), self.t(last_positive + 1)], &mut probe);
        let crossing = if last_positive + 1 == k {
            begin
        } else {
            0.5 * (begin + bisect(self.t(k - 1), self.t(k), |t| probe.rise(t) >= 0.0))
        };
        if probe.known { Crossing::At(crossing) } else { Crossing::Nowhere }
    }

    /// Bisects until the bracket lies in one cell.
    #[inline(always)]
    fn bracket(&self, mut ends: [f32; 2], mut probe: Probe<'_, 'a>) -> Crossing {
        let SignedRay { ray, sign } = probe.signed;
        for done in 0..HALVINGS {
            if let Some(span) = self.sampler.span(self.second_derivative, &ray, ends) {
                let halvings = HALVINGS - done;
                probe.work.evaluations += u64::from(halvings);
                let span = Span { corners: span.corners.times(sign), ..span };
                return Crossing::Within(Bracket { span, direction: ray.direction(), ends, halvings });
            }
            let middle = 0.5 * (ends[0] + ends[1]);
            ends[usize::from(probe.rise(middle) <= 0.0)] = middle;
            if !probe.known {
                return Crossing::Nowhere;
            }
        }
        Crossing::At(0.5 * (ends[0] + ends[1]))
    }

    /// The paper's rule as printed: both rays go on step by step; one whose g has fallen is stopped, and the other goes on
    /// until it hits.
    fn literal(&self, up: SignedRay, down: SignedRay, index: usize, work: &mut Work) -> Option<f32> {
        let start = |signed: SignedRay| LiteralRay {
            signed,
            gradient_magnitude: self.gradient_magnitude[index],
            positive_at: (signed.sign * self.second_derivative[index] > 0.0).then_some(0),
            alive: true,
        };
        let mut rays = [start(up), start(down)];
        for k in 1..=self.last_step {
            let both = rays[0].alive && rays[1].alive;
            let mut hits = [None; 2];
            for (ray, hit) in rays.iter_mut().zip(&mut hits).filter(|(ray, _)| ray.alive) {
                *hit = self.literal_step(ray, k, both, work);
            }
            if let Some(t) = nearest(hits[0], hits[1]) {
                return Some(t);
            }
            if !rays[0].alive && !rays[1].alive {
                return None;
            }
        }
        None
    }

    /// Takes one step of one ray; the parameter of its hit, if it has one now.
    fn literal_step(&self, ray: &mut LiteralRay, k: u32, both_alive: bool, work: &mut Work) -> Option<f32> {
        let place = self.sampler.place(&ray.signed.ray, self.t(k));
        let Some(place) = place else {
            ray.alive = false;
            return None;
        };
        work.samples += 1;
        let q = ray.signed.sign * self.sampler.trilinear(self.second_derivative, &place);
        let gradient_magnitude = self.sampler.trilinear(self.gradient_magnitude, &place);
        if q.is_nan() || gradient_magnitude.is_nan() {
            ray.alive = false;
            return None;
        }
        if q < 0.0
            && let Some(start) = ray.positive_at
        {
            let crossing = self.refine(ray.signed, start, k, work).place();
            ray.alive = crossing.is_some();
            return crossing;
        }
        if q != 0.0 {
            ray.positive_at = (q > 0.0).then_some(k);
        }
        ray.alive = !(both_alive && gradient_magnitude < ray.gradient_magnitude);
        ray.gradient_magnitude = gradient_magnitude;
        None
    }

    /// Where trilinear q falls through 0 between two places.
    #[inline(always)]
    fn fall(&self, [from, to]: [f32; 2], probe: &mut Probe<'_, 'a>) -> f32 {
        if self.smooth.is_some() {
            // To be refined on another reconstruction: a secant leads near enough.
            let (above, below) = (probe.rise(from), probe.rise(to));
            return from + (to - from) * (above / (above - below)).clamp(0.0, 1.0);
        }
        match self.root_finder {
            RootFinder::Bisection => bisect(
                from,
                to,
                #[inline(always)]
                |t| probe.rise(t) > 0.0,
            ),
            RootFinder::Chandrupatla => {
                let [inside, outside] = [from, to].map(|t| (t, probe.rise(t), ()));
                chandrupatla(inside, outside, |t| (probe.rise(t), ())).0
            }
            RootFinder::Cubic => {
                let mut start = from;
                for end in probe.signed.ray.planes_between(from, to).into_iter().chain([to]) {
                    let at = |share: f32| start + share * (end - start);
                    let values = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(|share| probe.rise(at(share)));
                    if let Some(share) = first_fall_of_cubic(values) {
                        return at(share);
                    }
                    start = end;
                }
                to
            }
        }
    }

    #[inline(always)]
    fn hit(&self, up: &Ray, crossing: f32, normal: Vec3, work: &mut Work) -> Option<BoundaryHit> {
        let (t, place, gradient_magnitude, value) = match &self.smooth {
            None => {
                let place = self.sampler.place(up, crossing)?;
                let g = self.sampler.trilinear(self.gradient_magnitude, &place);
                let value = self.sampler.trilinear(self.values, &place);
                (crossing, place, g, value)
            }
            Some(smooth) => {
                let (t, _, found) = self.refined(smooth, up, crossing, work)?;
                (t, self.sampler.place(up, t)?, found.gradient_magnitude, found.value)
            }
        };
        (gradient_magnitude > self.floor.at(place.cell, value) && t.abs() <= self.d_max).then_some(BoundaryHit {
            // A voxel from which the boundary lies upwards is on its low side.
            distance: -t,
            gradient_magnitude,
            value,
            normal,
        })
    }

    /// What the gradient of every boundary at such a value is above, in working units.
    #[inline(always)]
    pub(crate) fn least_gradient(&self, value: f32) -> f32 {
        self.floor.least_at(value)
    }

    /// The sampler of the fields.
    #[must_use]
    pub fn sampler(&self) -> Sampler {
        self.sampler
    }

    fn t(&self, k: u32) -> f32 {
        (k as f32 * self.step).min(self.last_place)
    }
}

/// Evaluates q within a bracket, most of which lies in one cell.
struct Probe<'t, 'a> {
    tracer: &'t Tracer<'a>,
    signed: SignedRay,
    /// The cell of the last evaluation.
    cell: Option<([usize; 3], Corners)>,
    /// No evaluation was masked.
    known: bool,
    work: &'t mut Work,
}

impl Probe<'_, '_> {
    /// q(t), NaN where it is masked.
    #[inline(always)]
    fn rise(&mut self, t: f32) -> f32 {
        self.work.evaluations += 1;
        let Some(place) = self.tracer.sampler.place(&self.signed.ray, t) else {
            self.known = false;
            return f32::NAN;
        };
        let corners = match self.cell {
            Some((cell, corners)) if cell == place.cell => corners,
            _ => self.tracer.sampler.corners(self.tracer.second_derivative, place.cell),
        };
        self.cell = Some((place.cell, corners));
        let q = self.signed.sign * corners.interpolate(place.fraction);
        self.known &= !q.is_nan();
        q
    }
}

/// What g does where a ray leaves a plateau of f''.
#[derive(Clone, Copy)]
enum Rise {
    Rises,
    /// The parameter at which the plateau ends.
    Falls(f32),
}

struct LiteralRay {
    signed: SignedRay,
    gradient_magnitude: f32,
    /// The last sample with q above 0, unless it was below 0 since.
    positive_at: Option<u32>,
    alive: bool,
}

/// Of a hit upwards and one downwards the nearer, signed along n.
fn nearest(up: Option<f32>, down: Option<f32>) -> Option<f32> {
    match (up, down) {
        (Some(up), Some(down)) => Some(if up <= down { up } else { -down }),
        (up, down) => up.or(down.map(|t| -t)),
    }
}

#[cfg(test)]
mod tests;
