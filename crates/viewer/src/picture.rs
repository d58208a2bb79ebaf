//! Finished pictures in memory, and as files.

use glam::{Vec3, Vec4};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use voxrole_preprocess::export::npy;

use crate::Result;
use crate::scene::OpaquePixel;

/// Pixels, at least, that a thread takes.
const PARALLEL: usize = 1 << 12;

/// Display values, 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels to the right.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Red, green, blue, alpha of every pixel, the top row first.
    pub rgba: Vec<u8>,
}

impl Picture {
    /// The picture as a PNG file.
    ///
    /// # Errors
    /// [`crate::Error::Encode`] when the encoder refuses, as for a picture without pixels.
    pub fn to_png(&self) -> Result<Vec<u8>> {
        to_png(&self.rgba, self.width, self.height, ExtendedColorType::Rgba8)
    }

    /// Red, green, blue and alpha of one pixel, counted from the top left.
    ///
    /// # Panics
    /// When the pixel lies outside.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 4] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) lies outside {} x {}", self.width, self.height);
        let at = (y as usize * self.width as usize + x as usize) * 4;
        [self.rgba[at], self.rgba[at + 1], self.rgba[at + 2], self.rgba[at + 3]]
    }
}

fn to_png(bytes: &[u8], width: u32, height: u32, color: ExtendedColorType) -> Result<Vec<u8>> {
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(bytes, width, height, color)?;
    Ok(png)
}

/// Pictures that follow each other, as an animated PNG that goes round and round. What is kept of them is what the file has.
pub struct Animation<'a>(png::Writer<&'a mut Vec<u8>>);

impl<'a> Animation<'a> {
    /// Of so many pictures of one size, from 1 to 240 a second, into `apng`.
    ///
    /// # Errors
    /// [`crate::Error::Animation`] when the encoder refuses, as for no pictures at all.
    pub fn new(apng: &'a mut Vec<u8>, [width, height]: [u32; 2], pictures: u32, per_second: f32) -> Result<Self> {
        let mut encoder = png::Encoder::new(apng, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_animated(pictures, 0)?;
        // A delay is a fraction of two short integers.
        let (count, of) = if per_second.fract() == 0.0 { (1.0, per_second) } else { (10_000.0 / per_second, 10_000.0) };
        encoder.set_frame_delay(count.round() as u16, of as u16)?;
        Ok(Self(encoder.write_header()?))
    }

    /// Adds the next one.
    ///
    /// # Errors
    /// [`crate::Error::Animation`] when it is of another size, or one too many.
    pub fn add(&mut self, picture: &Picture) -> Result<()> {
        Ok(self.0.write_image_data(&picture.rgba)?)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// [`crate::Error::Animation`] when there are fewer pictures than were to come.
    pub fn finish(self) -> Result<()> {
        Ok(self.0.finish()?)
    }
}

/// What reaches one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelLight {
    /// Colour premultiplied by opacity, and opacity.
    pub light: Vec4,
    /// How far along the pixel's ray half of the light behind is stopped, in multiples of `L_min`; NaN where less is.
    pub depth: f32,
}

impl PixelLight {
    /// Nothing.
    pub const NONE: Self = Self { light: Vec4::ZERO, depth: f32::NAN };

    /// What lies behind it is seen through it.
    pub(crate) fn lie_over(&mut self, opaque: &OpaquePixel) {
        if opaque.is_some() {
            self.light += (1.0 - self.light.w) * opaque.color.extend(1.0);
            self.depth = if self.depth.is_nan() { opaque.along } else { self.depth };
        }
    }

    /// Red, green, blue and alpha, 0 to 1.
    fn channels(&self, background: Option<Vec3>) -> Vec4 {
        let light = self.light;
        let channels = match background {
            Some(background) => (light.truncate() + (1.0 - light.w) * background).extend(1.0),
            None if light.w > 0.0 => (light.truncate() / light.w).extend(light.w),
            None => Vec4::ZERO,
        };
        channels.clamp(Vec4::ZERO, Vec4::ONE)
    }
}

/// A picture at full precision, without a background.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPicture {
    /// Pixels to the right.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Every pixel, the top row first.
    pub pixels: Vec<PixelLight>,
}

