//! Letters and ink that all plots share.

use std::sync::OnceLock;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::{Error, Result};

/// The font that comes with the program, under a name by which viewers of SVG find one of their own like it.
const FONT: &str = "monospace";
/// Size of the numbers at ticks.
pub(super) const TICK_SIZE: i32 = 15;
/// Size of the titles of axes.
pub(super) const AXIS_TITLE_SIZE: i32 = 17;
/// Lines behind the data.
pub(super) const GRID: RGBColor = RGBColor(228, 228, 228);
/// Text and axes.
pub(super) const INK: RGBColor = RGBColor(32, 32, 32);
/// Text of less weight.
pub(super) const FAINT_INK: RGBColor = RGBColor(96, 96, 96);
/// Width of a letter as a share of the size given to [`style`], which is the height from the lowest to the highest.
const WIDTH_OF_LETTER: f64 = 0.52;

/// Makes the font known to plotters.
pub(super) fn provide_font() -> Result<()> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let register = || register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR).is_ok();
    if *REGISTERED.get_or_init(register) {
        Ok(())
    } else {
        Err(Error::Parameter("the font that comes with the program cannot be read".to_owned()))
    }
}

/// Text of a size and colour.
pub(super) fn style(size: i32, colour: &RGBColor) -> TextStyle<'static> {
    (FONT, size).into_font().color(colour)
}

/// Width of a text in pixels: all letters are equally wide.
pub(super) fn text_width(text: &str, size: i32) -> i32 {
    (text.chars().count() as f64 * f64::from(size) * WIDTH_OF_LETTER).ceil() as i32
}
