//! Measures placements on a scene under growing noise.

use super::faces::faces_kept;
use crate::accuracy::{Case, Figures, Method, Row, Truth, chosen, own, roles_of, timed};
use crate::phantom::Phantom;
use crate::prepare::Prepared;
use crate::settings::{Automatic, Settings, Smoothing};
use crate::{Grid, Result};

/// One placement on one case.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyRow {
    /// Case, method, time and figures.
    pub row: Row,
    /// What is left of the slabs' worst face, by [`faces_kept`]; absent for other phantoms.
    pub faces_kept: Option<f64>,
}

/// A scene that is measured under any noise: its truth, its volume without noise, and the roles found there.
#[derive(Debug)]
pub struct Study {
    case: Case,
    truth: Truth,
    clean: Grid,
    own: Vec<(Settings, Vec<f32>)>,
}

impl Study {
    /// Makes ready to measure `case` without its noise.
    ///
    /// # Errors
    /// As [`Phantom::scene`] and [`Phantom::generate`].
    pub fn new(case: &Case) -> Result<Self> {
        let case = case.clean();
        let clean = case.phantom.generate(&case.phantom_settings())?;
        Ok(Self { truth: Truth::new(&case)?, clean, case, own: Vec::new() })
    }

    /// Measures every method under `noise`, a share of the largest step, on the current rayon thread pool. Each runs
    /// `repeats` times, at least once; the fastest run counts.
    ///
    /// # Errors
    /// As [`crate::prepare::compute_roles`].
    pub fn measure(&mut self, noise: f64, methods: &[Method], repeats: usize) -> Result<Vec<StudyRow>> {
        let case = Case { noise, ..self.case };
        let grid = case.phantom.generate(&case.phantom_settings())?;
        methods.iter().map(|method| self.measure_one(&case, &grid, method, repeats)).collect()
    }

    fn measure_one(&mut self, case: &Case, grid: &Grid, method: &Method, repeats: usize) -> Result<StudyRow> {
        let (prepared, mut seconds) = timed(grid, &method.settings)?;
        for _ in 1..repeats {
            seconds = seconds.min(timed(grid, &method.settings)?.1);
        }
        let roles = roles_of(&prepared);
        let mut figures = Figures::new(&self.truth, &roles);
        if case.is_disturbed() {
            let settings = self.own_settings(&prepared);
            let own = self.own_run(settings)?;
            figures = figures.with_own(&self.truth, &roles, &self.own[own].1);
        }
        let faces_kept = (case.phantom == Phantom::SlabPair).then(|| faces_kept(&self.truth, roles.distance)).flatten();
        let row = Row {
            case: *case,
            method: method.name.clone(),
            chosen: chosen(&prepared.settings),
            seconds_per_voxel: seconds / grid.geometry.voxel_count() as f64,
            figures,
        };
        Ok(StudyRow { row, faces_kept })
    }

    /// The settings under which the scene without noise has the smoothed field's own crossing.
    ///
    /// A bilateral filter on the value keeps its range σ. One on the derivatives takes it from the noise, of which there is
    /// none: its own crossing is that of the derivatives as they are. The filter is even across an edge, so that it moves
    /// no crossing of a field without noise but where edges are close.
    fn own_settings(&self, prepared: &Prepared) -> Settings {
        let unfiltered = Settings { automatic: Automatic::default(), ..prepared.settings };
        match prepared.settings.smoothing.placement {
            Smoothing::BilateralDerivatives => unfiltered,
            _ => own(prepared, &self.clean, &self.truth).unwrap_or(unfiltered),
        }
    }

    /// Which of [`Self::own`] holds these settings' distances, computed unless they are known.
    fn own_run(&mut self, settings: Settings) -> Result<usize> {
        if let Some(known) = self.own.iter().position(|(known, _)| *known == settings) {
            return Ok(known);
        }
        let distance = timed(&self.clean, &settings)?.0.roles.distance;
        self.own.push((settings, distance));
        Ok(self.own.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::placements;
    use super::*;

    #[test]
    fn smoothing_helps_under_noise_and_costs_without() {
        let methods: Vec<Method> = placements()
            .into_iter()
            .filter(|method| ["bspline5, none", "bspline5, gaussian-value 1.5"].contains(&method.name.as_str()))
            .collect();
        let case = Case { thickness: 3.0, blur: 1.0, ..Case::base(Phantom::SlabPair, 32) };
        let mut study = Study::new(&case).expect("slabs");
        let quiet = study.measure(0.0, &methods, 1).expect("measures");
        let rms = |rows: &[StudyRow], index: usize| rows[index].row.figures.near.rms.expect("hits");
        assert!(rms(&quiet, 0) < 0.1 * rms(&quiet, 1), "{quiet:?}");
        assert!(quiet.iter().all(|row| row.faces_kept > Some(0.99) && row.row.figures.own_rms.is_none()));
        let loud = study.measure(0.03, &methods, 1).expect("measures");
        assert!(loud[0].faces_kept < Some(0.99) && loud[1].faces_kept > loud[0].faces_kept, "{loud:?}");
        // What is left of the Gaussian's error is the shift that it gives the crossings of a thin layer.
        let own = loud[1].row.figures.own_rms.expect("its own crossing");
        assert!(own < rms(&loud, 1) && loud[0].row.figures.own_rms > Some(own), "{loud:?}");
    }
}
