//! Draws the window's picture of a volume that is larger than the memory for it, by bricks from its file, on a thread beside the
//! window: whatever bricks take, the window stays awake.

use std::mem;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use eframe::egui_wgpu::RenderState;
use egui::TextureId;
use voxrole_pack::Reader;

use super::preview_scene::PreviewScene;
use super::shown_target::ShownTarget;
use crate::drawing::{draw_in_strips, finished_picture};
use crate::render::{Gpu, Renderer, Target};
use crate::state::ViewState;
use crate::streaming::{PackedVolume, TexelSource};
use crate::{Error, Picture, Result, Watch};

/// Fewest rows that are drawn at once: what every pass over bricks costs by itself must not become most of its cost. More where the
/// device is a CPU, which no driver gives up, and which takes long for either.
const LEAST_ROWS: u32 = 8;
const LEAST_ROWS_OF_CPU: u32 = 32;
/// How often the window says how far it is: painting it takes time from that.
const REPORT: Duration = Duration::from_millis(500);

/// The thread, and the last picture that it drew.
pub struct BrickDrawer {
    gpu: Gpu,
    packed: Arc<PackedVolume>,
    shown: ShownTarget,
    /// What the thread says once it is ready to draw; `None` when it has said so.
    preparation: Option<Receiver<Result<()>>>,
    requests: Sender<Request>,
    running: Option<Running<Answer>>,
    /// The picture for a file.
    saved: Option<Running<Picture>>,
    thread: Option<JoinHandle<()>>,
}

/// A picture that the thread is to draw.
struct Request {
    state: ViewState,
    watch: Arc<Watch>,
    answer: To,
    context: egui::Context,
}

/// Who asks for it.
enum To {
    Window(Sender<Result<Answer>>),
    File(Sender<Result<Picture>>),
}

/// A complete picture, and the seconds that it took.
type Answer = (Target, f64);

/// The picture that is being drawn; given up when dropped.
struct Running<T> {
    rows: u32,
    watch: Arc<Watch>,
    answer: Receiver<Result<T>>,
}

impl<T> Drop for Running<T> {
    fn drop(&mut self) {
        self.watch.give_up();
    }
}

/// What bounds the bricks.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Bytes of the machine's memory that all that is kept of the volume takes at most.
    pub memory: u64,
    /// Bytes of those that a coarser level takes, which is drawn while a hand moves.
    pub coarser: u64,
    /// Bytes of the device's memory for bricks at most, where there is a bound.
    pub device: Option<u64>,
}

impl BrickDrawer {
    /// Begins a thread, which makes ready to draw the finest level of a file.
    ///
    /// # Errors
    /// [`Error::Pack`] when a layer is missing, [`Error::TooMuchMemory`] when there is no room beside the coarser level.
    pub fn new(
        (render_state, gpu): (&RenderState, &Gpu),
        reader: Arc<Reader>,
        room: Room,
        context: &egui::Context,
    ) -> Result<Self> {
        let packed = Arc::new(PackedVolume::new(reader, 0, room.memory)?);
        packed.claim("what is drawn while a hand moves", room.coarser)?;
        let (ready, preparation) = channel();
        let (requests, receiver) = channel();
        let thread = thread::spawn({
            let (gpu, packed, context) = (gpu.clone(), Arc::clone(&packed), context.clone());
            move || {
                // Nobody waits for what is no longer wanted.
                let _ = match Renderer::new(&gpu, TexelSource::File(Arc::clone(&packed)), room.device) {
                    Ok(renderer) => {
                        let is_wanted = ready.send(Ok(()));
                        context.request_repaint();
                        is_wanted.map(|()| draw_requests(renderer, packed, &receiver))
                    }
                    Err(error) => {
                        let told = ready.send(Err(error));
                        context.request_repaint();
                        told
                    }
                };
            }
        });
        Ok(Self {
            gpu: gpu.clone(),
            packed,
            shown: ShownTarget::new(render_state),
            preparation: Some(preparation),
            requests,
            running: None,
            saved: None,
            thread: Some(thread),
        })
    }

    /// Which share of the bricks is seen through, before pictures can be drawn.
    #[must_use]
    pub fn preparation(&self) -> Option<f32> {
        self.preparation.is_some().then(|| self.packed.passed())
    }

    /// Whether the thread has become ready since this was asked last. Sees to it that the window comes back while it has not.
    ///
    /// # Errors
    /// Why it never will be: as [`Renderer::new`].
    pub fn becomes_ready(&mut self, context: &egui::Context) -> Result<bool> {
        let Some(preparation) = &self.preparation else { return Ok(false) };
        match preparation.try_recv() {
            Ok(outcome) => {
                self.preparation = None;
                outcome.map(|()| true)
            }
            Err(TryRecvError::Empty) => {
                context.request_repaint_after(REPORT);
                Ok(false)
            }
            Err(TryRecvError::Disconnected) => Err(self.ended()),
        }
    }

    /// Begins a picture of a state in place of the one that is being drawn.
    ///
    /// # Errors
    /// [`Error::Device`] when the thread has ended.
    pub fn begin(&mut self, context: &egui::Context, wanted: &ViewState) -> Result<()> {
        let running = self.request(context, wanted, To::Window)?;
        self.running = Some(running);
        Ok(())
    }

