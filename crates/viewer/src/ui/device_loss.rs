//! Notices that the window's device can no longer be drawn with, as after a restart of its driver.

use std::sync::{Arc, OnceLock};

use wgpu::Device;

/// Why a device is lost, once it is; clones tell the same.
#[derive(Clone, Debug, Default)]
pub struct DeviceLoss(Arc<OnceLock<String>>);

impl DeviceLoss {
    /// Watches a device from now on. What it complains of unasked, which would otherwise end the program, counts as well:
    /// whatever went wrong, another device may do it. The window is woken, to find out.
    #[must_use]
    pub fn watch(device: &Device, context: &egui::Context) -> Self {
        let loss = Self::default();
        let tell = |loss: Self, context: egui::Context| {
            move |reason: String| {
                // The first reason is what has happened, all others come of it.
                loss.0.get_or_init(|| reason);
                context.request_repaint();
            }
        };
        let (lost, failed) = (tell(loss.clone(), context.clone()), tell(loss.clone(), context.clone()));
        device.set_device_lost_callback(move |reason, message| {
            lost(if message.is_empty() { format!("{reason:?}") } else { message });
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| failed(error.to_string())));
        loss
    }

    /// Why the device is lost; `None` while it is not.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }
}
