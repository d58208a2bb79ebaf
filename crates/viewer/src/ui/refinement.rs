//! When the window draws, and how finely: coarse while the hand moves, finer and finer once it rests, then not at all.

/// How long the hand must rest before the picture is refined, in seconds.
const REST: f64 = 0.15;
/// How long a picture may take while the hand moves, in seconds.
const DRAFT_BUDGET: f64 = 1.0 / 25.0;
/// How long a full picture may take for it to follow the draft without one between them, in seconds.
const DIRECT_BUDGET: f64 = 1.0;
/// How long the window may be deaf while it refines, in seconds: about as long as a software adapter takes to paint the
/// panels anew, so that it spends at least half of its time on the picture.
pub const PASS_BUDGET: f64 = 0.25;
/// How long one strip of rows should take, in seconds; rows differ, so that a pass is filled strip by strip.
const STRIP_BUDGET: f64 = 0.05;
/// Fewest rows of a strip: what each strip costs by itself must not become most of its cost.
const LEAST_STRIP: u32 = 8;
/// Work of the first strip, little for any device, and the most of any.
const FIRST_STRIP: f64 = 2e4;
const MOST_STRIP: f64 = 1e12;
/// The coarsest picture has one pixel for a square of this side.
const MOST_DIVISOR: u32 = 8;
/// The coarsest picture steps by this factor.
const MOST_STEP_FACTOR: f32 = 2.0;

/// How finely a picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// One pixel is drawn for a square of this side.
    pub divisor: u32,
    /// By how much longer the steps along a ray are than the settings'.
    pub step_factor: f32,
    /// Whether it is of a coarser level of the volume, which stands in for one that comes brick by brick.
    pub is_coarser: bool,
}

impl Detail {
    /// As the settings say.
    pub const FULL: Self = Self { divisor: 1, step_factor: 1.0, is_coarser: false };
}

/// What is to be done in this pass of the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// The state has changed: draw it at once.
    Draft(Detail),
    /// Draw the picture shown anew, or go on doing so, part by part.
    Refine(Detail),
    /// Come back after so many seconds.
    Wait(f64),
    /// Nothing until the next input.
    Rest,
}

/// Decides on [`Action`]s by what was drawn and how long it took.
///
/// Work is counted as by [`work`].
#[derive(Clone, Copy, Debug)]
pub struct Refinement {
    drawn: Option<Detail>,
    changed_at: f64,
    seconds_per_work: Option<f64>,
    first_draft: Detail,
    /// Whether all but the last picture are of a coarser level.
    has_coarser: bool,
}

impl Refinement {
    /// Nothing is drawn yet. Until the first picture is timed, a CPU is taken to be slow.
    #[must_use]
    pub fn new(is_cpu: bool) -> Self {
        let divisor = if is_cpu { 4 } else { 2 };
        let first_draft = Detail { divisor, step_factor: MOST_STEP_FACTOR, is_coarser: false };
        Self { drawn: None, changed_at: f64::NEG_INFINITY, seconds_per_work: None, first_draft, has_coarser: false }
    }

    /// Whether what draws stands in, from now on, for what takes its time, as a coarser level does for one that comes brick by
    /// brick: of that one picture is drawn then, the last.
    pub fn set_coarser(&mut self, has_coarser: bool) {
        self.has_coarser = has_coarser;
        for detail in self.drawn.iter_mut().chain([&mut self.first_draft]) {
            detail.is_coarser = has_coarser;
        }
    }

    /// Takes note of a picture that cannot be drawn: none is, until there is a change.
    pub fn failed(&mut self) {
        self.drawn = Some(Detail::FULL);
    }

    /// What to do at time `now` in seconds. `changed`: the picture shown is no longer the one wanted; `hand_down`: a
    /// button is pressed; `work`: the full picture's.
    pub fn next(&mut self, changed: bool, hand_down: bool, now: f64, work: f64) -> Action {
        let Some(drawn) = self.drawn.filter(|_| !changed) else {
            self.changed_at = now;
            return Action::Draft(self.draft(work));
        };
        if drawn == Detail::FULL || hand_down {
            return Action::Rest;
        }
        let left = self.changed_at + REST - now;
        if left > 0.0 { Action::Wait(left) } else { Action::Refine(self.finer(drawn, work)) }
    }

