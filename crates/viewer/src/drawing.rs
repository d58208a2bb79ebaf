//! Pictures of one volume without a window, one after another, on the GPU or the CPU.

use voxrole_preprocess::console::tell;

use crate::reference::{RayMarcher, SampleCounts};
use crate::render::{Gpu, Renderer, Target};
use crate::state::{Camera, ViewState};
use crate::volume::VolumeTexels;
use crate::{Error, LightPicture, Picture, Result};

/// What draws a volume.
pub enum Drawing<'a> {
    /// The ray marcher on the CPU, which has light at full precision and counts samples.
    Cpu(Box<RayMarcher<'a>>),
    /// The renderer.
    Gpu(Box<OnGpu>),
}

/// The renderer, and what it draws into.
pub struct OnGpu {
    gpu: Gpu,
    renderer: Renderer,
    target: Target,
    state: ViewState,
}

impl<'a> Drawing<'a> {
    /// On the GPU, or on the CPU where there is no adapter but the CPU; says on standard error which it is.
    ///
    /// # Errors
    /// When the volume or the picture does not fit the device.
    pub fn new(volume: &'a VolumeTexels, state: &ViewState) -> Result<Self> {
        let gpu = match Gpu::new() {
            Ok(gpu) if gpu.is_cpu => {
                // The same picture, in half the time.
                tell(format!("voxrole-view: {} runs on the CPU; drawing with the CPU ray marcher", gpu.name));
                return Self::on_cpu(volume, state);
            }
            Ok(gpu) => gpu,
            Err(error @ Error::NoAdapter(_)) => {
                tell(format!("voxrole-view: {error}; drawing with the CPU ray marcher"));
                return Self::on_cpu(volume, state);
            }
            Err(error) => return Err(error),
        };
        tell(format!("voxrole-view: drawing on {}", gpu.name));
        let target = Target::new(&gpu, state.render_settings.image_size)?;
        let renderer = Renderer::new(&gpu, volume)?;
        Ok(Self::Gpu(Box::new(OnGpu { gpu, renderer, target, state: state.clone() })))
    }

    /// On the CPU.
    ///
    /// # Errors
    /// [`Error::PictureSize`].
    pub fn on_cpu(volume: &'a VolumeTexels, state: &ViewState) -> Result<Self> {
        Ok(Self::Cpu(Box::new(RayMarcher::new(volume, state, state.render_settings.image_size)?)))
    }

    /// The picture from a camera.
    ///
    /// # Errors
    /// [`Error::Device`] when the device is lost.
    pub fn draw(&mut self, camera: &Camera) -> Result<Drawn> {
        match self {
            Self::Cpu(marcher) => {
                marcher.look_from(camera);
                let (light, samples) = marcher.light();
                let background = marcher.frame().background;
                Ok(Drawn { picture: light.picture(Some(background)), light: Some(light), samples: Some(samples) })
            }
            Self::Gpu(on_gpu) => {
                let OnGpu { gpu, renderer, target, state } = &mut **on_gpu;
                state.camera = *camera;
                renderer.draw(state, target)?;
                Ok(Drawn { picture: target.read_back(gpu)?, light: None, samples: None })
            }
        }
    }
}

/// A picture, and on the CPU what it was made of.
pub struct Drawn {
    /// Over the background.
    pub picture: Picture,
    /// At full precision.
    pub light: Option<LightPicture>,
    /// How many samples were taken.
    pub samples: Option<SampleCounts>,
}
