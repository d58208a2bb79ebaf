//! What is shown: the volume in words and numbers.

use egui::Ui;
use voxrole_pack::WorldFrame;
use voxrole_preprocess::plot::numbers::{group_thousands, short_number};

use super::form::{rows, text_row};
use super::opened_volume::OpenedVolume;

/// Name, grid, counts, and how the file was made.
pub fn readout_ui(ui: &mut Ui, volume: &OpenedVolume, device: &str) {
    ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Wrap);
    let header = &volume.header;
    let statistics = &header.statistics;
    let description = &volume.description;
    let [x, y, z] = description.dims;
    let voxels = u64::from(x) * u64::from(y) * u64::from(z);
    let unit = if description.unit.is_empty() { String::new() } else { format!(" {}", description.unit) };
    ui.strong(&header.source.name).on_hover_text(volume.path.display().to_string());
    rows(ui, "readout", |ui| {
        text_row(ui, "dimensions", format!("{x} × {y} × {z}"));
        text_row(ui, "spacing", format!("{}{unit}", description.spacing.map(short_number).join(" × ")));
        if description.frame == WorldFrame::LeftPosteriorSuperior {
            text_row(ui, "axes", "left, posterior, superior");
        }
        let [low, high] = statistics.value_range.map(short_number);
        text_row(ui, "values", format!("{low} to {high}"));
        text_row(ui, "d_max", format!("{} voxels", short_number(f64::from(description.d_max_in_spacings()))));
        text_row(ui, "voxels", group_thousands(voxels));
        text_row(ui, "with boundary", share(statistics.hits, voxels));
        text_row(ui, "without", share(statistics.misses, voxels));
        if statistics.masked > 0 {
            text_row(ui, "masked", share(statistics.masked, voxels));
        }
        text_row(ui, "drawn on", device);
    });
    let made = egui::CollapsingHeader::new(egui::RichText::new("How it was prepared").small());
    made.show_unindented(ui, |ui| {
        rows(ui, "parameters", |ui| {
            text_row(ui, "made by", &header.made_by);
            for parameter in &header.parameters {
                text_row(ui, &parameter.name, &parameter.value);
            }
        });
    });
}

fn share(count: u64, of: u64) -> String {
    format!("{} ({:.1} %)", group_thousands(count), 100.0 * count as f64 / of.max(1) as f64)
}