    fn request<T>(
        &self,
        context: &egui::Context,
        wanted: &ViewState,
        to: impl FnOnce(Sender<Result<T>>) -> To,
    ) -> Result<Running<T>> {
        let (watch, (answer, receiver)) = (Arc::new(Watch::default()), channel());
        let [_, rows] = wanted.render_settings.image_size;
        let request =
            Request { state: wanted.clone(), watch: Arc::clone(&watch), answer: to(answer), context: context.clone() };
        self.requests.send(request).map_err(|_| self.ended())?;
        Ok(Running { rows, watch, answer: receiver })
    }

    /// Looks after the picture that was begun; returns the seconds that it took once it is complete, and shows it from then on.
    /// Sees to it that the window comes back while it is not.
    ///
    /// # Errors
    /// [`Error::PictureSize`] or [`Error::Device`] when the picture does not fit the device or that is lost; as
    /// [`Renderer::draw_rows`] and [`crate::scene::Surfaces::of_file`].
    pub fn go_on(&mut self, context: &egui::Context) -> Result<Option<f64>> {
        let Some(running) = &self.running else { return Ok(None) };
        let answer = match running.answer.try_recv() {
            Ok(answer) => answer,
            Err(TryRecvError::Empty) => {
                // The thread wakes the window when it is done.
                context.request_repaint_after(REPORT);
                return Ok(None);
            }
            Err(TryRecvError::Disconnected) => Err(self.ended()),
        };
        self.running = None;
        let (target, seconds) = answer?;
        self.shown.show(target);
        Ok(Some(seconds))
    }

    /// Begins a picture of the settings' size and step for a file; the window's next ones wait for it.
    ///
    /// # Errors
    /// [`Error::Device`] when the thread has ended.
    pub fn begin_saved(&mut self, context: &egui::Context, view: &ViewState) -> Result<()> {
        let saved = self.request(context, view, To::File)?;
        self.saved = Some(saved);
        Ok(())
    }

    /// The picture for a file, once it is complete.
    ///
    /// # Errors
    /// As [`Self::go_on`].
    pub fn go_on_saved(&mut self) -> Result<Option<Picture>> {
        let Some(saved) = &self.saved else { return Ok(None) };
        let answer = match saved.answer.try_recv() {
            Ok(answer) => answer,
            Err(TryRecvError::Empty) => return Ok(None),
            Err(TryRecvError::Disconnected) => Err(self.ended()),
        };
        self.saved = None;
        answer.map(Some)
    }

    /// Leaves the picture that is being drawn as it is.
    pub fn give_up(&mut self) {
        self.running = None;
    }

    /// Which share of the picture that was begun is there.
    #[must_use]
    pub fn progress(&self) -> Option<f32> {
        self.running.as_ref().map(|running| running.watch.rows() as f32 / running.rows as f32)
    }

    /// The last complete picture.
    #[must_use]
    pub fn texture(&self) -> Option<TextureId> {
        self.shown.texture()
    }

    fn ended(&self) -> Error {
        let reason = "its thread has ended".to_owned();
        Error::Device { action: "drawing brick by brick", device: self.gpu.name.clone(), reason }
    }
}

impl Drop for BrickDrawer {
    /// Waits for the thread, which stops at the next brick or pass: it must not use a device that is being taken down.
    fn drop(&mut self) {
        self.packed.give_up();
        (self.running, self.saved) = (None, None);
        // It ends when nothing more can be asked of it.
        drop(mem::replace(&mut self.requests, channel().0));
        if let Some(thread) = self.thread.take() {
            // One that has panicked has said so, and has ended.
            let _ = thread.join();
        }
    }
}

/// Draws what is asked for, until nothing more can be.
fn draw_requests(mut renderer: Renderer, packed: Arc<PackedVolume>, requests: &Receiver<Request>) {
    let mut scene = PreviewScene::of_file(packed);
    for request in requests {
        let Some(answer) = draw(&mut renderer, &mut scene, &request).transpose() else { continue };
        let _ = match &request.answer {
            To::Window(sender) => sender.send(answer).is_ok(),
            To::File(sender) => {
                let picture = answer.and_then(|(target, _)| finished_picture(&renderer, &request.state, &target));
                sender.send(picture).is_ok()
            }
        };
        request.context.request_repaint();
    }
}

/// Draws a picture; `None` when it is given up.
fn draw(renderer: &mut Renderer, scene: &mut PreviewScene, request: &Request) -> Result<Option<Answer>> {
    let Request { state, watch, .. } = request;
    if watch.is_given_up() {
        return Ok(None);
    }
    let start = Instant::now();
    let gpu = renderer.gpu().clone();
    let target = Target::new(&gpu, state.render_settings.image_size)?;
    renderer.prepare_scene(&state.scene, &scene.surfaces(&state.scene)?, target.size())?;
    let least = if gpu.is_cpu { LEAST_ROWS_OF_CPU } else { LEAST_ROWS };
    draw_in_strips((&gpu, renderer), state, &target, least, watch)?;
    Ok((!watch.is_given_up()).then(|| (target, start.elapsed().as_secs_f64())))
}
