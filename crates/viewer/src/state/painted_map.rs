//! A map of weights over a region's rectangle, painted by hand.

use std::fmt;
use std::io::Cursor;
use std::str::FromStr;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, GrayImage, ImageEncoder, ImageFormat, ImageReader, Limits, imageops};

use super::ParseError;

/// Weights of a grid of cells: value to the right, gradient magnitude upwards. Between the cells' middles they are bilinear,
/// beyond the outermost ones as there.
#[derive(Clone, PartialEq, Eq)]
pub struct PaintedMap {
    width: usize,
    /// As shares of 255; value fastest, the lowest gradient magnitude first. Shared until one copy is painted.
    weights: Arc<[u8]>,
}

impl PaintedMap {
    /// Most cells along a side.
    pub const MOST_SIDE: usize = 256;
    /// Most pixels along a side of a picture that is read; it is reduced to [`Self::MOST_SIDE`].
    pub const MOST_PIXELS: u32 = 4096;
    /// Longest text of a map: more than any of [`Self::MOST_SIDE`] takes.
    const MOST_TEXT: usize = 1 << 20;
    /// Most memory for a picture while it is read, in bytes: 16 for each pixel of the largest.
    const MOST_MEMORY: u64 = 16 * (Self::MOST_PIXELS as u64).pow(2);

    /// The largest map, with nothing painted.
    #[must_use]
    pub fn blank() -> Self {
        Self { width: Self::MOST_SIDE, weights: vec![0; Self::MOST_SIDE * Self::MOST_SIDE].into() }
    }

    /// The largest map, of weights that are given for many places on a level, in shares of the rectangle.
    #[must_use]
    pub fn of(weights: impl Fn(&[f32], f32, &mut [f32])) -> Self {
        let middle = |cell: usize| (cell as f32 + 0.5) / Self::MOST_SIDE as f32;
        let xs: Vec<f32> = (0..Self::MOST_SIDE).map(middle).collect();
        let rows = (0..Self::MOST_SIDE).flat_map(|row| {
            let mut row_weights = vec![0.0; Self::MOST_SIDE];
            weights(&xs, middle(row), &mut row_weights);
            row_weights.into_iter().map(|weight| (weight * 255.0).round() as u8)
        });
        Self { width: Self::MOST_SIDE, weights: rows.collect() }
    }

