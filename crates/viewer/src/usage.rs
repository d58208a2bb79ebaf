//! Options that do not go together: what has no effect is an error.
//!
//! What is typed is held against what it comes to with a session. A session may say more than counts: it is kept while
//! one setting or another is tried.

use voxrole_preprocess::usage::{UsageError, refuse_if};

use crate::args::{RenderArgs, ViewArgs};
use crate::state::{Classification, Clipping, Integration, Scene, Technique, TransferFunction, ViewState};

/// Holds what was typed of a view against what it comes to.
///
/// # Errors
/// [`UsageError`] where something typed would have no effect, or is too much.
pub fn check_view(typed: &ViewArgs, state: &ViewState) -> Result<(), UsageError> {
    let found = state.clipping.planes.len();
    let most = Clipping::MOST_PLANES;
    refuse_if(found > most, format!("--clip: expected at most {most} planes that cut, found {found}"))?;
    let found = state.scene.meshes.len() + state.scene.isosurfaces.len();
    let most = Scene::MOST_SURFACES;
    refuse_if(found > most, format!("--mesh and --isosurface: expected {most} at most, found {found}"))?;
    let found = state.transfer_function.regions.len();
    let most = TransferFunction::MOST_REGIONS;
    refuse_if(found > most, format!("--region: expected {most} at most, found {found}"))?;
    if let Some(crop) = typed.crop {
        let is_before = crop.ends.iter().any(|[_, high]| *high < -0.5);
        refuse_if(is_before, format!("--crop {crop} keeps nothing: a volume's voxels are counted from 0"))?;
    }
    let (has_regions, has_alpha) = (!typed.regions.is_empty(), typed.alpha.is_some());
    match state.transfer_function.classification {
        Classification::Roles => Ok(()),
        Classification::Value => {
            let draws = "--classify value draws by the curve alone";
            refuse_if(has_regions, format!("{draws}: leave --region out, or --classify"))?;
            refuse_if(has_alpha, format!("{draws}, boundary or not: leave --alpha out, or --classify"))?;
            let has_curve = !state.transfer_function.curve.points().is_empty();
            refuse_if(!has_curve, "what is drawn by value alone needs a `--curve`")
        }
        Classification::Stored => {
            let draws = "--classify stored draws opacities as the file has them";
            for (is_typed, name) in
                [(has_regions, "--region"), (has_alpha, "--alpha"), (typed.curve.is_some(), "--curve")]
            {
                refuse_if(is_typed, format!("{draws}: leave {name} out, or --classify"))?;
            }
            let has_memory = typed.memory.is_some();
            refuse_if(has_memory, "--classify stored reads all of the file: leave --memory out, or --classify")?;
            refuse_if(typed.level > 0, format!("stored opacities have no level {}: their last is 0", typed.level))
        }
    }
}

