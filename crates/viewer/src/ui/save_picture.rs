//! Saves the picture as a PNG file, and all settings as a session beside it.

use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};

use egui::{Button, Label, RichText, TextEdit, Ui};
use voxrole_pack::atomic_file;

use super::form::number_value;
use super::preview::Preview;
use super::theme;
use crate::reference::MAX_IMAGE_SIDE;
use crate::state::ViewState;

/// Where to, and how the last time went.
#[derive(Debug)]
pub struct SavePicture {
    /// The file's name as typed.
    pub path: String,
    /// What is shown, which is not to be replaced.
    input: PathBuf,
    /// A file that was there before and may be replaced by the next press.
    replaceable: Option<PathBuf>,
    outcome: Option<Outcome>,
    pending: Option<Pending>,
}

/// A picture on its way to its file.
#[derive(Debug)]
enum Pending {
    Drawing(PathBuf),
    /// On a thread, which returns how that went.
    Writing(JoinHandle<Outcome>),
}

#[derive(Clone, Debug, PartialEq)]
enum Outcome {
    Saved(String),
    Failed(String),
    Exists(String),
}

impl SavePicture {
    /// Beside the input, under its name.
    #[must_use]
    pub fn new(input: &Path) -> Self {
        Self {
            path: input.with_extension("png").display().to_string(),
            input: input.to_owned(),
            replaceable: None,
            outcome: None,
            pending: None,
        }
    }

    /// Begins to draw the picture at the settings' size, which is written once it is complete, while the window goes on. A file
    /// that was there before is replaced only when this is called for it a second time.
    pub fn save(&mut self, context: &egui::Context, preview: &mut Preview, view: &ViewState) {
        let path = PathBuf::from(self.path.trim());
        if !path.extension().is_some_and(|found| found.eq_ignore_ascii_case("png")) {
            self.outcome = Some(Outcome::Failed(format!("{}: what is written is png; name it so", path.display())));
            return;
        }
        if !self.may_write(&path) {
            return;
        }
        match preview.begin_saved(context, view) {
            Ok(()) => {
                self.outcome = None;
                self.pending = Some(Pending::Drawing(path));
            }
            Err(error) => self.outcome = Some(Outcome::Failed(error.to_string())),
        }
    }

    /// Goes on with the picture that is being saved.
    pub fn go_on(&mut self, context: &egui::Context, preview: &mut Preview) {
        match self.pending.take() {
            Some(Pending::Drawing(path)) => match preview.go_on_saved(context) {
                Ok(None) => self.pending = Some(Pending::Drawing(path)),
                Ok(Some((picture, level))) => {
                    let context = context.clone();
                    let of = if level > 0 { format!(" of level {level} of the volume") } else { String::new() };
                    self.pending = Some(Pending::Writing(thread::spawn(move || {
                        let outcome = write(&path, picture.to_png().map_err(|error| error.to_string()), &of);
                        context.request_repaint();
                        outcome
                    })));
                }
                Err(error) => self.outcome = Some(Outcome::Failed(error.to_string())),
            },
            Some(Pending::Writing(thread)) if thread.is_finished() => self.outcome = Some(join(thread)),
            pending => self.pending = pending,
        }
        if let Some(Pending::Writing(_)) = self.pending {
            // A thread that has woken the window need not have ended.
            context.request_repaint_after_secs(0.05);
        }
    }

    /// Whether a picture is being drawn or written.
    #[must_use]
    pub fn is_saving(&self) -> bool {
        self.pending.is_some()
    }

    /// Takes note that what drew is gone.
    pub fn device_is_lost(&mut self) {
        if let Some(Pending::Drawing(path)) = self.pending.take_if(|pending| matches!(pending, Pending::Drawing(_))) {
            let message = format!("{} is not saved: the device was lost; press again", path.display());
            self.outcome = Some(Outcome::Failed(message));
        }
    }

    /// Writes all settings into a file of the picture's name that ends in `.toml`; one that was there before as in
    /// [`Self::save`].
    pub fn save_session(&mut self, view: &ViewState) {
        let path = Path::new(self.path.trim()).with_extension("toml");
        if self.may_write(&path) {
            self.outcome =
                Some(write(&path, view.to_toml().map(String::into_bytes).map_err(|error| error.to_string()), ""));
        }
    }

