//! Picture files without a window.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use voxrole_pack::{HistogramKind, Reader, atomic_file};
use voxrole_preprocess::console::{print, tell};
use voxrole_preprocess::io::ReadOptions;
use voxrole_preprocess::usage::{UsageError, check_extension, refuse_if};

use crate::Error;
use crate::args::{Bits, RenderArgs, ViewArgs};
use crate::classify::propose_regions;
use crate::device_args::DeviceArgs;
use crate::drawing::Drawing;
use crate::open::{open_or_prepare, read_stored};
use crate::picture::Animation;
use crate::reference::SampleCounts;
use crate::region_args::TypedRegion;
use crate::render::DeviceMemory;
use crate::state::{Camera, Classification, Crop, Region, SavedVolume, ViewState};
use crate::streaming::TexelSource;
use crate::streaming::memory_bound::bound;
use crate::usage::{check_render, check_view};
use crate::volume::{VolumeDescription, VolumeTexels};

/// Pictures of an animation shown each second, where nothing else is asked for.
const PER_SECOND: f32 = 25.0;

/// Draws what `arguments` ask for and writes it under its name when it is complete.
///
/// Proposed regions are printed on standard output in the form that `--region` takes; what draws, on standard error.
///
/// # Errors
/// When the file cannot be read, the picture cannot be drawn or written, or no region is given and none can be proposed.
pub fn render(arguments: &RenderArgs) -> anyhow::Result<()> {
    let outputs = Outputs::new(arguments)?;
    let mut state = typed_state(&arguments.view)?;
    let settings = &mut state.render_settings;
    settings.technique = arguments.technique.unwrap_or(settings.technique);
    settings.step = arguments.step.unwrap_or(settings.step);
    settings.integration = arguments.integration.unwrap_or(settings.integration);
    settings.jitter |= arguments.jitter;
    settings.shading.occlusion = arguments.occlusion.unwrap_or(settings.shading.occlusion);
    if arguments.no_skip {
        settings.leaps = false;
        settings.termination_opacity = 1.0;
    }
    check_render(arguments, &state)?;
    let start = Instant::now();
    let has_regions = !state.transfer_function.regions.is_empty();
    let volume = read_what_is_drawn(&arguments.file, &arguments.raw.read_options(), &arguments.view, &mut state)?;
    let reading = start.elapsed().as_secs_f64();
    let on_cpu = arguments.device.cpu || outputs.need_light;
    let drawing = if on_cpu {
        let what = if outputs.need_light {
            "`--bits 16`, `--transparent` and `--depth` need"
        } else {
            "the CPU ray marcher needs"
        };
        volume.in_memory(what).and_then(|texels| Drawing::on_cpu(texels, &state))
    } else {
        Drawing::new(&volume, &state, arguments.device)
    };
    let mut drawing = drawing.map_err(|error| of_volume(error, &arguments.file))?;
    if arguments.stats {
        drawing.count_samples().map_err(|error| of_volume(error, &arguments.file))?;
    }
    if !has_regions {
        // Once nothing stands in the way of their picture.
        print_regions(&state)?;
    }
    let ready = start.elapsed().as_secs_f64() - reading;
    if let Some(path) = &arguments.save_session {
        write(path, state.to_toml()?.as_bytes())?;
    }
    let Written { samples, seconds, is_blank } =
        outputs.write(&mut drawing, &state, volume.description().smallest_spacing())?;
    if arguments.stats {
        tell(format!("voxrole-view: read in {reading:.3} s, made ready in {ready:.3} s, drawn in {seconds:.3} s"));
        if let Some(samples) = samples {
            let SampleCounts { taken, all } = samples;
            let saved = 100.0 * samples.saved();
            tell(format!("voxrole-view: {taken} samples taken of {all} along all rays, {saved:.1} % saved"));
        }
        if let Some(bytes) = drawing.volume_bytes() {
            tell(format!("voxrole-view: the volume takes {bytes} bytes of the GPU"));
        }
        if let TexelSource::File(packed) = &volume {
            let (unpacked, all) = (packed.bricks_unpacked(), packed.grid().len());
            tell(format!("voxrole-view: bricks unpacked for rays {unpacked} times; the file has {all}"));
        }
    }
    if is_blank {
        tell(match state.transfer_function.classification {
            Classification::Roles => {
                "voxrole-view: nothing is visible: no boundary that the camera sees lies in any region or on the curve, or all is cut away"
            }
            Classification::Value | Classification::Stored => {
                "voxrole-view: nothing is visible: nothing that the camera sees has an opacity, or all is cut away"
            }
        });
    }
    Ok(())
}

