//! Draws the window's picture with the CPU ray marcher, on a thread of its own.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use egui::{ColorImage, TextureHandle, TextureId, TextureOptions};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::drawer::{Drawer, Pace, picture_size};
use super::preview_scene::PreviewScene;
use super::refinement::{Detail, PASS_BUDGET};
use crate::drawing::Drawing;
use crate::reference::RayMarcher;
use crate::scene::Surfaces;
use crate::state::ViewState;
use crate::volume::VolumeTexels;
use crate::{Error, Picture, Result, Watch};

/// How often the window says how far a finer picture is: painting it takes time from that.
const REPORT: Duration = Duration::from_secs(2);

/// The thread, and what it draws.
pub struct CpuDrawer {
    volume: Arc<VolumeTexels>,
    /// Of the volume or, where that is too large, of a coarser level. The thread looks for surfaces; nobody waits for it.
    scene: Arc<Mutex<PreviewScene>>,
    /// Not that of the whole program: pictures would wait for bricks to be unpacked.
    pool: Arc<ThreadPool>,
    requests: Sender<Request>,
    running: Option<Running>,
    /// The picture for a file, on a thread of its own.
    saved: Option<Receiver<Result<(Picture, usize)>>>,
    texture: Option<TextureHandle>,
}

/// A picture that the thread is to draw.
struct Request {
    state: ViewState,
    size: [u32; 2],
    watch: Arc<Watch>,
    answer: Sender<Result<Answer>>,
    context: egui::Context,
}

/// A complete picture, and the seconds that it took.
type Answer = (Picture, f64);

/// The picture that is being drawn; given up when dropped.
struct Running {
    rows: u32,
    watch: Arc<Watch>,
    answer: Receiver<Result<Answer>>,
}

impl Drop for Running {
    fn drop(&mut self) {
        self.watch.give_up();
    }
}

impl CpuDrawer {
    /// Begins a thread for a volume.
    ///
    /// # Errors
    /// [`Error::Device`] when there can be no more threads.
    pub fn new(volume: &Arc<VolumeTexels>) -> Result<Self> {
        let pool = ThreadPoolBuilder::new().build().map_err(|error| Error::Device {
            action: "starting to draw",
            device: "the CPU".to_owned(),
            reason: error.to_string(),
        })?;
        let (pool, scene) = (Arc::new(pool), Arc::new(Mutex::new(PreviewScene::new(volume))));
        let requests = begin_thread(volume, &scene, &pool);
        Ok(Self { volume: Arc::clone(volume), scene, pool, requests, running: None, saved: None, texture: None })
    }

    fn ended(&self) -> Error {
        let reason = "its thread has ended".to_owned();
        Error::Device { action: "drawing the picture", device: self.name(), reason }
    }
}

impl Drawer for CpuDrawer {
    fn name(&self) -> String {
        match self.pool.current_num_threads() {
            1 => "CPU, 1 thread".to_owned(),
            threads => format!("CPU, {threads} threads"),
        }
    }

    fn level(&self) -> usize {
        self.volume.description.level
    }

    fn replace_volume(&mut self, volume: &Arc<VolumeTexels>) -> Result<()> {
        self.running = None;
        if PreviewScene::has_room_for(volume) {
            self.scene = Arc::new(Mutex::new(PreviewScene::new(volume)));
        }
        // The thread before ends with its sender.
        self.requests = begin_thread(volume, &self.scene, &self.pool);
        self.volume = Arc::clone(volume);
        Ok(())
    }

    fn begin(&mut self, context: &egui::Context, wanted: &ViewState, detail: Detail) -> Result<()> {
        let mut state = wanted.clone();
        state.render_settings.step *= detail.step_factor;
        let size = picture_size(wanted.render_settings.image_size, detail);
        let limit = context.input(|input| input.max_texture_side) as u32;
        if let [width, height] = size
            && width.max(height) > limit
        {
            return Err(Error::PictureSize { width, height, limit });
        }
        let (watch, (answer, receiver)) = (Arc::new(Watch::default()), channel());
        self.running = Some(Running { rows: size[1], watch: Arc::clone(&watch), answer: receiver });
        let request = Request { state, size, watch, answer, context: context.clone() };
        self.requests.send(request).map_err(|_| self.ended())
    }