    /// Whether nothing is at a place but what was written there before, or may be replaced; what is written there next may.
    fn may_write(&mut self, path: &Path) -> bool {
        if let Err(error) = atomic_file::check_output(path, &[&self.input]) {
            self.outcome = Some(Outcome::Failed(format!("writing {}: {error}", path.display())));
            return false;
        }
        let may_write = !path.exists() || self.replaceable.as_deref() == Some(path);
        if !may_write {
            self.outcome = Some(Outcome::Exists(format!("{} exists: press again to replace it", path.display())));
        }
        self.replaceable = Some(path.to_owned());
        may_write
    }
}

impl Drop for SavePicture {
    /// What is complete is written, also where the window is closed meanwhile.
    fn drop(&mut self) {
        if let Some(Pending::Writing(thread)) = self.pending.take() {
            join(thread);
        }
    }
}

fn join(thread: JoinHandle<Outcome>) -> Outcome {
    thread.join().unwrap_or_else(|_| Outcome::Failed("a fault of this program; please report it".to_owned()))
}

/// `of` goes behind the name.
fn write(path: &Path, content: Result<Vec<u8>, String>, of: &str) -> Outcome {
    let written = content.and_then(|bytes| {
        atomic_file::write(path, &bytes).map_err(|error| format!("writing {}: {error}", path.display()))
    });
    match written {
        Ok(()) => Outcome::Saved(format!("Saved {}{of}", path.display())),
        Err(error) => Outcome::Failed(error),
    }
}

/// File name, size and the button; `viewport` is the window's picture in pixels.
pub fn save_picture_ui(
    ui: &mut Ui,
    save: &mut SavePicture,
    preview: &mut Preview,
    view: &mut ViewState,
    viewport: [u32; 2],
) {
    ui.add_space(6.0);
    ui.strong("Save picture");
    let edit = TextEdit::singleline(&mut save.path).desired_width(f32::INFINITY).hint_text("file name");
    if ui.add(edit).on_hover_text("File to write").accessible_name("File name of the picture").changed() {
        save.outcome = None;
        save.replaceable = None;
    }
    ui.horizontal(|ui| {
        let size = &mut view.render_settings.image_size;
        side(ui, &mut size[0], "Width of the picture in pixels");
        ui.label("×");
        side(ui, &mut size[1], "Height of the picture in pixels");
        if ui.small_button("as shown").on_hover_text("The size that the picture has in this window").clicked() {
            *size = viewport.map(|side| side.clamp(1, MAX_IMAGE_SIDE));
        }
    });
    let is_named = !save.path.trim().is_empty();
    let usable = is_named && !save.is_saving();
    let replaces = save.replaceable.as_deref().filter(|_| matches!(save.outcome, Some(Outcome::Exists(_))));
    let replaces_session = replaces.map(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let label = if replaces_session == Some(false) { "Replace PNG" } else { "Save PNG" };
    let button = ui.vertical_centered_justified(|ui| ui.add_enabled(usable, Button::new(label))).inner;
    if button.on_hover_text("Draws at this size with the full step, as `voxrole-view render` does").clicked() {
        save.save(ui.ctx(), preview, view);
    }
    let label = if replaces_session == Some(true) { "Replace session" } else { "Save session" };
    let button = ui.vertical_centered_justified(|ui| ui.add_enabled(usable, Button::new(label))).inner;
    if button.on_hover_text("All settings, in a file of this name that ends in .toml: opened by --session").clicked() {
        save.save_session(view);
    }
    let message = match &save.outcome {
        _ if save.is_saving() => RichText::new("Drawing the picture"),
        // The line stays, so that the buttons above do not move from under the pointer.
        None => RichText::new(" "),
        Some(Outcome::Saved(message) | Outcome::Exists(message)) => RichText::new(message),
        Some(Outcome::Failed(message)) => RichText::new(message).color(theme::ERROR),
    };
    ui.add(Label::new(message.small()).truncate());
}

fn side(ui: &mut Ui, pixels: &mut u32, name: &str) {
    ui.add(number_value(pixels, 1..=MAX_IMAGE_SIDE).speed(4)).on_hover_text(name).accessible_name(name);
}