    /// Cells to the right and upwards.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.weights.len() / self.width]
    }

    /// All weights as shares of 255; value fastest, the lowest gradient magnitude first.
    #[must_use]
    pub fn weights(&self) -> &[u8] {
        &self.weights
    }

    /// Weights, 0 to 1, at many places on a level, all in shares of the rectangle.
    pub fn weights_at(&self, xs: &[f32], y: f32, weights: &mut [f32]) {
        let [width, height] = self.size();
        let (below, up) = neighbour(y, height);
        let row = |row: u8| &self.weights[usize::from(row).min(height - 1) * width..][..width];
        // The outermost one twice: every cell has a neighbour.
        let mut blended = [0.0; Self::MOST_SIDE + 1];
        for ((blended, &low), &high) in blended.iter_mut().zip(row(below)).zip(row(below.saturating_add(1))) {
            *blended = mix(f32::from(low), f32::from(high), up) / 255.0;
        }
        blended[width] = blended[width - 1];
        // Most of what is painted is empty.
        if blended.iter().all(|&weight| weight == 0.0) {
            return weights.fill(0.0);
        }
        for (&x, weight) in xs.iter().zip(weights) {
            let (left, share) = neighbour(x, width);
            *weight = mix(blended[usize::from(left)], blended[usize::from(left) + 1], share);
        }
    }

    /// Weight, 0 to 1, at a place in shares of the rectangle; 0 outside.
    #[must_use]
    pub fn weight_at(&self, [x, y]: [f32; 2]) -> f32 {
        let mut weight = [0.0];
        if [x, y].iter().all(|place| (0.0..=1.0).contains(place)) {
            self.weights_at(&[x], y, &mut weight);
        }
        weight[0]
    }

    /// Paints, or erases, along a line with an elliptic brush: wholly up to half of its radii, less and less up to
    /// them. Places and radii are shares of the rectangle; a brush is at least a cell large.
    pub fn stroke(&mut self, from: [f32; 2], to: [f32; 2], radii: [f32; 2], erase: bool) {
        let size = self.size();
        let radii = [0, 1].map(|axis| radii[axis].max(1.0 / size[axis] as f32));
        let cells = [0, 1].map(|axis| {
            let cell = |place: f32| (place * size[axis] as f32).clamp(0.0, size[axis] as f32) as usize;
            cell(from[axis].min(to[axis]) - radii[axis])
                ..(cell(from[axis].max(to[axis]) + radii[axis]) + 1).min(size[axis])
        });
        // In radii from the line's beginning.
        let scaled = |place: [f32; 2]| [0, 1].map(|axis| (place[axis] - from[axis]) / radii[axis]);
        let [dx, dy] = scaled(to);
        let squared = dx * dx + dy * dy;
        let per_square = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        let weights = Arc::make_mut(&mut self.weights);
        for row in cells[1].clone() {
            for column in cells[0].clone() {
                let [x, y] = scaled([(column as f32 + 0.5) / size[0] as f32, (row as f32 + 0.5) / size[1] as f32]);
                let along = ((x * dx + y * dy) * per_square).clamp(0.0, 1.0);
                let distance = (x - along * dx).hypot(y - along * dy);
                let brush = ((2.0 - 2.0 * distance).clamp(0.0, 1.0) * 255.0).round() as u8;
                let weight = &mut weights[row * size[0] + column];
                *weight = if erase { (*weight).min(255 - brush) } else { (*weight).max(brush) };
            }
        }
    }

    /// Reads a picture, its highest gradient magnitude first: where anything of it is transparent its opacities are the
    /// weights, or else its grey levels are, white the largest. More than [`Self::MOST_SIDE`] pixels are reduced to as
    /// many cells.
    ///
    /// # Errors
    /// [`ParseError`] for what is no PNG, damaged, or larger than [`Self::MOST_PIXELS`].
    pub fn from_png(png: &[u8]) -> Result<Self, ParseError> {
        let mut reader = ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
        let mut limits = Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(Self::MOST_PIXELS), Some(Self::MOST_PIXELS));
        limits.max_alloc = Some(Self::MOST_MEMORY);
        reader.limits(limits);
        let picture = reader.decode().map_err(|error| {
            let most = Self::MOST_PIXELS;
            ParseError(format!("a map is a PNG of at most {most} × {most} pixels: {error}"))
        })?;
        let opacities = picture.color().has_alpha().then(|| opacities(&picture));
        let weights = opacities.filter(|opacities| opacities.iter().any(|&opacity| opacity < 255));
        let mut weights = weights.unwrap_or_else(|| picture.into_luma8());
        let [width, height] = [weights.width(), weights.height()].map(|side| side.min(Self::MOST_SIDE as u32));
        if [width, height] != [weights.width(), weights.height()] {
            weights = imageops::resize(&weights, width, height, imageops::FilterType::Triangle);
        }
        let rows = weights.as_raw().chunks_exact(width as usize).rev();
        Ok(Self { width: width as usize, weights: rows.flatten().copied().collect() })
    }

    /// The map as a picture in grey levels, which [`Self::from_png`] reads back as it is.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn to_png(&self) -> crate::Result<Vec<u8>> {
        let [width, height] = self.size();
        let rows: Vec<u8> = self.weights.chunks_exact(width).rev().flatten().copied().collect();
        let mut png = Vec::new();
        let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive);
        encoder.write_image(&rows, width as u32, height as u32, ExtendedColorType::L8)?;
        Ok(png)
    }
}

/// The last of so many cells whose middle lies before a place in shares of all, and how far that lies from there to the
/// next one's.
fn neighbour(place: f32, cells: usize) -> (u8, f32) {
    let place = (place * cells as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
    let first = place as u8;
    (first, place - f32::from(first))
}

fn mix(low: f32, high: f32, share: f32) -> f32 {
    low + share * (high - low)
}

fn opacities(picture: &DynamicImage) -> GrayImage {
    let rgba = picture.to_rgba8();
    GrayImage::from_fn(rgba.width(), rgba.height(), |x, y| image::Luma([rgba.get_pixel(x, y).0[3]]))
}

impl fmt::Display for PaintedMap {
    /// The picture's bytes in base64.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let png = self.to_png().map_err(|_| fmt::Error)?;
        formatter.write_str(&STANDARD_NO_PAD.encode(png))
    }
}

impl FromStr for PaintedMap {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, ParseError> {
        if text.len() > Self::MOST_TEXT {
            return Err(ParseError(format!("a map of {} characters is too long: {}", text.len(), Self::MOST_TEXT)));
        }
        let text = text.trim_end_matches('=');
        let png =
            STANDARD_NO_PAD.decode(text).map_err(|error| ParseError(format!("a map is a PNG in base64: {error}")))?;
        Self::from_png(&png)
    }
}

