//! Saves the picture as a PNG file, and all settings as a session beside it.

use std::path::{Path, PathBuf};

use egui::{Button, DragValue, Label, RichText, TextEdit, Ui};
use voxrole_pack::atomic_file;

use super::preview::Preview;
use super::theme;
use crate::reference::MAX_IMAGE_SIDE;
use crate::state::ViewState;

/// Where to, and how the last time went.
#[derive(Clone, Debug, PartialEq)]
pub struct SavePicture {
    /// The file's name as typed.
    pub path: String,
    /// A file that was there before and may be replaced by the next press.
    replaceable: Option<PathBuf>,
    outcome: Option<Outcome>,
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
        Self { path: input.with_extension("png").display().to_string(), replaceable: None, outcome: None }
    }

    /// Draws the picture at the settings' size and writes it. A file that was there before is replaced only when this is
    /// called for it a second time.
    pub fn save(&mut self, preview: &mut Preview, view: &ViewState) {
        let path = PathBuf::from(self.path.trim());
        self.write(path, || {
            let picture = preview.picture(view).and_then(|picture| picture.to_png());
            picture.map_err(|error| error.to_string())
        });
    }

    /// Writes all settings into a file of the picture's name that ends in `.toml`; one that was there before as in
    /// [`Self::save`].
    pub fn save_session(&mut self, view: &ViewState) {
        let path = Path::new(self.path.trim()).with_extension("toml");
        self.write(path, || view.to_toml().map(String::into_bytes).map_err(|error| error.to_string()));
    }

    fn write(&mut self, path: PathBuf, content: impl FnOnce() -> Result<Vec<u8>, String>) {
        if path.exists() && self.replaceable.as_ref() != Some(&path) {
            self.outcome = Some(Outcome::Exists(format!("{} exists: press again to replace it", path.display())));
            self.replaceable = Some(path);
            return;
        }
        let written = content().and_then(|bytes| {
            atomic_file::write(&path, &bytes).map_err(|error| format!("writing {}: {error}", path.display()))
        });
        self.outcome = Some(match written {
            Ok(()) => Outcome::Saved(format!("Saved {}", path.display())),
            Err(error) => Outcome::Failed(error),
        });
        // What was written here is the user's own last picture.
        self.replaceable = Some(path);
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
    let usable = !save.path.trim().is_empty();
    let label = if matches!(save.outcome, Some(Outcome::Exists(_))) { "Replace PNG" } else { "Save PNG" };
    let button = ui.vertical_centered_justified(|ui| ui.add_enabled(usable, Button::new(label))).inner;
    if button.on_hover_text("Draws at this size with the full step, as `voxrole-view render` does").clicked() {
        save.save(preview, view);
    }
    let button = ui.vertical_centered_justified(|ui| ui.add_enabled(usable, Button::new("Save session"))).inner;
    if button.on_hover_text("All settings, in a file of this name that ends in .toml: opened by --session").clicked() {
        save.save_session(view);
    }
    let message = match &save.outcome {
        // The line stays, so that the buttons above do not move from under the pointer.
        None => RichText::new(" "),
        Some(Outcome::Saved(message) | Outcome::Exists(message)) => RichText::new(message),
        Some(Outcome::Failed(message)) => RichText::new(message).color(theme::ERROR),
    };
    ui.add(Label::new(message.small()).truncate());
}

fn side(ui: &mut Ui, pixels: &mut u32, name: &str) {
    ui.add(DragValue::new(pixels).range(1..=MAX_IMAGE_SIDE).speed(4)).on_hover_text(name).accessible_name(name);
}
