//! A slice of a volume as a picture.

use image::{Rgb, RgbImage};
use voxrole_pack::GridGeometry;

use super::colour::{grey, signed, viridis};
use super::png_from_image;
use crate::{Error, Result};

/// Small slices are enlarged by a whole factor until their longer side has at least this many pixels.
const LEAST_PIXELS: f64 = 384.0;
/// No picture is longer than this: very unequal spacings are thinned out.
const MOST_PIXELS: f64 = 16_384.0;
/// Voxels that hold no number where one is expected; a colour that no shading gives.
const MASKED: [u8; 3] = [160, 0, 160];
/// Voxels without a boundary.
const NO_BOUNDARY: [u8; 3] = [0; 3];

/// The axis at right angles to a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SliceAxis {
    /// y to the right, z upwards.
    X,
    /// x to the right, z upwards.
    Y,
    /// x to the right, y downwards, as in pictures.
    Z,
}

impl SliceAxis {
    /// All three.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// `x`, `y` or `z`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// The axis that [`Self::name`] gives `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|axis| axis.name() == name)
    }

    /// The axis itself, the one to the right and the vertical one, as numbers 0, 1, 2.
    const fn axes(self) -> [usize; 3] {
        match self {
            Self::X => [0, 1, 2],
            Self::Y => [1, 0, 2],
            Self::Z => [2, 0, 1],
        }
    }
}

/// How numbers become colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SliceShading {
    /// Grey from black at `window[0]` to white at `window[1]`.
    Value {
        /// What is black and what is white.
        window: [f32; 2],
    },
    /// The flipped image of the paper, `255 · (1 − |d| / d_max)`: boundaries white, voxels without one black.
    Distance {
        /// The distance that is black.
        d_max: f32,
    },
    /// Negative red, 0 black, positive blue, full colour at ±`limit`.
    SecondDerivative {
        /// The magnitude of full colour.
        limit: f32,
    },
    /// Viridis from 0 to `limit`, voxels without a hit black.
    HitGradient {
        /// The magnitude shown yellow.
        limit: f32,
    },
}

impl SliceShading {
    /// Grey between the 0.5 and the 99.5 percentile of the finite numbers, or between the smallest and the largest
    /// where those are equal.
    #[must_use]
    pub fn value(values: &[f32]) -> Self {
        let mut finite = finite(values.iter().copied());
        let [low, high] = [0.005, 0.995].map(|share| percentile(&mut finite, share));
        let window = if low < high { [low, high] } else { [0.0, 1.0].map(|share| percentile(&mut finite, share)) };
        Self::Value { window }
    }

    /// Red and blue, full at the 99th percentile of the finite magnitudes, or at the largest where that is 0.
    #[must_use]
    pub fn second_derivative(values: &[f32]) -> Self {
        Self::SecondDerivative { limit: magnitude_limit(values, 0.99) }
    }

    /// Viridis up to the 99.5 percentile of the finite magnitudes, or to the largest where that is 0.
    #[must_use]
    pub fn hit_gradient(values: &[f32]) -> Self {
        Self::HitGradient { limit: magnitude_limit(values, 0.995) }
    }

    /// The colour of a number; a scale without length shows everything at its lower end.
    fn colour(&self, value: f32) -> [u8; 3] {
        let share = |value: f32, low: f32, high: f32| {
            let [value, low, high] = [value, low, high].map(f64::from);
            if high > low { (value - low) / (high - low) } else { 0.0 }
        };
        match *self {
            Self::Value { .. } | Self::SecondDerivative { .. } if value.is_nan() => MASKED,
            Self::Distance { .. } | Self::HitGradient { .. } if value.is_nan() => NO_BOUNDARY,
            Self::Value { window: [low, high] } => grey(share(value, low, high)),
            Self::Distance { d_max } => grey(1.0 - share(value.abs(), 0.0, d_max)),
            Self::SecondDerivative { limit } => signed(share(value, 0.0, limit)),
            Self::HitGradient { limit } => viridis(share(value, 0.0, limit)),
        }
    }
}

fn finite(values: impl Iterator<Item = f32>) -> Vec<f32> {
    values.filter(|value| value.is_finite()).collect()
}

/// The number below which `share` of `values` lie, 0 where there are none; reorders them.
fn percentile(values: &mut [f32], share: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let place = (share * (values.len() - 1) as f64).round() as usize;
    *values.select_nth_unstable_by(place, f32::total_cmp).1
}