impl LightPicture {
    /// Display values over a background, or transparent without one.
    #[must_use]
    pub fn picture(&self, background: Option<Vec3>) -> Picture {
        let pixels = self.pixels.par_iter().with_min_len(PARALLEL);
        let rgba =
            |pixel: &PixelLight| (pixel.channels(background) * 255.0 + 0.5).to_array().map(|channel| channel as u8);
        let rgba: Vec<[u8; 4]> = pixels.map(rgba).collect();
        Picture { width: self.width, height: self.height, rgba: rgba.into_flattened() }
    }

    /// The same with 16 bits a channel, as a PNG file.
    ///
    /// # Errors
    /// As [`Picture::to_png`].
    pub fn to_deep_png(&self, background: Option<Vec3>) -> Result<Vec<u8>> {
        let rgba = self.pixels.iter().flat_map(|pixel| (pixel.channels(background) * 65535.0 + 0.5).to_array());
        let bytes: Vec<u8> = rgba.flat_map(|channel| (channel as u16).to_ne_bytes()).collect();
        to_png(&bytes, self.width, self.height, ExtendedColorType::Rgba16)
    }

    /// Depths as numpy's array of shape (height, width), f32, each times `scale`.
    #[must_use]
    pub fn depth_npy(&self, scale: f64) -> Vec<u8> {
        let mut bytes = npy::header("<f4", false, &[self.height as usize, self.width as usize]);
        bytes.extend(self.pixels.iter().flat_map(|pixel| ((f64::from(pixel.depth) * scale) as f32).to_le_bytes()));
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light() -> LightPicture {
        let pixel = |light: [f32; 4], depth| PixelLight { light: Vec4::from_array(light), depth };
        let pixels = vec![pixel([0.0; 4], f32::NAN), pixel([0.25, 0.0, 0.5, 0.5], 3.0)];
        LightPicture { width: 2, height: 1, pixels }
    }

    #[test]
    fn pixels_lie_over_a_background_or_are_transparent() {
        let over = light().picture(Some(Vec3::new(0.0, 1.0, 0.0)));
        assert_eq!(over.rgba, [0, 255, 0, 255, 64, 128, 128, 255]);
        assert_eq!(light().picture(None).rgba, [0, 0, 0, 0, 128, 0, 255, 128]);
    }

    #[test]
    fn deep_pictures_have_sixteen_bits() {
        let png = light().to_deep_png(None).expect("is encoded");
        let decoded = image::load_from_memory(&png).expect("is a picture");
        assert_eq!(decoded.color(), image::ColorType::Rgba16);
        assert_eq!(decoded.into_rgba16().into_raw(), [0, 0, 0, 0, 32768, 0, 65535, 32768]);
    }

    #[test]
    fn depths_are_in_world_units() {
        let npy = light().depth_npy(0.5);
        assert!(npy.ends_with(&1.5_f32.to_le_bytes()));
        assert!(String::from_utf8_lossy(&npy).contains("'shape': (1, 2)"));
    }

    #[test]
    fn animations_hold_every_picture() {
        let picture = |value| Picture { width: 2, height: 1, rgba: vec![value; 8] };
        let mut apng = Vec::new();
        let mut animation = Animation::new(&mut apng, [2, 1], 3, 25.0).expect("begins");
        [1, 2, 3].into_iter().try_for_each(|value| animation.add(&picture(value))).expect("is encoded");
        animation.finish().expect("is complete");
        let mut reader = png::Decoder::new(std::io::Cursor::new(&apng)).read_info().expect("is a picture");
        assert_eq!(reader.info().animation_control().map(|control| control.num_frames), Some(3));
        for value in 1..=3 {
            let mut rgba = [0; 8];
            reader.next_frame(&mut rgba).expect("a frame");
            assert_eq!(rgba, [value; 8]);
        }
        assert!(Animation::new(&mut Vec::new(), [2, 1], 0, 25.0).is_err());
    }
}