/// What came of the pictures.
struct Written {
    /// Of all of them, where they were counted.
    samples: Option<SampleCounts>,
    /// That drawing took.
    seconds: f64,
    /// Whether none of them shows anything.
    is_blank: bool,
}

/// What is to be written.
struct Outputs<'a> {
    arguments: &'a RenderArgs,
    is_animation: bool,
    /// Whether a picture of 8 bits over its background does not suffice.
    need_light: bool,
    frames: u32,
}

impl<'a> Outputs<'a> {
    /// Checks, before any work is done, that everything can be written.
    fn new(arguments: &'a RenderArgs) -> anyhow::Result<Self> {
        let RenderArgs { output, frames, bits, depth, save_session, transparent, .. } = arguments;
        let is_named =
            |path: &Path, extension: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension));
        let is_animation = is_named(output, "apng");
        if !is_animation && !is_named(output, "png") {
            let message = format!("{}: what is written is png, or apng for an animation; name it so", output.display());
            return Err(UsageError(message).into());
        }
        let is_deep = *bits == Bits::Sixteen;
        refuse_if(
            arguments.fps.is_some() && !is_animation,
            format!(
                "--fps is an animation's: name the output OUT.apng, or leave it out; {} is a picture",
                output.display()
            ),
        )?;
        refuse_if(is_animation && is_deep, format!("{}: animations have 8 bits a channel", output.display()))?;
        if let Some(path) = depth {
            check_extension(path, "npy")?;
            let several = frames.is_some() || is_animation;
            refuse_if(several, "--depth is that of one picture: draw one, without --frames")?;
        }
        if let Some(path) = save_session {
            check_extension(path, "toml")?;
        }
        let frames = frames.unwrap_or(if is_animation { 36 } else { 1 });
        let need_light = is_deep || *transparent || depth.is_some();
        refuse_if(
            need_light && (arguments.device.gpu || arguments.device.memory() != DeviceMemory::default()),
            "--bits 16, --transparent and --depth are drawn on the CPU: leave --gpu, --gpu-memory and --normals out, or them",
        )?;
        let outputs = Self { arguments, is_animation, need_light, frames };
        let mut paths = outputs.paths();
        paths.extend(depth.iter().chain(save_session).cloned());
        for path in &paths {
            let mut inputs = vec![arguments.file.as_path()];
            inputs.extend(arguments.view.regions.iter().filter_map(|region| region.map.as_deref()));
            // A session that was read may be saved in its own place.
            inputs.extend(arguments.view.session.as_deref().filter(|_| Some(path) != save_session.as_ref()));
            atomic_file::check_output(path, &inputs).with_context(|| format!("writing {}", path.display()))?;
        }
        Ok(outputs)
    }

    /// The files of all pictures.
    fn paths(&self) -> Vec<PathBuf> {
        let output = &self.arguments.output;
        if self.is_animation || self.arguments.frames.is_none() {
            return vec![output.clone()];
        }
        let digits = (self.frames - 1).to_string().len().max(3);
        let stem = output.file_stem().unwrap_or_default().to_string_lossy();
        (0..self.frames).map(|frame| output.with_file_name(format!("{stem}-{frame:0digits$}.png"))).collect()
    }

    /// Draws everything and writes it.
    fn write(&self, drawing: &mut Drawing<'_>, state: &ViewState, smallest_spacing: f64) -> anyhow::Result<Written> {
        let RenderArgs { output, bits, depth, transparent, .. } = self.arguments;
        let background = (!transparent).then(|| glam::Vec3::from_array(state.render_settings.background));
        let blank =
            background.map_or([0; 4], |color| (color.extend(1.0) * 255.0 + 0.5).to_array().map(|share| share as u8));
        let mut written = Written { samples: None, seconds: 0.0, is_blank: true };
        let mut apng = Vec::new();
        let mut animation = if self.is_animation {
            let per_second = self.arguments.fps.unwrap_or(PER_SECOND);
            Some(Animation::new(&mut apng, state.render_settings.image_size, self.frames, per_second)?)
        } else {
            None
        };
        let paths = self.paths();
        for frame in 0..self.frames {
            let mut camera = state.camera;
            camera.orbit(360.0 * frame as f32 / self.frames as f32, 0.0);
            let start = Instant::now();
            let drawn = drawing.draw(if frame == 0 { &state.camera } else { &camera });
            let mut drawn = drawn.map_err(|error| of_volume(error, &self.arguments.file))?;
            written.seconds += start.elapsed().as_secs_f64();
            if let Some(taken) = drawn.samples {
                written.samples = Some(written.samples.unwrap_or_default().plus(taken));
            }
            if let (true, Some(light)) = (*transparent, &drawn.light) {
                drawn.picture = light.picture(None);
            }
            // What a device rounds is off by 1.
            let is_blank = |pixel: &[u8]| pixel.iter().zip(blank).all(|(found, blank)| found.abs_diff(blank) <= 1);
            written.is_blank &= drawn.picture.rgba.chunks_exact(4).all(is_blank);
            if let Some(animation) = &mut animation {
                animation.add(&drawn.picture)?;
            } else {
                let png = match &drawn.light {
                    Some(light) if *bits == Bits::Sixteen => light.to_deep_png(background)?,
                    _ => drawn.picture.to_png()?,
                };
                write(&paths[frame as usize], &png)?;
            }
            if let (Some(path), Some(light)) = (depth, &drawn.light) {
                write(path, &light.depth_npy(smallest_spacing))?;
            }
        }
        animation.map_or(Ok(()), Animation::finish)?;
        if self.is_animation {
            write(output, &apng)?;
        }
        Ok(written)
    }
}

