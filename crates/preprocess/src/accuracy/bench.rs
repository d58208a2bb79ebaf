//! Measures methods on a case.

use super::figures::Roles;
use super::{Case, Figures, Method, Truth};
use crate::prepare::{Prepared, compute_roles};
use crate::progress::Silent;
use crate::report::Stopwatch;
use crate::settings::{Automatic, Settings, Smoothing};
use crate::{Grid, Result};

/// One method on one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// The method's name.
    pub method: String,
    /// What the settings came to, for a method that chooses by the data: kernel, reconstruction, smoothing.
    pub chosen: String,
    /// Seconds per voxel of everything but reading and packing, of the fastest repeat.
    pub seconds_per_voxel: f64,
    /// How accurate it is.
    pub figures: Figures,
}

/// Measures every method on a case, on the current rayon thread pool.
///
/// Every method runs `repeats` times (at least once), all of them once before any runs again: what else the machine does
/// meanwhile then disturbs them alike. The fastest of a method's runs counts.
///
/// # Errors
/// As [`compute_roles`] and [`crate::phantom::Phantom::generate`].
pub fn measure(case: &Case, methods: &[Method], repeats: usize) -> Result<Vec<Row>> {
    let grid = case.phantom.generate(&case.phantom_settings())?;
    let truth = Truth::new(case)?;
    let disturbed = case.is_disturbed();
    let clean = if disturbed { Some(case.phantom.generate(&case.clean().phantom_settings())?) } else { None };
    let mut rows = Vec::with_capacity(methods.len());
    for method in methods {
        let (prepared, seconds) = timed(&grid, &method.settings)?;
        let roles = roles_of(&prepared);
        let mut figures = Figures::new(&truth, &roles);
        if let Some((clean, settings)) = clean.as_ref().and_then(|clean| Some((clean, own(&prepared, clean, &truth)?)))
        {
            let (own, _) = timed(clean, &settings)?;
            figures = figures.with_own(&truth, &roles, &own.roles.distance);
        }
        rows.push(Row {
            case: *case,
            method: method.name.clone(),
            chosen: chosen(&prepared.settings),
            seconds_per_voxel: seconds,
            figures,
        });
    }
    for _ in 1..repeats {
        for (method, row) in methods.iter().zip(&mut rows) {
            row.seconds_per_voxel = row.seconds_per_voxel.min(timed(&grid, &method.settings)?.1);
        }
    }
    let voxels = grid.geometry.voxel_count() as f64;
    rows.iter_mut().for_each(|row| row.seconds_per_voxel /= voxels);
    Ok(rows)
}

pub(crate) fn timed(grid: &Grid, settings: &Settings) -> Result<(Prepared, f64)> {
    let mut watch = Stopwatch::new();
    let (prepared, _) = compute_roles(grid, settings, &Silent, &mut watch)?;
    Ok((prepared, watch.total()))
}

pub(crate) fn roles_of(prepared: &Prepared) -> Roles<'_> {
    Roles {
        distance: &prepared.roles.distance,
        hit_gradient: &prepared.roles.hit_gradient,
        gradient_scale: prepared.field.gradient_scale(),
    }
}

/// The settings that give, on the scene without noise and rounding, the crossing of the field as it was smoothed.
///
/// None for filtered derivatives: each of the two has a range σ of its own, taken from the noise that is gone.
pub(crate) fn own(prepared: &Prepared, clean: &Grid, truth: &Truth) -> Option<Settings> {
    let mut settings = Settings { automatic: Automatic::default(), ..prepared.settings };
    match settings.smoothing.placement {
        Smoothing::BilateralDerivatives => return None,
        Smoothing::None | Smoothing::GaussianValue => {}
        Smoothing::BilateralValue => {
            // The same σ as a share of the smaller range.
            let [low, high] = prepared.stored_range;
            let [clean_low, clean_high] = clean.scalars.finite_range()?;
            let ratio = (high - low) / ((clean_high - clean_low) * truth.stored_per_value);
            let share = prepared.range_sigma.first()?.share * ratio;
            settings.smoothing.range_sigma = Some(share).filter(|share| *share > 0.0);
        }
    }
    Some(settings)
}

pub(crate) fn chosen(settings: &Settings) -> String {
    let smoothing = match settings.smoothing.placement {
        Smoothing::None => "none".to_owned(),
        placement => format!("{placement} {}", settings.smoothing.spatial_sigma),
    };
    format!("{}+{}, smoothing {smoothing}", settings.kernel, settings.reconstruction)
}

#[cfg(test)]
mod tests {
    use super::super::methods;
    use super::*;
    use crate::phantom::Phantom;

    #[test]
    fn better_methods_measure_better_and_noise_worse() {
        let chosen: Vec<Method> = methods()
            .into_iter()
            .filter(|method| ["fast", "accurate", "auto", "accurate, gaussian-value"].contains(&method.name.as_str()))
            .collect();
        let clean = Case::base(Phantom::Ball, 32);
        let rms = |case: &Case| {
            let rows = measure(case, &chosen, 1).expect("measures");
            let rms: Vec<f64> = rows.iter().map(|row| row.figures.near.rms.expect("hits")).collect();
            (rms, rows)
        };
        let (quiet, rows) = rms(&clean);
        // fast, accurate, auto, accurate under a Gaussian that it does not need.
        assert!(quiet[1] < 0.1 * quiet[0] && quiet[2] == quiet[1] && quiet[3] > 10.0 * quiet[1], "{quiet:?}");
        assert!(rows.iter().all(|row| row.seconds_per_voxel > 0.0 && row.figures.own_rms.is_none()));
        assert!(rows.iter().all(|row| row.figures.near.hit_rate == Some(1.0)));
        let (loud, rows) = rms(&Case { noise: 0.01, ..clean });
        assert!(loud[1] > 0.1 && loud[2] < loud[1] && loud[3] < loud[1], "{loud:?}");
        assert!(rows[2].chosen.contains("gaussian-value"), "{}", rows[2].chosen);
        // The Gaussian shifts the crossing of a ball this small: most of its error is that shift.
        let own = rows[3].figures.own_rms.expect("its own crossing");
        assert!(own < 0.5 * loud[3], "{own} {}", loud[3]);
    }
}
