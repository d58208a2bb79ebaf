//! A bar of a round length over a picture, with that length below it.

use glam::{Vec3, Vec4};
use voxrole_preprocess::plot::{TextCoverage, text_coverage};

use super::lines::readable_on;
use super::projection::PixelProjection;
use crate::classify::EmphasisTable;
use crate::frame::Frame;
use crate::state::{TransferFunction, ViewState};
use crate::volume::VolumeDescription;
use crate::{LightPicture, Picture, Result};

/// Longest bar as a share of the picture's width.
const LONGEST: f64 = 0.25;

/// How long a bar is.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleBar {
    /// On the picture.
    pub pixels: f32,
    /// In world units, with the unit where one is known.
    pub label: String,
}

impl ScaleBar {
    /// The longest bar of 1, 2 or 5 times a power of ten that takes a quarter of the width or less. In perspective it
    /// holds at the depth of the volume's middle; `None` where that lies behind the eye.
    #[must_use]
    pub fn new(state: &ViewState, volume: &VolumeDescription, image_size: [u32; 2]) -> Option<Self> {
        let frame = Frame::new(state, volume, &EmphasisTable::new(&TransferFunction::default()), image_size);
        let projection = PixelProjection::from(&frame);
        let depth = projection.depth(0.5 * (frame.box_low + frame.box_high));
        let pixel = f64::from(projection.pixel_width(depth, image_size)) * volume.smallest_spacing();
        let length = round_length(LONGEST * f64::from(image_size[0]) * pixel)?;
        let unit: String = volume.unit.chars().take(12).collect();
        let label = format!("{} {unit}", number(length)).trim_end().to_owned();
        Some(Self { pixels: (length / pixel) as f32, label })
    }
}

/// The largest of 1, 2 or 5 times a power of ten that is at most a length; `None` for lengths that are none.
fn round_length(most: f64) -> Option<f64> {
    if !(most.is_finite() && most > 0.0) {
        return None;
    }
    let exponent = most.log10().floor() as i32;
    // The smaller power is there for rounding.
    let lengths = [(5, exponent), (2, exponent), (1, exponent), (5, exponent - 1)];
    // Written and read, because powers of ten below 1 have no exact form.
    let lengths = lengths.into_iter().filter_map(|(digit, exponent)| format!("{digit}e{exponent}").parse().ok());
    lengths.into_iter().find(|&length: &f64| length <= most && length > 0.0)
}

fn number(length: f64) -> String {
    if (1e-3..1e5).contains(&length) { length.to_string() } else { format!("{length:e}") }
}

/// A bar and its label as they lie over a picture's pixels: ink, with a rim that sets it off from what is below.
struct Overlay {
    /// Left upper corner.
    corner: [u32; 2],
    size: [u32; 2],
    /// Shares of rim and of ink, 0 to 1, the top row first.
    shares: Vec<[f32; 2]>,
    rim: Vec3,
    ink: Vec3,
}

impl Overlay {
    /// In the lower right corner; `None` where there is no room for it.
    fn new(bar: &ScaleBar, [width, height]: [u32; 2], background: Vec3) -> Result<Option<Self>> {
        let shorter = width.min(height);
        let TextCoverage { width: text_width, height: text_height, coverage } =
            text_coverage(&bar.label, (shorter / 36).clamp(13, 64))?;
        let (line, margin) = ((shorter / 200).max(2), (shorter / 40).max(6));
        let pixels = bar.pixels.round() as u32;
        let inner = [pixels.max(text_width), text_height + 3 * line];
        let size = inner.map(|side| side + 2);
        if pixels < 8 || size[0] + margin > width || size[1] + margin > height {
            return Ok(None);
        }
        let mut ink = vec![0.0_f32; (size[0] * size[1]) as usize];
        let mut put = |x: u32, y: u32, share: f32| ink[((y + 1) * size[0] + x + 1) as usize] = share;
        let left = (inner[0] - text_width) / 2;
        for (at, &share) in coverage.iter().enumerate() {
            let at = at as u32;
            put(left + at % text_width, at / text_width, f32::from(share) / 255.0);
        }
        let left = (inner[0] - pixels) / 2;
        for (x, y) in (0..pixels).flat_map(|x| (0..line).map(move |y| (x, y))) {
            put(left + x, text_height + 2 * line + y, 1.0);
        }
        let share_at = |x: u32, y: u32| ink[(y.min(size[1] - 1) * size[0] + x.min(size[0] - 1)) as usize];
        let shares = (0..size[0] * size[1]).map(|at| {
            let (x, y) = (at % size[0], at / size[0]);
            let around =
                (0..9).map(|near| share_at((x + near % 3).saturating_sub(1), (y + near / 3).saturating_sub(1)));
            [around.fold(0.0, f32::max), share_at(x, y)]
        });
        let dark = readable_on(background)[0] > 0.5;
        let [rim, ink] = if dark { [Vec3::ZERO, Vec3::ONE] } else { [Vec3::ONE, Vec3::ZERO] };
        let corner = [width - margin - size[0], height - margin - size[1]];
        Ok(Some(Self { corner, size, shares: shares.collect(), rim, ink }))
    }

