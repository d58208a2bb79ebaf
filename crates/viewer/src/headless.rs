//! A picture file without a window.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail};
use voxrole_pack::{HistogramKind, Reader, atomic_file};
use voxrole_preprocess::console::{print, tell};

use crate::args::RenderArgs;
use crate::classify::propose_regions;
use crate::open::open_or_prepare;
use crate::reference::{RayMarcher, SampleCounts};
use crate::render::{Gpu, Renderer, Target};
use crate::state::{Clipping, Region, ViewState};
use crate::volume::VolumeTexels;
use crate::{Error, Picture};

/// Draws what `arguments` ask for and writes it under its name when it is complete.
///
/// Proposed regions are printed on standard output in the form that `--region` takes; what draws, on standard error.
///
/// # Errors
/// When the file cannot be read, the picture cannot be drawn or written, or no region is given and none can be proposed.
pub fn render(arguments: &RenderArgs) -> anyhow::Result<()> {
    let output = &arguments.output;
    let writing = || format!("writing {}", output.display());
    atomic_file::check_output(output, &[&arguments.file]).with_context(writing)?;
    if !output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        bail!("{}: what is written is png; name it so", output.display());
    }
    let opened = open_or_prepare(&arguments.file, &arguments.raw.read_options())?;
    let reader = &opened.reader;
    let named = || arguments.file.display().to_string();
    let state = state(reader, arguments).with_context(named)?;
    let start = Instant::now();
    let volume = VolumeTexels::read_level(reader, arguments.level).with_context(named)?;
    let reading = start.elapsed().as_secs_f64();
    let Drawn { picture, ready, drawing, samples } = draw(&volume, &state, arguments.cpu).with_context(named)?;
    if arguments.stats {
        tell(format!("voxrole-view: read in {reading:.3} s, made ready in {ready:.3} s, drawn in {drawing:.3} s"));
        if let Some(samples) = samples {
            let SampleCounts { taken, all } = samples;
            let saved = 100.0 * samples.saved();
            tell(format!("voxrole-view: {taken} samples taken of {all} along all rays, {saved:.1} % saved"));
        }
    }
    if picture.rgba.chunks_exact(4).all(|pixel| pixel == &picture.rgba[..4]) {
        tell("voxrole-view: nothing is visible: no boundary that the camera sees lies in any region");
    }
    atomic_file::write(output, &picture.to_png()?).with_context(writing)
}

/// Draws the picture that needs no knob, with proposed regions, and writes it under its name when it is complete.
///
/// # Errors
/// As [`render`].
pub fn first_picture(reader: &Reader, output: &Path) -> anyhow::Result<()> {
    let mut state = ViewState::default();
    state.transfer_function.regions = proposed_regions(reader)?;
    let picture = draw(&VolumeTexels::read(reader)?, &state, false)?.picture;
    atomic_file::write(output, &picture.to_png()?).with_context(|| format!("writing {}", output.display()))
}

/// A picture, and what it took.
pub struct Drawn {
    /// The picture.
    pub picture: Picture,
    /// Seconds that went by before the first pixel.
    pub ready: f64,
    /// Seconds from then on.
    pub drawing: f64,
    /// How many samples were taken, where they were counted: on the CPU.
    pub samples: Option<SampleCounts>,
}

/// Draws on the GPU, or on the CPU where that is asked for or there is no adapter but the CPU; says on standard error which
/// it was.
///
/// # Errors
/// When the volume or the picture does not fit the device, or the device is lost.
pub fn draw(volume: &VolumeTexels, state: &ViewState, on_cpu: bool) -> crate::Result<Drawn> {
    if on_cpu {
        return draw_on_cpu(volume, state);
    }
    let gpu = match Gpu::new() {
        Ok(gpu) if gpu.is_cpu => {
            // The same picture, in half the time.
            tell(format!("voxrole-view: {} runs on the CPU; drawing with the CPU ray marcher", gpu.name));
            return draw_on_cpu(volume, state);
        }
        Ok(gpu) => gpu,
        Err(error @ Error::NoAdapter(_)) => {
            tell(format!("voxrole-view: {error}; drawing with the CPU ray marcher"));
            return draw_on_cpu(volume, state);
        }
        Err(error) => return Err(error),
    };
    tell(format!("voxrole-view: drawing on {}", gpu.name));
    let start = Instant::now();
    let target = Target::new(&gpu, state.render_settings.image_size)?;
    let mut renderer = Renderer::new(&gpu, volume)?;
    let ready = start.elapsed().as_secs_f64();
    renderer.draw(state, &target);
    let picture = target.read_back(&gpu)?;
    Ok(Drawn { picture, ready, drawing: start.elapsed().as_secs_f64() - ready, samples: None })
}

fn draw_on_cpu(volume: &VolumeTexels, state: &ViewState) -> crate::Result<Drawn> {
    let start = Instant::now();
    let marcher = RayMarcher::new(volume, state, state.render_settings.image_size)?;
    let ready = start.elapsed().as_secs_f64();
    let (picture, samples) = marcher.draw_and_count();
    Ok(Drawn { picture, ready, drawing: start.elapsed().as_secs_f64() - ready, samples: Some(samples) })
}

fn state(reader: &Reader, arguments: &RenderArgs) -> anyhow::Result<ViewState> {
    let mut state = ViewState::default();
    state.camera = arguments.camera.unwrap_or(state.camera);
    state.transfer_function.emphasis = arguments.alpha.unwrap_or(state.transfer_function.emphasis);
    state.render_settings.image_size = arguments.size;
    state.render_settings.step = arguments.step;
    state.render_settings.integration = arguments.integration;
    state.render_settings.background = arguments.background;
    if arguments.planes.len() > Clipping::MOST_PLANES {
        bail!("expected at most {} planes that cut, found {}", Clipping::MOST_PLANES, arguments.planes.len());
    }
    state.clipping = Clipping { crop: arguments.crop.unwrap_or_default(), planes: arguments.planes.clone() };
    if arguments.no_skip {
        state.render_settings.leaps = false;
        state.render_settings.termination_opacity = 1.0;
    }
    state.transfer_function.regions = arguments.regions.clone();
    if arguments.regions.is_empty() {
        state.transfer_function.regions = proposed_regions(reader)?;
        for region in &state.transfer_function.regions {
            print(&format!("--region {region}\n"))?;
        }
    }
    Ok(state)
}

fn proposed_regions(reader: &Reader) -> anyhow::Result<Vec<Region>> {
    let histogram = reader.read_histogram(HistogramKind::HitValueHitGradient)?;
    let regions = propose_regions(&histogram, reader.header().geometry.smallest_spacing());
    if regions.is_empty() {
        bail!("no boundary was found in this volume: give a `--region`, or prepare it with other settings");
    }
    Ok(regions)
}