/// Names the volume that an error is about; one about a mesh names that already.
fn of_volume(error: Error, volume: &Path) -> anyhow::Error {
    let is_mesh = matches!(error, Error::Mesh { .. });
    let error = anyhow::Error::from(error);
    if is_mesh { error } else { error.context(volume.display().to_string()) }
}

/// Prints regions as `--region` takes them.
pub(crate) fn print_regions(state: &ViewState) -> anyhow::Result<()> {
    let regions = &state.transfer_function.regions;
    Ok(regions.iter().try_for_each(|region| print(&format!("--region {region}\n")))?)
}

/// Writes a file, which appears under its name when it is complete; errors name it.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    atomic_file::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}

/// Draws the picture that needs no knob, with proposed regions, and writes it under its name when it is complete.
///
/// # Errors
/// As [`render`].
pub fn first_picture(reader: &Reader, output: &Path) -> anyhow::Result<()> {
    let mut state = ViewState::default();
    state.transfer_function.regions = proposed_regions(reader)?;
    let volume = TexelSource::from(VolumeTexels::read(reader)?);
    let picture = Drawing::new(&volume, &state, DeviceArgs::default())?.draw(&state.camera)?.picture;
    write(output, &picture.to_png()?)
}

/// A path from wherever a session is saved and opened.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// What a session file says.
///
/// # Errors
/// When it cannot be read or understood; the message names it.
pub fn read_session(path: &Path) -> anyhow::Result<ViewState> {
    let bytes = fs::read(path).with_context(|| path.display().to_string())?;
    let text = String::from_utf8(bytes).ok().with_context(|| {
        format!("{}: is no session, which is text in TOML: --save-session and the window write one", path.display())
    })?;
    let mut state = ViewState::from_toml(&text).with_context(|| path.display().to_string())?;
    // From where the session lies, wherever it is opened.
    for mesh in &mut state.scene.meshes {
        if let (true, Some(folder)) = (Path::new(&mesh.path).is_relative(), path.parent()) {
            mesh.path = absolute(&folder.join(&mesh.path));
        }
    }
    Ok(state)
}

/// Reads what a state draws of a file, which is prepared first where that is needed, and proposes regions where nothing
/// says what to draw. Texels of a packed file that take more memory than `view` lets them stay there. The state becomes that of
/// this volume; where it was saved of another one, that is said on standard error.
///
/// # Errors
/// When the file cannot be read, is not of the kind that the state asks for, nothing can be proposed, or what is kept of it by
/// `--crop` lies beyond it; the message names it.
pub fn read_what_is_drawn(
    file: &Path,
    options: &ReadOptions,
    view: &ViewArgs,
    state: &mut ViewState,
) -> anyhow::Result<TexelSource> {
    let named = || file.display().to_string();
    if state.transfer_function.classification == Classification::Stored {
        let volume = read_stored(file, options)?;
        check_crop(&state.clipping.crop, &volume.description).with_context(named)?;
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        take_volume(state, SavedVolume { name, value_range: volume.description.value_range });
        return Ok(volume.into());
    }
    let memory = bound(view.memory)?;
    let opened = open_or_prepare(file, options, memory)?;
    // Refused before what takes its time.
    check_crop(&state.clipping.crop, &VolumeDescription::of(&opened.reader, view.level).with_context(named)?)
        .with_context(named)?;
    propose_where_needed(state, &opened.reader).with_context(named)?;
    take_volume(state, SavedVolume::of(opened.reader.header()));
    TexelSource::open(opened, view.level, memory).with_context(named)
}