impl fmt::Debug for PaintedMap {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size();
        write!(formatter, "PaintedMap({width} × {height})")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn png(bytes: &[u8], [width, height]: [u32; 2], color: ExtendedColorType) -> Vec<u8> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(bytes, width, height, color).expect("is encoded");
        png
    }

    #[test]
    fn grey_levels_or_opacities_are_weights_and_the_top_row_is_the_last() {
        let grey =
            PaintedMap::from_png(&png(&[0, 50, 100, 150, 200, 255], [3, 2], ExtendedColorType::L8)).expect("a map");
        assert_eq!((grey.size(), grey.weights()), ([3, 2], &[150, 200, 255, 0, 50, 100][..]));
        let rgba = |opacity: u8| png(&[255, 255, 255, 255, 0, 0, 0, opacity], [2, 1], ExtendedColorType::Rgba8);
        assert_eq!(PaintedMap::from_png(&rgba(7)).expect("a map").weights(), [255, 7]);
        assert_eq!(PaintedMap::from_png(&rgba(255)).expect("a map").weights(), [255, 0]);
    }

    #[test]
    fn weights_are_bilinear_between_middles() {
        let map = PaintedMap { width: 2, weights: [0, 255, 255, 255].into() };
        for (place, expected) in [
            ([0.25, 0.25], 0.0),
            ([0.0, 0.0], 0.0),
            ([0.5, 0.25], 0.5),
            ([0.5, 0.5], 0.75),
            ([0.75, 0.1], 1.0),
            ([1.0, 1.0], 1.0),
            ([1.1, 0.5], 0.0),
        ] {
            assert!((map.weight_at(place) - expected).abs() < 1e-6, "{place:?}");
        }
    }

    #[test]
    fn a_brush_paints_softly_and_erases_what_it_painted() {
        let mut map = PaintedMap::blank();
        let (from, to) = ([0.2, 0.5], [0.6, 0.5]);
        map.stroke(from, to, [0.1, 0.1], false);
        assert_eq!((map.weight_at([0.4, 0.52]), map.weight_at([0.4, 0.65])), (1.0, 0.0));
        assert!((map.weight_at([0.4, 0.575]) - 0.5).abs() < 0.02 && map.weight_at([0.65, 0.5]) > 0.8);
        let painted = map.clone();
        map.stroke(from, to, [0.1, 0.1], false);
        assert_eq!(map, painted, "painting twice is painting once");
        map.stroke([0.3, 0.5], [0.3, 0.5], [0.1, 0.1], true);
        assert_eq!((map.weight_at([0.3, 0.5]), map.weight_at([0.5, 0.5])), (0.0, 1.0));
        map.stroke([-5.0, 0.5], [5.0, 0.5], [0.25, 2.0], true);
        assert_eq!(map, PaintedMap::blank());
        // Smaller than a cell, or outside.
        map.stroke([0.5, 0.5], [0.5, 0.5], [1e-6, 1e-6], false);
        assert!(map.weight_at([0.5, 0.5]) > 0.3);
        map.stroke([7.0, 7.0], [9.0, 9.0], [0.1, 0.1], false);
    }

    #[test]
    fn texts_are_read_back_exactly_and_stay_short() {
        let mut map = PaintedMap::blank();
        map.stroke([0.2, 0.3], [0.7, 0.8], [0.2, 0.1], false);
        let text = map.to_string();
        assert_eq!(text.parse(), Ok(map));
        assert!(text.len() < 16_000, "{}", text.len());
        let noise = (0..PaintedMap::MOST_SIDE.pow(2) as u32).map(|cell| (cell.wrapping_mul(2_654_435_761) >> 24) as u8);
        let noise = PaintedMap { width: PaintedMap::MOST_SIDE, weights: noise.collect() };
        let text = noise.to_string();
        assert!(text.len() < PaintedMap::MOST_TEXT / 8, "{}", text.len());
        assert_eq!(text.parse(), Ok(noise));
    }

    #[test]
    fn larger_pictures_are_reduced_and_the_largest_refused() {
        let half: Vec<u8> = (0..1000 * 300).map(|pixel| if pixel % 1000 < 500 { 0 } else { 255 }).collect();
        let map = PaintedMap::from_png(&png(&half, [1000, 300], ExtendedColorType::L8)).expect("a map");
        assert_eq!((map.size(), map.weight_at([0.48, 0.5]), map.weight_at([0.52, 0.5])), ([256, 256], 0.0, 1.0));
        let wide = png(&vec![0; 4097], [4097, 1], ExtendedColorType::L8);
        let message = PaintedMap::from_png(&wide).expect_err("is refused").to_string();
        assert!(message.contains("at most 4096 × 4096 pixels"), "{message}");
        let mut bomb = png(&[0; 16], [4, 4], ExtendedColorType::L8);
        bomb[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        let crc = crc32fast::hash(&bomb[12..29]).to_be_bytes();
        bomb[29..33].copy_from_slice(&crc);
        let message = PaintedMap::from_png(&bomb).expect_err("is refused").to_string();
        assert!(message.contains("4096 × 4096"), "{message}");
        assert!("A".repeat(PaintedMap::MOST_TEXT + 1).parse::<PaintedMap>().is_err());
        assert!("ä".parse::<PaintedMap>().is_err() && "".parse::<PaintedMap>().is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(at in 0_usize..200, byte: u8, cut in 0_usize..200) {
            let mut bytes = png(&[9; 30], [5, 2], ExtendedColorType::Rgb8);
            let (at, cut) = (at % bytes.len(), cut % bytes.len());
            bytes[at] = byte;
            bytes.truncate(bytes.len() - cut);
            if let Ok(map) = PaintedMap::from_png(&bytes) {
                let [width, height] = map.size();
                prop_assert!(width * height == map.weights().len() && width * height > 0);
            }
        }
    }
}