    /// Takes note of a finished picture: how fine it was, how long it took, and its own work.
    pub fn finished(&mut self, detail: Detail, seconds: f64, work: f64) {
        self.drawn = Some(detail);
        if detail.is_coarser != self.has_coarser {
            // Another drawer's, which no draft is like.
            return;
        }
        self.seconds_per_work = Some(seconds / work.max(1.0));
        // A slow draft must not use up the rest after it: it would never be seen.
        self.changed_at += seconds;
    }

    /// The finest detail that keeps within the budget: longer steps first, then fewer pixels.
    fn draft(&self, work: f64) -> Detail {
        let Some(seconds_per_work) = self.seconds_per_work else {
            return self.first_draft;
        };
        let excess = seconds_per_work * work / DRAFT_BUDGET;
        if excess <= 1.0 {
            return self.best();
        }
        let step_factor = (excess as f32).min(MOST_STEP_FACTOR);
        let divisor = (excess / f64::from(step_factor)).sqrt().ceil() as u32;
        Detail { divisor: divisor.clamp(1, MOST_DIVISOR), step_factor, is_coarser: self.has_coarser }
    }

    /// What follows `drawn`: the full picture if that is soon done, else one with four times the pixels.
    fn finer(&self, drawn: Detail, work: f64) -> Detail {
        let best = self.best();
        if drawn == best {
            return Detail::FULL;
        }
        let soon_done = self.seconds_per_work.is_some_and(|seconds| seconds * work <= DIRECT_BUDGET);
        if soon_done { best } else { Detail { divisor: (drawn.divisor / 2).max(1), ..best } }
    }

    /// As the settings say, but for the level.
    fn best(&self) -> Detail {
        Detail { is_coarser: self.has_coarser, ..Detail::FULL }
    }
}

/// How much of a picture to draw at once, by how long what was drawn before took.
#[derive(Clone, Copy, Debug)]
pub struct StripLength {
    work: f64,
}

impl Default for StripLength {
    fn default() -> Self {
        Self { work: FIRST_STRIP }
    }
}

impl StripLength {
    /// How many rows of `row_work` each to draw at once.
    #[must_use]
    pub fn rows(&self, row_work: f64) -> u32 {
        (self.work / row_work.max(1.0)).clamp(f64::from(LEAST_STRIP), 65_536.0) as u32
    }

    /// Takes note of how long a strip took: the next one grows or shrinks. By the strip itself and not by a picture's
    /// average, because that holds what many small strips cost, and would make them smaller still.
    pub fn drawn(&mut self, seconds: f64) {
        if seconds < 0.5 * STRIP_BUDGET {
            self.work *= 2.0;
        } else if seconds > 2.0 * STRIP_BUDGET {
            self.work *= 0.5;
        }
        self.work = self.work.clamp(1.0, MOST_STRIP);
    }
}