    fn go_on(&mut self, context: &egui::Context, pace: Pace) -> Result<Option<f64>> {
        let Some(running) = &self.running else { return Ok(None) };
        // Most drafts are there much sooner, and so in the same frame as what they show.
        let patience = Duration::from_secs_f64(if pace == Pace::AtOnce { PASS_BUDGET } else { 0.0 });
        let answer = match running.answer.recv_timeout(patience) {
            Ok(answer) => answer,
            Err(RecvTimeoutError::Timeout) => {
                // The thread wakes the window when it is done.
                context.request_repaint_after(REPORT);
                return Ok(None);
            }
            Err(RecvTimeoutError::Disconnected) => Err(self.ended()),
        };
        self.running = None;
        let (Picture { width, height, rgba }, seconds) = answer?;
        let image = ColorImage::from_rgba_unmultiplied([width as usize, height as usize], &rgba);
        match &mut self.texture {
            Some(texture) => texture.set(image, TextureOptions::LINEAR),
            None => self.texture = Some(context.load_texture("picture", image, TextureOptions::LINEAR)),
        }
        Ok(Some(seconds))
    }

    fn give_up(&mut self) {
        self.running = None;
    }

    fn progress(&self) -> Option<f32> {
        self.running.as_ref().map(|running| running.watch.rows() as f32 / running.rows as f32)
    }

    fn texture(&self) -> Option<TextureId> {
        self.texture.as_ref().map(TextureHandle::id)
    }

    fn begin_saved(&mut self, context: &egui::Context, view: &ViewState) -> Result<()> {
        let (answer, receiver) = channel();
        let (volume, pool) = (Arc::clone(&self.volume), Arc::clone(&self.pool));
        let (view, context) = (view.clone(), context.clone());
        thread::spawn(move || {
            let level = volume.description.level;
            let draw = || Ok((Drawing::on_cpu(&volume, &view)?.draw(&view.camera)?.picture, level));
            // Nobody waits for what is no longer wanted.
            let _ = answer.send(pool.install(draw));
            context.request_repaint();
        });
        self.saved = Some(receiver);
        Ok(())
    }

    fn go_on_saved(&mut self, _: &egui::Context) -> Result<Option<(Picture, usize)>> {
        let Some(saved) = &self.saved else { return Ok(None) };
        let answer = match saved.try_recv() {
            Ok(answer) => answer,
            // The thread wakes the window when it is done.
            Err(TryRecvError::Empty) => return Ok(None),
            Err(TryRecvError::Disconnected) => Err(self.ended()),
        };
        self.saved = None;
        answer.map(Some)
    }

    fn into_volume(self: Box<Self>) -> Option<Arc<VolumeTexels>> {
        Some(self.volume)
    }
}

/// A thread that draws what is sent to it, until nothing more can be sent.
fn begin_thread(
    volume: &Arc<VolumeTexels>,
    scene: &Arc<Mutex<PreviewScene>>,
    pool: &Arc<ThreadPool>,
) -> Sender<Request> {
    let (volume, scene, pool) = (Arc::clone(volume), Arc::clone(scene), Arc::clone(pool));
    let (sender, requests) = channel::<Request>();
    thread::spawn(move || {
        let mut marcher = None;
        for request in requests {
            let drawn = surfaces_of(&scene, &pool, &request)
                .and_then(|surfaces| pool.install(|| draw(&volume, &mut marcher, surfaces, &request)));
            if let Some(answer) = drawn.transpose() {
                // Nobody waits for what is no longer wanted.
                let _ = request.answer.send(answer);
                request.context.request_repaint();
            }
        }
    });
    sender
}

/// The surfaces of a picture; `None` when it is given up. Locked by a thread that is none of the pool's: one of those could take on
/// another picture's work while it waits, and wait for itself.
fn surfaces_of(scene: &Mutex<PreviewScene>, pool: &ThreadPool, request: &Request) -> Result<Option<Arc<Surfaces>>> {
    if request.watch.is_given_up() {
        return Ok(None);
    }
    let mut scene = scene.lock().unwrap_or_else(PoisonError::into_inner);
    let scene = &mut *scene;
    pool.install(|| scene.surfaces(&request.state.scene)).map(Some)
}

/// Draws a picture; `None` when it is given up. What the marcher needs not make anew it keeps for the next one.
fn draw<'a>(
    volume: &'a VolumeTexels,
    kept: &mut Option<RayMarcher<'a>>,
    surfaces: Option<Arc<Surfaces>>,
    request: &Request,
) -> Result<Option<Answer>> {
    let Request { state, size, watch, .. } = request;
    let Some(surfaces) = surfaces else { return Ok(None) };
    let start = Instant::now();
    let marcher = match kept.take() {
        Some(mut marcher) => {
            marcher.look_at(state, *size, surfaces)?;
            marcher
        }
        None => RayMarcher::with_surfaces(volume, state, *size, surfaces)?,
    };
    let marcher = kept.insert(marcher);
    let (light, _) = marcher.watched_light(watch);
    if watch.is_given_up() {
        return Ok(None);
    }
    let picture = light.picture(Some(marcher.frame().background));
    Ok(Some((picture, start.elapsed().as_secs_f64())))
}