/// Makes a state that of a volume.
fn take_volume(state: &mut ViewState, volume: SavedVolume) {
    if let Some(mismatch) = volume.mismatch(state.volume.as_ref()) {
        tell(format!("voxrole-view: {mismatch}"));
    }
    state.volume = Some(volume);
}

/// Refuses a box that has nothing of a volume in it, and tells of one that reaches beyond it.
fn check_crop(crop: &Crop, volume: &VolumeDescription) -> anyhow::Result<()> {
    for ((ends, dim), axis) in crop.ends.iter().zip(volume.dims).zip(["x", "y", "z"]) {
        let last = dim - 1;
        // A single voxel is drawn as thick as it is.
        let half = if dim == 1 { 0.5 } else { 0.0 };
        ensure!(
            ends[0] <= last as f32 + half && ends[1] >= -half,
            "`--crop {crop}` keeps nothing: along {axis} the volume has the voxels 0 to {last}"
        );
        let is_beyond = |end: f32| end.is_finite() && (end < -half || end > last as f32 + half);
        if ends.iter().any(|&end| is_beyond(end)) {
            tell(format!(
                "voxrole-view: `--crop {crop}` reaches beyond the volume: along {axis} it has the voxels 0 to {last}"
            ));
        }
    }
    Ok(())
}

/// The session, or else the defaults, with everything that was typed in its place.
///
/// # Errors
/// When the session cannot be read; as [`check_view`].
pub fn typed_state(arguments: &ViewArgs) -> anyhow::Result<ViewState> {
    let mut state = arguments.session.as_deref().map_or(Ok(ViewState::default()), read_session)?;
    let ViewState { camera, transfer_function, clipping, render_settings, scene, .. } = &mut state;
    arguments.scene.apply(scene);
    for mesh in &mut scene.meshes {
        mesh.path = absolute(Path::new(&mesh.path));
    }
    fn set<T: Clone>(place: &mut T, typed: &Option<T>) {
        if let Some(typed) = typed {
            place.clone_from(typed);
        }
    }
    if let Some(Camera { azimuth, elevation, zoom, roll, .. }) = arguments.camera {
        *camera = Camera { azimuth, elevation, zoom, roll, ..*camera };
    }
    set(&mut transfer_function.emphasis, &arguments.alpha);
    set(&mut transfer_function.curve, &arguments.curve);
    set(&mut transfer_function.classification, &arguments.classify);
    set(&mut clipping.crop, &arguments.crop);
    set(&mut render_settings.image_size, &arguments.size);
    set(&mut render_settings.background, &arguments.background);
    if arguments.no_clip || !arguments.planes.is_empty() {
        clipping.planes.clone_from(&arguments.planes);
    }
    if !arguments.regions.is_empty() {
        transfer_function.regions = arguments.regions.iter().map(TypedRegion::read).collect::<Result<_, _>>()?;
    }
    check_view(arguments, &state)?;
    Ok(state)
}

/// Takes the proposed regions where neither a region nor a curve says what to draw.
fn propose_where_needed(state: &mut ViewState, reader: &Reader) -> anyhow::Result<()> {
    if state.transfer_function.draws_nothing() {
        state.transfer_function.regions = proposed_regions(reader)?;
    }
    Ok(())
}

fn proposed_regions(reader: &Reader) -> anyhow::Result<Vec<Region>> {
    let histogram = reader.read_histogram(HistogramKind::HitValueHitGradient)?;
    let regions = propose_regions(&histogram, reader.header().geometry.smallest_spacing());
    if regions.is_empty() {
        bail!("no boundary was found in this volume: prepare it with other settings, or give `render` a `--region`");
    }
    Ok(regions)
}
