//! `voxrole-view bench`: how far pictures are from one of many samples, and what they take.

use std::fmt::Write;
use std::fs;
use std::time::Instant;

use anyhow::{Context, ensure};
use voxrole_pack::atomic_file;
use voxrole_preprocess::console::{print, tell};
use voxrole_preprocess::plot::{AxisScale, Chart, ChartAxis, Line, Point, Series, SeriesStyle, chart_png, chart_svg};
use voxrole_preprocess::usage::refuse_if;

use crate::args::BenchArgs;
use crate::headless::{print_regions, read_what_is_drawn, typed_state, write};
use crate::reference::{RayMarcher, SampleCounts};
use crate::state::{Integration, Technique, ViewState};
use crate::volume::VolumeTexels;
use crate::{LightPicture, Picture};

/// The step of the picture that is taken for the truth, in multiples of `L_min`.
const REFERENCE_STEP: f32 = 1.0 / 64.0;
/// The steps that are measured.
const STEPS: [f32; 6] = [2.0, 1.0, 0.5, 0.25, 0.125, 0.0625];
/// How a sample stands for its step.
const INTEGRATIONS: [Integration; 2] = [Integration::Preintegrated, Integration::PostClassified];
/// Pixels to the right and down where no size is given.
const SIZE: [u32; 2] = [256; 2];

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Where the volume was sampled.
    pub technique: Technique,
    /// How samples stand for steps.
    pub integration: Integration,
    /// The step, or the distance between slices, in multiples of `L_min`.
    pub step: f32,
    /// Root-mean-square difference from the reference over all pixels and channels, in 1/255.
    pub error: f64,
    /// Largest difference of a channel of a pixel of 8 bits.
    pub largest: u8,
    /// Seconds that the picture took on the CPU, without making ready.
    pub seconds: f64,
    /// What was sampled.
    pub samples: SampleCounts,
}

/// Measures, and writes `render.csv` and two plots.
///
/// # Errors
/// When the file cannot be read or the folder cannot be written to.
pub fn run(arguments: &BenchArgs) -> anyhow::Result<()> {
    let BenchArgs { file, output, view, raw } = arguments;
    let in_folder = || output.display().to_string();
    refuse_if(view.scene.scale_bar, "--scale-bar lies over a picture and is not measured: leave it out")?;
    let mut state = typed_state(view)?;
    state.render_settings.image_size = view.size.unwrap_or(SIZE);
    let has_regions = !state.transfer_function.regions.is_empty();
    let volume = read_what_is_drawn(file, &raw.read_options(), view, &mut state)?;
    let volume = volume.in_memory("the CPU ray marcher needs").with_context(|| file.display().to_string())?;
    if !output.is_dir() {
        fs::create_dir(output).with_context(in_folder)?;
    }
    let table = output.join("render.csv");
    atomic_file::check_output(&table, &[file]).with_context(in_folder)?;
    if !has_regions {
        print_regions(&state)?;
    }
    let rows = measure(volume, &state)?;
    ensure!(
        rows.iter().any(|row| row.error > 0.0),
        "every picture is the same: nothing of the volume is visible, and there is nothing to measure"
    );
    let source = file.file_name().unwrap_or_default().to_string_lossy();
    write(&table, csv(&source, &rows).as_bytes())?;
    let [width, height] = state.render_settings.image_size;
    let subtitle = format!("{source}, {width} × {height} pixels, against post-classified samples at 1/64 of a voxel");
    for (name, chart) in [("render-step", by_step(&rows, &subtitle)), ("render-time", by_time(&rows, &subtitle))] {
        write(&output.join(name).with_extension("png"), &chart_png(&chart)?)?;
        write(&output.join(name).with_extension("svg"), chart_svg(&chart)?.as_bytes())?;
    }
    print(&text(&rows)).context("writing to standard output")
}

