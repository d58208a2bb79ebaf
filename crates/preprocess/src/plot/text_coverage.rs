//! Text as shares of pixels, for programs that draw it over pictures of their own.

use plotters::prelude::*;

use super::lettering::{provide_font, style, text_width};
use crate::{Error, Result};

/// A line of text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextCoverage {
    /// Pixels to the right.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// How much of each pixel is ink, 255 for all of it, the top row first.
    pub coverage: Vec<u8>,
}

/// Draws a line of text with letters of a height in pixels.
///
/// # Errors
/// [`crate::Error::Parameter`] when it cannot be drawn.
pub fn text_coverage(text: &str, height: u32) -> Result<TextCoverage> {
    provide_font()?;
    let size = height as i32;
    // Letters reach beyond the height that is asked for, upwards and downwards.
    let above = (size / 4).max(1);
    let (width, height) = (text_width(text, size).max(1) as u32, height + 2 * above as u32);
    let failed = |error: &dyn std::error::Error| Error::Parameter(format!("the text could not be drawn: {error}"));
    let mut pixels = vec![0; 3 * width as usize * height as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        area.draw_text(text, &style(size, &WHITE), (0, above)).map_err(|error| failed(&error))?;
        area.present().map_err(|error| failed(&error))?;
    }
    let coverage = pixels.chunks_exact(3).map(|pixel| pixel[0]).collect();
    Ok(TextCoverage { width, height, coverage })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_leave_ink_and_spaces_none() {
        let ink = |text: &str| {
            let TextCoverage { width, height, coverage } = text_coverage(text, 20).expect("is drawn");
            assert_eq!(coverage.len(), (width * height) as usize);
            coverage.iter().filter(|&&share| share > 128).count()
        };
        assert!(ink("20 mm") > 60 && ink("µ") > 10);
        assert_eq!(ink("  "), 0);
    }
}
