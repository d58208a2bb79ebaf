//! The device that draws.

use wgpu::{
    Adapter, Backends, Device, DeviceDescriptor, DeviceType, ErrorFilter, ExperimentalFeatures, Features, Instance,
    InstanceDescriptor, Limits, MemoryHints, Queue, Trace,
};

use crate::{Error, Result};

/// What 3D textures of compressed blocks take.
const COMPRESSED_VOLUMES: Features = Features::TEXTURE_COMPRESSION_BC.union(Features::TEXTURE_COMPRESSION_BC_SLICED_3D);

/// A device, its queue and what it is called. Cheap to clone: all clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// The device.
    pub device: Device,
    /// Its queue.
    pub queue: Queue,
    /// The adapter's name and backend.
    pub name: String,
    /// Whether it is a CPU that acts as a GPU, such as Mesa's lavapipe.
    pub is_cpu: bool,
    /// Whether its memory is the machine's.
    pub shares_memory: bool,
}

impl Gpu {
    /// Opens the best adapter there is: a discrete GPU before an integrated one, a CPU last. `WGPU_BACKEND` narrows the
    /// choice, as in every program on wgpu.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] when there is none, or none gives a device.
    pub fn new() -> Result<Self> {
        let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
        let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
        // Stable: among equals the driver's own order counts.
        adapters.sort_by_key(|adapter| preference(adapter.get_info().device_type));
        let mut refusals = Vec::new();
        for adapter in &adapters {
            match pollster::block_on(adapter.request_device(&Self::device_descriptor(adapter))) {
                Ok((device, queue)) => return Ok(Self::from_parts(adapter, device, queue)),
                Err(error) => refusals.push(format!("{}: {error}", adapter.get_info().name)),
            }
        }
        Err(Error::NoAdapter(if refusals.is_empty() { "none was found".into() } else { refusals.join("; ") }))
    }

    /// The device of a window that was opened elsewhere with [`Self::device_descriptor`].
    #[must_use]
    pub fn from_parts(adapter: &Adapter, device: Device, queue: Queue) -> Self {
        let info = adapter.get_info();
        Self {
            device,
            queue,
            name: format!("{} ({})", info.name, info.backend),
            is_cpu: info.device_type == DeviceType::Cpu,
            shares_memory: matches!(info.device_type, DeviceType::Cpu | DeviceType::IntegratedGpu),
        }
    }

    /// Whether it has 3D textures of compressed blocks.
    #[must_use]
    pub fn has_compressed_volumes(&self) -> bool {
        self.device.features().contains(COMPRESSED_VOLUMES)
    }

    /// What is asked of a device: textures as large as the adapter has them and, where it has them, compressed ones and
    /// blending of those of f32.
    #[must_use]
    pub fn device_descriptor(adapter: &Adapter) -> DeviceDescriptor<'static> {
        let offered = adapter.limits();
        let required_limits = Limits {
            max_buffer_size: offered.max_buffer_size,
            ..Limits::downlevel_webgl2_defaults().using_resolution(offered)
        };
        DeviceDescriptor {
            label: Some("voxrole"),
            required_features: adapter.features() & Features::FLOAT32_BLENDABLE.union(COMPRESSED_VOLUMES),
            required_limits,
            experimental_features: ExperimentalFeatures::disabled(),
            memory_hints: MemoryHints::Performance,
            trace: Trace::Off,
        }
    }

    /// Runs `work` and turns what the device complains of, which would otherwise end the program, into an error.
    pub(crate) fn checked<T>(&self, action: &'static str, work: impl FnOnce() -> T) -> Result<T> {
        let scopes = [ErrorFilter::OutOfMemory, ErrorFilter::Validation, ErrorFilter::Internal]
            .map(|filter| self.device.push_error_scope(filter));
        let result = work();
        // Scopes nest: the last one pushed is the first to go.
        let errors: Vec<_> = scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect();
        match errors.first() {
            None => Ok(result),
            Some(error) => Err(self.error(action, error)),
        }
    }

    pub(crate) fn error(&self, action: &'static str, reason: &dyn std::fmt::Display) -> Error {
        Error::Device { action, device: self.name.clone(), reason: reason.to_string() }
    }
}

fn preference(device_type: DeviceType) -> u8 {
    match device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}