    /// Every pixel's number in a picture of some width, the share of what was there that stays, and what is added.
    fn pixels(&self, width: u32) -> impl Iterator<Item = (usize, f32, Vec3)> {
        self.shares.iter().enumerate().map(move |(at, &[rim, ink])| {
            let at = at as u32;
            let place = (self.corner[1] + at / self.size[0]) * width + self.corner[0] + at % self.size[0];
            (place as usize, (1.0 - rim) * (1.0 - ink), (1.0 - ink) * rim * self.rim + ink * self.ink)
        })
    }
}

/// Draws a bar over a picture, in its lower right corner; a picture without room for it stays as it is.
///
/// # Errors
/// [`crate::Error::Preprocess`] when its label cannot be drawn.
pub fn draw_over_picture(bar: &ScaleBar, picture: &mut Picture, background: Vec3) -> Result<()> {
    let Some(overlay) = Overlay::new(bar, [picture.width, picture.height], background)? else { return Ok(()) };
    for (place, stays, added) in overlay.pixels(picture.width) {
        let pixel = &mut picture.rgba[4 * place..4 * place + 3];
        for (channel, added) in pixel.iter_mut().zip(added.to_array()) {
            *channel = (f32::from(*channel) * stays + added * 255.0 + 0.5) as u8;
        }
    }
    Ok(())
}

/// Draws a bar over light, as [`draw_over_picture`]; depths stay as they are.
///
/// # Errors
/// As there.
pub fn draw_over_light(bar: &ScaleBar, picture: &mut LightPicture, background: Vec3) -> Result<()> {
    let Some(overlay) = Overlay::new(bar, [picture.width, picture.height], background)? else { return Ok(()) };
    for (place, stays, added) in overlay.pixels(picture.width) {
        let light: &mut Vec4 = &mut picture.pixels[place].light;
        *light = *light * stays + added.extend(1.0 - stays);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round() {
        for (most, expected) in [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (49.0, 20.0), (0.06, 0.05), (3e-9, 2e-9)] {
            assert_eq!(round_length(most), Some(expected), "{most}");
        }
        assert!([0.0, -1.0, f64::NAN, f64::INFINITY].iter().all(|&most| round_length(most).is_none()));
        assert_eq!([0.05, 20.0, 2e-9, 1e6].map(number), ["0.05", "20", "2e-9", "1e6"]);
    }

    #[test]
    fn a_bar_lies_in_the_lower_right_corner_as_long_as_it_says() {
        let bar = ScaleBar { pixels: 40.0, label: "20 mm".to_owned() };
        let mut picture = Picture { width: 120, height: 90, rgba: vec![7; 4 * 120 * 90] };
        draw_over_picture(&bar, &mut picture, Vec3::ZERO).expect("a label");
        let row = |y: u32| (0..120).filter(|&x| picture.pixel(x, y)[0] == 255).count();
        assert!((60..90).any(|y| row(y) == 40) && (0..60).all(|y| row(y) == 0));
        let mut small = Picture { width: 20, height: 10, rgba: vec![7; 4 * 20 * 10] };
        draw_over_picture(&bar, &mut small, Vec3::ZERO).expect("a label");
        assert!(small.rgba.iter().all(|&channel| channel == 7));
    }
}
