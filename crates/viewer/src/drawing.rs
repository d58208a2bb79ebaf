//! Pictures of one volume without a window, one after another, on the GPU or the CPU.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use wgpu::PollType;

use voxrole_preprocess::console::tell;

use crate::device_args::DeviceArgs;
use crate::reference::{RayMarcher, SampleCounts};
use crate::render::{DeviceMemory, Gpu, Renderer, Target};
use crate::scene::scale_bar::{draw_over_light, draw_over_picture};
use crate::scene::{ScaleBar, Surfaces};
use crate::state::{Camera, ViewState};
use crate::streaming::TexelSource;
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, LightPicture, Picture, Result, Watch};

/// Rows that are drawn first; then as many as can be drawn in the time below.
const FIRST_ROWS: u32 = 8;
/// Rows that are drawn at least where the device is a CPU and bricks come as needed.
const ROWS_OF_BRICKS: u32 = 64;
/// How long the device should work at a time, in seconds: drivers give up after two.
const MOST_SECONDS: f64 = 0.25;

/// What draws a volume.
pub enum Drawing<'a> {
    /// The ray marcher on the CPU, which has light at full precision and counts samples.
    Cpu(Box<RayMarcher<'a>>),
    /// The renderer.
    Gpu(Box<OnGpu>),
}

/// The renderer, what it draws into, and what it takes to begin again.
pub struct OnGpu {
    gpu: Gpu,
    renderer: Renderer,
    target: Target,
    state: ViewState,
    volume: TexelSource,
    memory: DeviceMemory,
    /// Whether samples are counted.
    counts: bool,
}

impl OnGpu {
    fn new(gpu: Gpu, volume: TexelSource, state: &ViewState, memory: DeviceMemory) -> Result<Self> {
        let target = Target::new(&gpu, state.render_settings.image_size)?;
        let mut renderer = Renderer::new(&gpu, &volume, memory)?;
        renderer.prepare_scene(&state.scene, &Arc::new(Surfaces::of_source(state, &volume)?), target.size())?;
        Ok(Self { gpu, renderer, target, state: state.clone(), volume, memory, counts: false })
    }

    fn count_samples(&mut self) -> Result<()> {
        self.counts = true;
        self.renderer.count_samples()
    }

    fn draw(&mut self, camera: &Camera) -> Result<Picture> {
        let Self { gpu, renderer, target, state, .. } = self;
        state.camera = *camera;
        // No driver gives up a CPU, and passes that end where bricks are missing are many where rows are few.
        let least = if gpu.is_cpu && renderer.longest_pass().is_some() { ROWS_OF_BRICKS } else { 1 };
        draw_in_strips((gpu, renderer), state, target, least, &Watch::default())?;
        finished_picture(renderer, state, target)
    }

    /// Draws, and where the device is lost, as by a driver that is restarted, once more on a fresh one.
    fn draw_again_if_lost(&mut self, camera: &Camera) -> Result<Picture> {
        match self.draw(camera) {
            Err(error @ Error::Device { .. }) => {
                tell(format!("voxrole-view: {error}; opening it again"));
                let counts = self.counts;
                *self = Self::new(Gpu::new()?, self.volume.clone(), &self.state, self.memory)?;
                if counts {
                    self.count_samples()?;
                }
                self.draw(camera)
            }
            drawn => drawn,
        }
    }
}