fn magnitude_limit(values: &[f32], share: f64) -> f32 {
    let mut magnitudes = finite(values.iter().map(|value| value.abs()));
    let limit = percentile(&mut magnitudes, share);
    if limit > 0.0 { limit } else { percentile(&mut magnitudes, 1.0) }
}

/// Slice `index` across `axis` as the bytes of a PNG file; see [`slice_image`].
///
/// # Errors
/// As [`slice_image`].
pub fn slice_png(
    volume: &[f32],
    geometry: &GridGeometry,
    axis: SliceAxis,
    index: u32,
    shading: &SliceShading,
) -> Result<Vec<u8>> {
    png_from_image(&slice_image(volume, geometry, axis, index, shading)?)
}

/// Slice `index` across `axis` of a dense volume (x fastest, NaN for none) as a picture.
///
/// Pixels are square in the world: unequal spacings are resampled to the smaller one, each pixel showing the nearest
/// voxel. Small slices are enlarged by a whole factor to at least 384 pixels along the longer side. Directions are those
/// of the grid's axes; where they lie in the world plays no part.
///
/// # Errors
/// [`Error::Parameter`] for an index outside the volume or a count of numbers that is not the grid's;
/// [`Error::Pack`] for an unusable grid.
pub fn slice_image(
    volume: &[f32],
    geometry: &GridGeometry,
    axis: SliceAxis,
    index: u32,
    shading: &SliceShading,
) -> Result<RgbImage> {
    geometry.validate()?;
    let [across, right, up] = axis.axes();
    if index >= geometry.dims[across] {
        return Err(Error::Parameter(format!(
            "slice {index} across {} does not exist: this volume has slices 0 to {}",
            axis.name(),
            geometry.dims[across] - 1
        )));
    }
    if volume.len() != geometry.voxel_count() {
        return Err(Error::Parameter(format!(
            "{} numbers do not fill a grid of {:?} voxels",
            volume.len(),
            geometry.dims
        )));
    }

    let dims = geometry.dims_usize();
    let strides = [1, dims[0], dims[0] * dims[1]];
    let [width, height] = picture_size([right, up].map(|axis| (geometry.dims[axis], geometry.spacing[axis])));
    Ok(RgbImage::from_fn(width, height, |x, y| {
        let row = if axis == SliceAxis::Z { y } else { height - 1 - y };
        let voxel = index as usize * strides[across]
            + nearest(x, width, dims[right]) * strides[right]
            + nearest(row, height, dims[up]) * strides[up];
        Rgb(shading.colour(volume[voxel]))
    }))
}

/// Width and height in pixels of a slice, from each side's count of voxels and spacing.
fn picture_size(sides: [(u32, f64); 2]) -> [u32; 2] {
    let pixel = sides[0].1.min(sides[1].1);
    let lengths = sides.map(|(voxels, spacing)| f64::from(voxels) * (spacing / pixel));
    let longer = lengths[0].max(lengths[1]);
    let factor = (LEAST_PIXELS / longer).ceil().max(1.0).min(MOST_PIXELS / longer);
    lengths.map(|length| (length * factor).round().max(1.0) as u32)
}