/// Measures every technique and step, with opacity integrated along it and without; the reference is made of rays.
///
/// # Errors
/// [`crate::Error::PictureSize`]; an error too when nothing is visible.
pub fn measure(volume: &VolumeTexels, state: &ViewState) -> anyhow::Result<Vec<Row>> {
    let draw = |technique, integration, step, termination_opacity| {
        let mut state = state.clone();
        state.render_settings.technique = technique;
        state.render_settings.integration = integration;
        state.render_settings.step = step;
        state.render_settings.termination_opacity = termination_opacity;
        let marcher = RayMarcher::new(volume, &state, state.render_settings.image_size)?;
        let start = Instant::now();
        let (light, samples) = marcher.light();
        Ok::<_, crate::Error>((light, samples, start.elapsed().as_secs_f64()))
    };
    tell("voxrole-view: drawing the reference with a step of 1/64");
    let (reference, ..) = draw(Technique::Rays, Integration::PostClassified, REFERENCE_STEP, 1.0)?;
    let background = Some(glam::Vec3::from_array(state.render_settings.background));
    let truth = reference.picture(background);
    ensure!(
        reference.pixels.iter().any(|pixel| pixel.light.w > 0.0),
        "nothing is visible: there is nothing to measure"
    );
    let mut rows = Vec::new();
    for (technique, integration) in all_series() {
        for step in STEPS {
            let termination_opacity = state.render_settings.termination_opacity;
            let (light, samples, seconds) = draw(technique, integration, step, termination_opacity)?;
            let largest = largest_difference(&light.picture(background), &truth);
            let error = rms(&light, &reference);
            rows.push(Row { technique, integration, step, error, largest, seconds, samples });
        }
    }
    Ok(rows)
}

/// What is measured at every step.
fn all_series() -> impl Iterator<Item = (Technique, Integration)> {
    Technique::ALL.into_iter().flat_map(|technique| INTEGRATIONS.map(|integration| (technique, integration)))
}

/// Root-mean-square difference of colour and opacity of two pictures of one size, in 1/255.
#[must_use]
pub fn rms(a: &LightPicture, b: &LightPicture) -> f64 {
    let squares = a.pixels.iter().zip(&b.pixels).map(|(a, b)| f64::from((a.light - b.light).length_squared()));
    255.0 * (squares.sum::<f64>() / (4 * a.pixels.len()) as f64).sqrt()
}

fn largest_difference(a: &Picture, b: &Picture) -> u8 {
    a.rgba.iter().zip(&b.rgba).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

fn name(integration: Integration) -> &'static str {
    match integration {
        Integration::Preintegrated => "pre",
        Integration::PostClassified => "post",
        Integration::FrontToBack => "pre-2d",
    }
}

fn csv(volume: &str, rows: &[Row]) -> String {
    let mut text =
        String::from("volume,technique,integration,step,rmse_of_255,largest_of_255,seconds,samples,all_samples\n");
    // A name may have anything in it.
    let volume = volume.replace('"', "\"\"");
    for Row { technique, integration, step, error, largest, seconds, samples } in rows {
        let SampleCounts { taken, all } = samples;
        let (technique, name) = (technique.name(), name(*integration));
        // Writing to a string does not fail.
        let _ =
            writeln!(text, "\"{volume}\",{technique},{name},{step},{error:.6},{largest},{seconds:.4},{taken},{all}");
    }
    text
}

fn text(rows: &[Row]) -> String {
    let mut text = format!(
        "{:9} {:11} {:>7} {:>10} {:>8} {:>9} {:>12}\n",
        "technique", "integration", "step", "rms/255", "most/255", "seconds", "samples"
    );
    for Row { technique, integration, step, error, largest, seconds, samples } in rows {
        let (technique, name, taken) = (technique.name(), name(*integration), samples.taken);
        let _ =
            writeln!(text, "{technique:9} {name:11} {step:>7} {error:>10.4} {largest:>8} {seconds:>9.3} {taken:>12}");
    }
    text
}

fn by_step(rows: &[Row], subtitle: &str) -> Chart {
    chart(rows, "Error of a picture by its step", subtitle, "step [smallest voxel spacing]", |row| row.step.into())
}

fn by_time(rows: &[Row], subtitle: &str) -> Chart {
    chart(rows, "Error of a picture by its time", subtitle, "time on the CPU [s]", |row| row.seconds)
}

fn chart(rows: &[Row], title: &str, subtitle: &str, x: &str, place: impl Fn(&Row) -> f64) -> Chart {
    let series = all_series().map(|(technique, integration)| {
        let points = rows.iter().filter(|row| (row.technique, row.integration) == (technique, integration));
        let points = points.map(|row| Point { place: [place(row), row.error], ..Point::default() });
        // A colour and a shape for each technique; what is not integrated is dashed.
        let style = SeriesStyle::nth(technique as usize);
        let line = if integration == Integration::Preintegrated { Line::Solid } else { Line::Dashed };
        Series { name: format!("{}, {}", technique.name(), name(integration)), points: points.collect(), line, style }
    });
    let axis = |title: &str| ChartAxis { title: title.into(), scale: AxisScale::Log };
    Chart {
        title: title.into(),
        subtitle: subtitle.into(),
        x: axis(x),
        y: axis("root-mean-square error [1/255]"),
        series: series.collect(),
    }
}