/// Holds what was typed of a picture against what it comes to; of its view see [`check_view`].
///
/// # Errors
/// [`UsageError`] where something typed would have no effect.
pub fn check_render(typed: &RenderArgs, state: &ViewState) -> Result<(), UsageError> {
    let classification = state.transfer_function.classification;
    refuse_if(
        typed.device.normals.is_some() && classification == Classification::Stored,
        "--classify stored has no normals: leave --normals out, or --classify",
    )?;
    if let Some(integration) = typed.integration {
        refuse_if(
            classification == Classification::Stored,
            "--classify stored integrates nothing: leave --integration out, or --classify",
        )?;
        refuse_if(
            integration == Integration::FrontToBack && classification != Classification::Value,
            "--integration pre-2d is for --classify value: by roles it would be pre",
        )?;
    }
    refuse_if(
        typed.jitter && state.render_settings.technique != Technique::Rays,
        "--jitter is for rays: slices lie where they lie",
    )?;
    refuse_if(
        typed.jitter && state.render_settings.goes_by_cells(classification),
        "--jitter is for samples at equal distances: what is integrated by role misses nothing, so add --integration post",
    )?;
    // Lines and labels are drawn so that they can be read on it.
    let Scene { bounding_box, axes, scale_bar, .. } = state.scene;
    refuse_if(
        typed.transparent && typed.view.background.is_some() && !(bounding_box || axes || scale_bar),
        "--transparent leaves the background out: leave --background out, or --transparent",
    )
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Cli, Command};

    fn check(options: &str, session: &ViewState) -> Result<(), UsageError> {
        let line = format!("voxrole-view render a.vxr -o a.png {options}");
        let cli = Cli::try_parse_from(line.split_whitespace()).expect("is understood");
        let Some(Command::Render(typed)) = cli.command else { panic!("the command was given") };
        let mut state = session.clone();
        let settings = &mut state.render_settings;
        settings.technique = typed.technique.unwrap_or(settings.technique);
        settings.integration = typed.integration.unwrap_or(settings.integration);
        typed.view.scene.apply(&mut state.scene);
        state.clipping.planes.clone_from(&typed.view.planes);
        let transfer_function = &mut state.transfer_function;
        transfer_function.classification = typed.view.classify.unwrap_or(transfer_function.classification);
        transfer_function.curve = typed.view.curve.clone().unwrap_or_default();
        if !typed.view.regions.is_empty() {
            let regions = typed.view.regions.iter().map(|typed| typed.read().expect("without a map"));
            transfer_function.regions = regions.collect();
        }
        check_view(&typed.view, &state).and_then(|()| check_render(&typed, &state))
    }

    #[test]
    fn what_has_no_effect_is_refused_by_name() {
        let default = ViewState::default();
        let by_value = "--classify value --curve 0,FF0000,0.5";
        for (options, expected) in [
            (format!("{by_value} --region 1:2,3:4,FFFFFF"), "leave --region out"),
            (format!("{by_value} --alpha linear,1,2"), "leave --alpha out"),
            ("--classify value".into(), "needs a `--curve`"),
            ("--classify stored --region 1:2,3:4,FFFFFF".into(), "leave --region out"),
            ("--classify stored --alpha linear,1,2".into(), "leave --alpha out"),
            ("--classify stored --curve 0,FF0000,0.5".into(), "leave --curve out"),
            ("--classify stored --integration pre".into(), "leave --integration out"),
            ("--classify stored --level 1".into(), "no level 1"),
            ("--classify stored --normals compressed".into(), "leave --normals out"),
            ("--classify stored --memory 1GiB".into(), "leave --memory out"),
            ("--integration pre-2d".into(), "--classify value"),
            ("--technique slices --jitter".into(), "for rays"),
            ("--jitter".into(), "--integration post"),
            ("--transparent --background FFFFFF".into(), "leave --background out"),
            ("--crop :,-9:-1,:".into(), "keeps nothing"),
            ("--clip 1,1 --clip 1,1 --clip 1,1 --clip 1,1 --clip 1,1".into(), "at most 4"),
            ("--isosurface 1 ".repeat(Scene::MOST_SURFACES + 1), "32 at most"),
            ("--region 1:2,3:4,FFFFFF ".repeat(TransferFunction::MOST_REGIONS + 1), "256 at most"),
        ] {
            let message = check(&options, &default).expect_err(&options).to_string();
            assert!(message.contains(expected), "{options}: {message}");
        }
        let mut session = default;
        session.transfer_function.classification = Classification::Stored;
        assert!(check("--region 1:2,3:4,FFFFFF", &session).is_err());
    }

    #[test]
    fn what_a_session_says_may_wait() {
        let mut session = ViewState::default();
        session.transfer_function.regions = vec!["1:2,3:4,FFFFFF".parse().expect("a region")];
        session.render_settings.background = [1.0; 3];
        session.render_settings.integration = Integration::FrontToBack;
        session.render_settings.jitter = true;
        for options in [
            "--technique slices --transparent",
            "--classify value --curve 0,FF0000,0.5 --integration pre-2d",
            "--classify stored",
            "--transparent --background FFFFFF --scale-bar",
            "--region 1:2,3:4,FFFFFF --curve 0,FF0000,0.5 --alpha linear,1,2",
        ] {
            assert_eq!(check(options, &session), Ok(()), "{options}");
        }
    }
}