/// The voxel that pixel `pixel` of `pixels` lies in.
fn nearest(pixel: u32, pixels: u32, voxels: usize) -> usize {
    ((2 * u64::from(pixel) + 1) * voxels as u64 / (2 * u64::from(pixels))) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2 × 3 × 4 voxels that hold their own index.
    fn numbered() -> (Vec<f32>, GridGeometry) {
        ((0..24_u8).map(f32::from).collect(), GridGeometry::axis_aligned([2, 3, 4], [1.0; 3]))
    }

    const PLAIN: SliceShading = SliceShading::Value { window: [0.0, 255.0] };

    /// The voxels of a slice as rows of the picture, from pictures that show a voxel's index as its grey.
    fn rows(axis: SliceAxis, index: u32) -> Vec<Vec<u8>> {
        let (volume, geometry) = numbered();
        let image = slice_image(&volume, &geometry, axis, index, &PLAIN).expect("a slice that exists");
        let [_, right, up] = axis.axes();
        let [across, down] = [geometry.dims[right], geometry.dims[up]];
        let [pixel, other] = [image.width() / across, image.height() / down];
        assert!(pixel == other && image.width().is_multiple_of(across) && image.width().max(image.height()) >= 384);
        (0..down).map(|y| (0..across).map(|x| image.get_pixel(x * pixel, (y + 1) * pixel - 1).0[0]).collect()).collect()
    }

    #[test]
    fn slices_stand_the_right_way_up() {
        assert_eq!(rows(SliceAxis::Z, 1), [[6, 7], [8, 9], [10, 11]]);
        assert_eq!(rows(SliceAxis::Y, 2), [[22, 23], [16, 17], [10, 11], [4, 5]]);
        assert_eq!(rows(SliceAxis::X, 1), [[19, 21, 23], [13, 15, 17], [7, 9, 11], [1, 3, 5]]);
    }

    #[test]
    fn shadings_give_exact_colours() {
        let distance = SliceShading::Distance { d_max: 15.0 };
        let greys = [0.0, 3.0, -3.0, 15.0, -20.0, f32::NAN].map(|d| distance.colour(d)[0]);
        assert_eq!(greys, [255, 204, 204, 0, 0, 0]);

        let value = SliceShading::Value { window: [10.0, 20.0] };
        assert_eq!([9.0, 10.0, 16.0, 25.0].map(|v| value.colour(v)), [[0; 3], [0; 3], [153; 3], [255; 3]]);
        assert_eq!(value.colour(f32::NAN), MASKED);
        assert_eq!(value.colour(f32::INFINITY), [255; 3]);

        let second = SliceShading::SecondDerivative { limit: 2.0 };
        assert_eq!(second.colour(0.0), [0; 3]);
        let [negative, positive] = [second.colour(-1.0), second.colour(5.0)];
        assert!(negative[0] == 128 && negative[0] > 4 * negative[2], "{negative:?}");
        assert!(positive[2] == 255 && positive[2] > 3 * positive[0], "{positive:?}");

        let hit = SliceShading::HitGradient { limit: 4.0 };
        assert_eq!([4.0, 0.0].map(|g| hit.colour(g)), [viridis(1.0), viridis(0.0)]);
        assert_eq!(hit.colour(f32::NAN), [0; 3]);
    }

    #[test]
    fn scales_come_from_the_numbers() {
        let mut values: Vec<f32> = (0..=1000_u16).map(f32::from).collect();
        values.extend([f32::NAN, f32::INFINITY]);
        assert_eq!(SliceShading::value(&values), SliceShading::Value { window: [5.0, 995.0] });
        assert_eq!(SliceShading::hit_gradient(&values), SliceShading::HitGradient { limit: 995.0 });
        let negative: Vec<f32> = values.iter().map(|value| -value).collect();
        assert_eq!(SliceShading::second_derivative(&negative), SliceShading::SecondDerivative { limit: 990.0 });
        // One number among many equal ones is still seen; none at all is no reason to fail.
        let mut sparse = vec![0.0; 1000];
        sparse[3] = 7.0;
        assert_eq!(SliceShading::second_derivative(&sparse), SliceShading::SecondDerivative { limit: 7.0 });
        assert_eq!(SliceShading::value(&sparse), SliceShading::Value { window: [0.0, 7.0] });
        let SliceShading::Value { window } = SliceShading::value(&[f32::NAN]) else { unreachable!() };
        assert_eq!(window, [0.0; 2]);
        assert_eq!(SliceShading::Value { window }.colour(3.0), [0; 3]);
    }

    #[test]
    fn proportions_are_those_of_the_world() {
        let sizes = [
            ([(512, 1.0), (400, 1.0)], [512, 400]),
            ([(64, 1.0), (64, 1.0)], [384, 384]),
            ([(100, 0.5), (50, 1.5)], [300, 450]),
            ([(256, 1.0), (3, 2.5)], [512, 15]),
            ([(1, 1.0), (1, 1e-6)], [16_384, 1]),
            ([(100_000, 1.0), (100_000, 1.0)], [16_384, 16_384]),
        ];
        for (sides, size) in sizes {
            assert_eq!(picture_size(sides), size, "{sides:?}");
        }
        let geometry = GridGeometry::axis_aligned([8, 8, 4], [1.0, 1.0, 3.0]);
        let image = slice_image(&[0.0; 256], &geometry, SliceAxis::X, 7, &PLAIN).expect("a slice that exists");
        assert_eq!(image.dimensions(), (256, 384));
    }

    #[test]
    fn slices_outside_the_volume_are_refused() {
        let (volume, geometry) = numbered();
        let error = slice_png(&volume, &geometry, SliceAxis::Y, 3, &PLAIN).expect_err("there are three slices");
        assert_eq!(error.to_string(), "slice 3 across y does not exist: this volume has slices 0 to 2");
        assert!(slice_png(&volume[1..], &geometry, SliceAxis::Y, 2, &PLAIN).is_err());
        assert!(
            slice_png(&volume, &geometry, SliceAxis::Y, 2, &PLAIN).is_ok_and(|bytes| bytes.starts_with(b"\x89PNG"))
        );
    }
}
