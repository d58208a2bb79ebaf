//! A slice of a volume as a picture.

use image::{Rgb, RgbImage};
use voxrole_pack::GridGeometry;

use super::colour::{grey, signed, viridis};
use crate::fields::RoleCode;
use crate::{Error, Result};

/// Small slices are enlarged by a whole factor until their longer side has at least this many pixels.
const LEAST_PIXELS: f64 = 384.0;
/// No picture is longer than this: very unequal spacings are thinned out.
const MOST_PIXELS: f64 = 16_384.0;
/// Voxels that hold no number where one is expected; a colour that no shading gives.
pub(super) const MASKED: [u8; 3] = [160, 0, 160];
/// Voxels without a boundary.
pub(super) const NO_BOUNDARY: [u8; 3] = [0; 3];

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
    /// Viridis from 0 to `limit`.
    GradientMagnitude {
        /// The magnitude shown yellow.
        limit: f32,
    },
    /// [`RoleCode`]: on a boundary white, on its low-value side red, on its high-value side blue, without one black.
    Role,
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

    /// Viridis up to the 99.5 percentile of the finite magnitudes, or to the largest where that is 0.
    #[must_use]
    pub fn gradient_magnitude(values: &[f32]) -> Self {
        Self::GradientMagnitude { limit: magnitude_limit(values, 0.995) }
    }

    /// The colour of a number; a scale without length shows everything at its lower end.
    pub(super) fn colour(&self, value: f32) -> [u8; 3] {
        let share = |value: f32, low: f32, high: f32| {
            let [value, low, high] = [value, low, high].map(f64::from);
            if high > low { (value - low) / (high - low) } else { 0.0 }
        };
        match *self {
            Self::Distance { .. } | Self::HitGradient { .. } if value.is_nan() => NO_BOUNDARY,
            _ if value.is_nan() => MASKED,
            Self::Value { window: [low, high] } => grey(share(value, low, high)),
            Self::Distance { d_max } => grey(1.0 - share(value.abs(), 0.0, d_max)),
            Self::SecondDerivative { limit } => signed(share(value, 0.0, limit)),
            Self::HitGradient { limit } | Self::GradientMagnitude { limit } => viridis(share(value, 0.0, limit)),
            Self::Role => role_colour(value),
        }
    }
}

fn role_colour(role: f32) -> [u8; 3] {
    let is = |code: RoleCode| role == f32::from(code as i8);
    match () {
        () if is(RoleCode::Boundary) => grey(1.0),
        () if is(RoleCode::HighSide) => signed(1.0),
        () if is(RoleCode::LowSide) => signed(-1.0),
        () if is(RoleCode::None) => NO_BOUNDARY,
        () => MASKED,
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

/// Slice `index` across `axis` of a volume as a picture; `colour` is that of a voxel by its number, x fastest.
///
/// Pixels are square in the world: unequal spacings are resampled to the smaller one, each pixel showing the nearest
/// voxel. Small slices are enlarged by a whole factor to at least 384 pixels along the longer side. Directions are those
/// of the grid's axes; where they lie in the world plays no part.
///
/// # Errors
/// [`Error::Parameter`] for an index outside the volume; [`Error::Pack`] for an unusable grid.
pub(super) fn slice_image(
    geometry: &GridGeometry,
    axis: SliceAxis,
    index: u32,
    colour: impl Fn(usize) -> [u8; 3],
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
    let dims = geometry.dims_usize();
    let strides = [1, dims[0], dims[0] * dims[1]];
    let [width, height] = picture_size([right, up].map(|axis| (geometry.dims[axis], geometry.spacing[axis])));
    Ok(RgbImage::from_fn(width, height, |x, y| {
        let row = if axis == SliceAxis::Z { y } else { height - 1 - y };
        let voxel = index as usize * strides[across]
            + nearest(x, width, dims[right]) * strides[right]
            + nearest(row, height, dims[up]) * strides[up];
        Rgb(colour(voxel))
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

    /// 2 × 3 × 4 voxels, whose grey is their own index.
    fn numbered(axis: SliceAxis, index: u32) -> Result<RgbImage> {
        slice_image(&geometry(), axis, index, |voxel| [voxel as u8; 3])
    }

    fn geometry() -> GridGeometry {
        GridGeometry::axis_aligned([2, 3, 4], [1.0; 3])
    }

    /// The voxels of a slice as rows of the picture.
    fn rows(axis: SliceAxis, index: u32) -> Vec<Vec<u8>> {
        let image = numbered(axis, index).expect("a slice that exists");
        let [_, right, up] = axis.axes();
        let [across, down] = [right, up].map(|axis| geometry().dims[axis]);
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

        let gradient = SliceShading::GradientMagnitude { limit: 4.0 };
        assert_eq!([4.0, f32::NAN].map(|g| gradient.colour(g)), [viridis(1.0), MASKED]);

        let roles = [-1.0, 0.0, 1.0, 2.0, 3.0].map(|role| SliceShading::Role.colour(role));
        assert_eq!(roles, [MASKED, [0; 3], [255; 3], signed(1.0), signed(-1.0)]);
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
        let image = slice_image(&geometry, SliceAxis::X, 7, |_| [0; 3]).expect("a slice that exists");
        assert_eq!(image.dimensions(), (256, 384));
    }

    #[test]
    fn slices_outside_the_volume_are_refused() {
        let error = numbered(SliceAxis::Y, 3).expect_err("there are three slices");
        assert_eq!(error.to_string(), "slice 3 across y does not exist: this volume has slices 0 to 2");
        assert!(numbered(SliceAxis::Y, 2).is_ok());
    }
}
