//! Colours, sizes and type of the window.

use egui::{Color32, CornerRadius, FontFamily, FontId, Stroke, TextStyle, Theme, Visuals, vec2};

/// What is selected, and handles.
pub const ACCENT: Color32 = Color32::from_rgb(0x4d, 0xa3, 0xff);
/// Ground of plots: near black, so that the lowest count still shows on it.
pub const PLOT_GROUND: Color32 = Color32::from_gray(12);
/// Lines of plots: frames, ticks and grid.
pub const PLOT_LINE: Color32 = Color32::from_gray(96);
/// Bars of plots.
pub const PLOT_BAR: Color32 = Color32::from_rgb(0x5c, 0x7a, 0x99);
/// A curve over bars.
pub const PLOT_CURVE: Color32 = Color32::from_rgb(0xff, 0xb0, 0x3b);
/// Something went wrong.
pub const ERROR: Color32 = Color32::from_rgb(0xff, 0x7b, 0x72);

/// Colours of new regions, display values: kept apart by all common kinds of colour vision.
///
/// Source: Okabe and Ito, "Color universal design", 2008.
pub const REGION_COLORS: [[u8; 3]; 6] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [213, 94, 0], [204, 121, 167]];

/// Of [`REGION_COLORS`] the one that is the furthest from colours that are in use; the first of several.
#[must_use]
pub fn new_region_color(used: impl Iterator<Item = [u8; 3]>) -> [u8; 3] {
    let used: Vec<_> = used.collect();
    let distance = |color: &[u8; 3]| used.iter().map(|other| color_distance(*color, *other)).min().unwrap_or(u32::MAX);
    // The last of the largest is taken: of equals the first in the list.
    REGION_COLORS.into_iter().rev().max_by_key(distance).unwrap_or(REGION_COLORS[0])
}

/// How different two colours look, squared: a distance in red, green and blue, weighted by how red they are.
///
/// Source: T. Riemersma, "Colour metric", compuphase.com/cmetric.htm: nearer to perception than equal weights, and as simple.
fn color_distance(a: [u8; 3], b: [u8; 3]) -> u32 {
    let mean_red = (u32::from(a[0]) + u32::from(b[0])) / 2;
    let [red, green, blue] = [0, 1, 2].map(|channel: usize| u32::from(a[channel].abs_diff(b[channel])).pow(2));
    (((512 + mean_red) * red) >> 8) + 4 * green + (((767 - mean_red) * blue) >> 8)
}

/// Gives a context the window's look.
pub fn apply(context: &egui::Context) {
    context.set_theme(Theme::Dark);
    context.all_styles_mut(|style| {
        style.visuals = visuals();
        style.spacing.item_spacing = vec2(6.0, 4.0);
        style.spacing.button_padding = vec2(6.0, 1.0);
        style.text_styles = [
            (TextStyle::Heading, 15.0, FontFamily::Proportional),
            (TextStyle::Body, 13.0, FontFamily::Proportional),
            (TextStyle::Button, 13.0, FontFamily::Proportional),
            (TextStyle::Monospace, 12.0, FontFamily::Monospace),
            (TextStyle::Small, 11.0, FontFamily::Proportional),
        ]
        .map(|(text_style, size, family)| (text_style, FontId::new(size, family)))
        .into();
    });
}

/// Small type, for ticks.
#[must_use]
pub fn tick_font() -> FontId {
    FontId::proportional(10.5)
}

/// A colour in display values, 0 to 1 each.
#[must_use]
pub fn color32(color: [f32; 3]) -> Color32 {
    let [red, green, blue] = bytes(color);
    Color32::from_rgb(red, green, blue)
}

/// A colour's channels rounded to 8 bits.
#[must_use]
pub fn bytes(color: [f32; 3]) -> [u8; 3] {
    color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8)
}

fn visuals() -> Visuals {
    let mut visuals = Visuals::dark();
    // Neutral and dark, so that the picture's colours are judged against nothing coloured.
    visuals.panel_fill = Color32::from_gray(30);
    visuals.window_fill = Color32::from_gray(36);
    visuals.extreme_bg_color = Color32::from_gray(16);
    visuals.override_text_color = Some(Color32::from_gray(214));
    visuals.selection.bg_fill = ACCENT.gamma_multiply(0.45);
    visuals.selection.stroke = Stroke::new(1.0, Color32::WHITE);
    visuals.slider_trailing_fill = true;
    for widget in [
        &mut visuals.widgets.noninteractive,
        &mut visuals.widgets.inactive,
        &mut visuals.widgets.hovered,
        &mut visuals.widgets.active,
        &mut visuals.widgets.open,
    ] {
        widget.corner_radius = CornerRadius::same(3);
    }
    visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, Color32::from_gray(52));
    visuals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_regions_look_unlike_those_that_are_there() {
        let [orange, sky, green, yellow, vermilion, purple] = REGION_COLORS;
        assert_eq!(new_region_color([].into_iter()), orange);
        // What is proposed is orange and sky blue: vermilion is too near to orange.
        let mut used = vec![orange, sky];
        let next = new_region_color(used.iter().copied());
        assert!([green, yellow, purple].contains(&next), "{next:?}");
        for _ in 0..4 {
            let next = new_region_color(used.iter().copied());
            assert!(!used.contains(&next), "{next:?}");
            used.push(next);
        }
        assert_eq!(used.last(), Some(&vermilion), "the nearest to others comes last: {used:?}");
    }
}