/// Pixels times samples per `L_min`.
#[must_use]
pub fn work([width, height]: [u32; 2], step: f32) -> f64 {
    f64::from(width) * f64::from(height) / f64::from(step.max(1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORK: f64 = 1e6;

    fn timed(seconds: f64) -> Refinement {
        let mut refinement = Refinement::new(true);
        refinement.finished(Detail::FULL, seconds, WORK);
        refinement
    }

    fn draft(action: Action) -> Detail {
        match action {
            Action::Draft(detail) => detail,
            other => panic!("a change is drawn, not {other:?}"),
        }
    }

    #[test]
    fn a_slow_device_drafts_and_refines_once_the_hand_rests() {
        let mut refinement = timed(1.0);
        let detail = draft(refinement.next(true, true, 10.0, WORK));
        assert_eq!(detail, Detail { divisor: 4, step_factor: 2.0, is_coarser: false });
        refinement.finished(detail, 0.03, WORK / 32.0);
        // The hand is still down, then lifted, then rests long enough.
        assert_eq!(refinement.next(false, true, 10.5, WORK), Action::Rest);
        assert!(matches!(refinement.next(false, false, 10.05, WORK), Action::Wait(left) if (left - 0.13).abs() < 1e-9));
        assert_eq!(refinement.next(false, false, 10.2, WORK), Action::Refine(Detail::FULL));
        refinement.finished(Detail::FULL, 1.0, WORK);
        assert_eq!(refinement.next(false, false, 11.0, WORK), Action::Rest);
    }

    #[test]
    fn a_very_slow_device_refines_by_steps() {
        let mut refinement = timed(20.0);
        let mut detail = draft(refinement.next(true, false, 0.0, WORK));
        assert_eq!(detail.divisor, MOST_DIVISOR);
        for divisor in [4, 2, 1] {
            refinement.finished(detail, 0.1, WORK / 200.0);
            let Action::Refine(next) = refinement.next(false, false, 100.0, WORK) else { panic!("{detail:?}") };
            assert_eq!(next, Detail { divisor, ..Detail::FULL });
            detail = next;
        }
    }

    #[test]
    fn strips_grow_on_a_fast_device_and_shrink_on_a_slow_one() {
        let mut strip = StripLength::default();
        let first = strip.rows(100.0);
        strip.drawn(0.001);
        assert_eq!(strip.rows(100.0), 2 * first);
        (0..3).for_each(|_| strip.drawn(1.0));
        assert_eq!(strip.rows(100.0), first / 4);
        (0..100).for_each(|_| strip.drawn(1.0));
        assert_eq!(strip.rows(100.0), LEAST_STRIP);
        (0..100).for_each(|_| strip.drawn(0.0));
        assert_eq!(strip.rows(100.0), 65_536);
    }

    #[test]
    fn a_slow_draft_is_seen_before_it_is_refined() {
        let mut refinement = timed(20.0);
        let detail = draft(refinement.next(true, false, 10.0, WORK));
        refinement.finished(detail, 1.0, WORK / 128.0);
        assert!(matches!(refinement.next(false, false, 11.0, WORK), Action::Wait(_)));
    }

    #[test]
    fn a_fast_device_always_draws_in_full() {
        assert_eq!(draft(timed(0.01).next(true, true, 0.0, WORK)), Detail::FULL);
    }

    #[test]
    fn a_coarser_level_is_refined_in_full_before_the_finest_is_drawn() {
        let mut refinement = timed(1.0);
        refinement.set_coarser(true);
        // What was the full picture until now is that no longer.
        assert_eq!(refinement.next(false, false, 10.0, WORK), Action::Refine(Detail::FULL));
        refinement.finished(Detail::FULL, 60.0, WORK);
        assert_eq!(refinement.next(false, false, 70.0, WORK), Action::Rest);
        let detail = draft(refinement.next(true, true, 80.0, WORK));
        assert_eq!(
            detail,
            Detail { divisor: 4, step_factor: 2.0, is_coarser: true },
            "by the coarser level's own time"
        );
        refinement.finished(detail, 0.03, WORK / 32.0);
        let whole = Detail { is_coarser: true, ..Detail::FULL };
        assert_eq!(refinement.next(false, false, 90.0, WORK), Action::Refine(whole));
        refinement.finished(whole, 1.0, WORK);
        assert_eq!(refinement.next(false, false, 100.0, WORK), Action::Refine(Detail::FULL));
        refinement.failed();
        assert_eq!(refinement.next(false, false, 100.0, WORK), Action::Rest);
        assert!(matches!(refinement.next(true, false, 110.0, WORK), Action::Draft(_)));
    }

    #[test]
    fn the_first_picture_is_a_draft() {
        assert_ne!(draft(Refinement::new(true).next(false, false, 0.0, WORK)), Detail::FULL);
    }
}