impl<'a> Drawing<'a> {
    /// On the GPU, or on the CPU where that is asked for, or where there is no adapter but the CPU, it is not asked for and
    /// the volume is in memory; says on standard error which it is.
    ///
    /// # Errors
    /// When the volume or the picture does not fit the device, or the volume is not in memory and the CPU is asked for or
    /// there is no adapter at all; as [`Surfaces::of_source`].
    pub fn new(volume: &'a TexelSource, state: &ViewState, device: DeviceArgs) -> Result<Self> {
        let is_bound = device.memory() != DeviceMemory::default();
        let gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(error @ Error::NoAdapter(_)) if !device.gpu => {
                let texels = volume.in_memory(&format!("{error}: the CPU ray marcher needs"))?;
                let bound = if is_bound { ", where --gpu-memory and --normals count for nothing" } else { "" };
                tell(format!("voxrole-view: {error}; drawing with the CPU ray marcher{bound}"));
                return Self::on_cpu(texels, state);
            }
            Err(error) => return Err(error),
        };
        if let (true, TexelSource::Memory(texels)) = (device.wants_cpu(gpu.is_cpu), volume) {
            // The same picture, in a fraction of the time.
            let bound = if is_bound { "; --gpu-memory and --normals count with --gpu" } else { "" };
            tell(format!("voxrole-view: {} runs on the CPU; drawing with the CPU ray marcher{bound}", gpu.name));
            return Self::on_cpu(texels, state);
        }
        tell(format!("voxrole-view: drawing on {}", gpu.name));
        Self::on_gpu(gpu, volume, state, device.memory())
    }

    /// On a device, of whose memory the volume takes so much.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn on_gpu(
        gpu: Gpu,
        volume: impl Into<TexelSource>,
        state: &ViewState,
        memory: impl Into<DeviceMemory>,
    ) -> Result<Self> {
        Ok(Self::Gpu(Box::new(OnGpu::new(gpu, volume.into(), state, memory.into())?)))
    }

    /// On the CPU.
    ///
    /// # Errors
    /// [`Error::PictureSize`]; as [`Surfaces::new`].
    pub fn on_cpu(volume: &'a VolumeTexels, state: &ViewState) -> Result<Self> {
        Ok(Self::Cpu(Box::new(RayMarcher::new(volume, state, state.render_settings.image_size)?)))
    }

    /// Counts samples from now on, which the CPU always does: on a GPU those of rays through a volume that is there as a whole.
    ///
    /// # Errors
    /// [`Error::Device`] when the device refuses.
    pub fn count_samples(&mut self) -> Result<()> {
        match self {
            Self::Cpu(_) => Ok(()),
            Self::Gpu(on_gpu) => on_gpu.count_samples(),
        }
    }

    /// What the volume takes of a GPU's memory, where one draws.
    #[must_use]
    pub fn volume_bytes(&self) -> Option<u64> {
        match self {
            Self::Cpu(_) => None,
            Self::Gpu(on_gpu) => Some(on_gpu.renderer.volume_bytes()),
        }
    }

    /// The picture from a camera.
    ///
    /// # Errors
    /// [`Error::Device`] when the device is lost twice, [`Error::Pack`] when a brick of a file is damaged, [`Error::Preprocess`] when the scale bar's label cannot be drawn.
    pub fn draw(&mut self, camera: &Camera) -> Result<Drawn> {
        match self {
            Self::Cpu(marcher) => {
                marcher.look_from(camera);
                let (mut light, samples) = marcher.light();
                let background = marcher.frame().background;
                if let Some(bar) = scale_bar(marcher.state(), marcher.volume()) {
                    draw_over_light(&bar, &mut light, background)?;
                }
                Ok(Drawn { picture: light.picture(Some(background)), light: Some(light), samples: Some(samples) })
            }
            Self::Gpu(on_gpu) => {
                let picture = on_gpu.draw_again_if_lost(camera)?;
                Ok(Drawn { picture, light: None, samples: on_gpu.renderer.samples()? })
            }
        }
    }
}

/// Draws a few rows after another, so that no work of the device's takes so long that its driver gives it up; `least` rows
/// at least, until all are there or the picture is given up.
pub(crate) fn draw_in_strips(
    (gpu, renderer): (&Gpu, &mut Renderer),
    state: &ViewState,
    target: &Target,
    least: u32,
    watch: &Watch,
) -> Result<()> {
    let [_, height] = target.size();
    let (mut row, mut rows) = (0, FIRST_ROWS.max(least));
    while row < height && !watch.is_given_up() {
        let start = Instant::now();
        let end = height.min(row + rows);
        renderer.draw_watched_rows(state, target, row..end, watch)?;
        let waited = gpu.device.poll(PollType::wait_indefinitely());
        waited.map_err(|error| gpu.error("drawing the picture", &error))?;
        let seconds = renderer.longest_pass().unwrap_or_else(|| start.elapsed().as_secs_f64());
        if seconds > MOST_SECONDS {
            rows = (rows / 4).max(least);
        } else if seconds < 0.25 * MOST_SECONDS {
            rows = rows.saturating_mul(2);
        }
        watch.add_rows(end - row);
        row = end;
    }
    Ok(())
}

/// What was drawn into a target, with the bar over it where one is wanted.
pub(crate) fn finished_picture(renderer: &Renderer, state: &ViewState, target: &Target) -> Result<Picture> {
    let mut picture = target.read_back(renderer.gpu())?;
    if let Some(bar) = scale_bar(state, renderer.volume()) {
        draw_over_picture(&bar, &mut picture, Vec3::from_array(state.render_settings.background))?;
    }
    Ok(picture)
}

/// The bar over a picture, where one is wanted.
pub(crate) fn scale_bar(state: &ViewState, volume: &VolumeDescription) -> Option<ScaleBar> {
    let wanted = state.scene.scale_bar.then(|| ScaleBar::new(state, volume, state.render_settings.image_size));
    wanted.flatten()
}

/// A picture, and what it was made of.
pub struct Drawn {
    /// Over the background.
    pub picture: Picture,
    /// At full precision, on the CPU.
    pub light: Option<LightPicture>,
    /// How many samples were taken, where they were counted.
    pub samples: Option<SampleCounts>,
}
