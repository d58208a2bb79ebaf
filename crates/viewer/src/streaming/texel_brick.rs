//! One brick of a packed file as texels: its four rendering layers, unpacked together.

use std::ops::Range;

use voxrole_pack::layer::Quantization;
use voxrole_pack::quantization::{NO_NORMAL, widened_distance};
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{
    DistanceQuantization, Error as PackError, HitGradientQuantization, LayerKind, Reader, with_scalar_type,
};

use crate::Result;
use crate::volume::VolumeDescription;

/// The texels of a brick, each channel by itself: most bricks of most volumes have no boundary, and three of four channels are
/// one number there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TexelBrick {
    dims: [usize; 3],
    channels: [Channel; 4],
}

/// One number of every texel, x fastest.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Channel {
    /// The same everywhere.
    One(u16),
    All(Box<[u16]>),
}

impl Channel {
    fn new<T: Copy>(stored: &[T], bits: impl Fn(T) -> u16) -> Self {
        match *stored {
            [one] => Self::One(bits(one)),
            _ => Self::All(stored.iter().map(|&stored| bits(stored)).collect()),
        }
    }

    fn at(&self, voxel: usize) -> u16 {
        match self {
            Self::One(number) => *number,
            Self::All(numbers) => numbers[voxel],
        }
    }
}

impl TexelBrick {
    /// Reads a brick of the level of detail that a description is of; [`Reader::grid`] says where it lies.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when there is no such brick, a layer is missing, or the brick is damaged.
    pub fn read(reader: &Reader, description: &VolumeDescription, brick: usize) -> Result<Self> {
        let mut read = Self::read_without_normals(reader, description, brick)?;
        let normals = reader.read_brick_or_constant(LayerKind::Normal, description.level, brick)?;
        read.channels[3] = Channel::new(&normals, |stored| stored);
        Ok(read)
    }

    /// As [`Self::read`], but for normals, in the place of which none is said: they have no say in where something is drawn.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_without_normals(reader: &Reader, description: &VolumeDescription, brick: usize) -> Result<Self> {
        let level = description.level;
        let grid = reader.grid(level)?;
        // Counted before it is asked where such a brick would lie.
        if brick >= grid.len() {
            let message = format!("brick {brick} is asked for where level {level} has {}", grid.len());
            return Err(PackError::Parameter(message).into());
        }
        let channels = [
            read_values(reader, description, brick)?,
            read_distances(reader, level, brick)?,
            read_magnitudes(reader, level, brick)?,
            Channel::One(NO_NORMAL),
        ];
        Ok(Self { dims: grid.dims_of(brick), channels })
    }

    /// A brick of one texel.
    #[cfg(test)]
    pub fn uniform(texel: [u16; 4]) -> Self {
        Self { dims: [1; 3], channels: texel.map(Channel::One) }
    }

    /// Texels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The texel at a place within the brick.
    ///
    /// # Panics
    /// When the place is not within [`Self::dims`].
    #[must_use]
    pub fn texel(&self, [x, y, z]: [usize; 3]) -> [u16; 4] {
        let voxel = (z * self.dims[1] + y) * self.dims[0] + x;
        [0, 1, 2, 3].map(|channel: usize| self.channels[channel].at(voxel))
    }

    /// The texel that all are, if they are known to be the same.
    #[must_use]
    pub fn constant(&self) -> Option<[u16; 4]> {
        let is_one = |channel: &Channel| matches!(channel, Channel::One(_));
        self.channels.iter().all(is_one).then(|| [0, 1, 2, 3].map(|channel: usize| self.channels[channel].at(0)))
    }

    /// Bytes of memory that it takes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let of_channel = |channel: &Channel| match channel {
            Channel::One(_) => 0,
            Channel::All(numbers) => size_of_val::<[u16]>(numbers),
        };
        (size_of::<Self>() + self.channels.iter().map(of_channel).sum::<usize>()) as u64
    }

    /// Copies a range of texels along each axis to a place in a box of `width` times `height` texels a slice, x fastest.
    ///
    /// # Panics
    /// When the range is not within the brick, or has no room in the box.
    pub fn copy_to(
        &self,
        [x, y, z]: [Range<usize>; 3],
        texels: &mut [[u16; 4]],
        [width, height]: [usize; 2],
        at: [usize; 3],
    ) {
        for (slice, k) in z.enumerate() {
            for (row, j) in y.clone().enumerate() {
                let to = ((at[2] + slice) * height + at[1] + row) * width + at[0];
                let from = (k * self.dims[1] + j) * self.dims[0];
                let texels = &mut texels[to..to + x.len()];
                for (index, channel) in self.channels.iter().enumerate() {
                    match channel {
                        Channel::One(number) => texels.iter_mut().for_each(|texel| texel[index] = *number),
                        Channel::All(numbers) => {
                            let numbers = &numbers[from + x.start..from + x.end];
                            texels.iter_mut().zip(numbers).for_each(|(texel, &number)| texel[index] = number);
                        }
                    }
                }
            }
        }
    }
}

fn read_values(reader: &Reader, description: &VolumeDescription, brick: usize) -> Result<Channel> {
    let (_, layer) = reader.header().layer(LayerKind::Value)?;
    let shares = ValueShares::new(&layer.quantization, description.value_range)?;
    Ok(with_scalar_type!(layer.scalar_type, T => {
        let stored: Vec<T> = reader.read_brick_or_constant(LayerKind::Value, description.level, brick)?;
        Channel::new(&stored, |stored| shares.of(stored))
    }))
}

fn read_distances(reader: &Reader, level: usize, brick: usize) -> Result<Channel> {
    let quantization = reader.distance_quantization()?;
    let steps = quantization.steps;
    if quantization.is_one_byte() {
        let stored = reader.read_brick_or_constant(LayerKind::Distance, level, brick)?;
        return Ok(Channel::new(&stored, |stored| distance_bits(widened_distance(stored), steps)));
    }
    let stored = reader.read_brick_or_constant(LayerKind::Distance, level, brick)?;
    Ok(Channel::new(&stored, |stored| distance_bits(stored, steps)))
}

fn read_magnitudes(reader: &Reader, level: usize, brick: usize) -> Result<Channel> {
    let quantization = reader.hit_gradient_quantization()?;
    let steps = quantization.steps;
    if quantization.is_one_byte() {
        let stored = reader.read_brick_or_constant::<u8>(LayerKind::HitGradient, level, brick)?;
        return Ok(Channel::new(&stored, |stored| hit_gradient_bits(stored.into(), steps)));
    }
    let stored = reader.read_brick_or_constant(LayerKind::HitGradient, level, brick)?;
    Ok(Channel::new(&stored, |stored| hit_gradient_bits(stored, steps)))
}

/// Stored values as shares of a range: 0 and 65535 stand for its ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ValueShares {
    slope: f64,
    intercept: f64,
    low: f64,
    scale: f64,
}

impl ValueShares {
    /// Of a layer that is stored so.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when values are not stored linearly.
    pub fn new(quantization: &Quantization, [low, high]: [f64; 2]) -> Result<Self> {
        let Quantization::Linear { slope, intercept } = *quantization else {
            return Err(PackError::Format(format!("values are described nonsensically: {quantization:?}")).into());
        };
        Ok(Self { slope, intercept, low, scale: if high > low { 65535.0 / (high - low) } else { 0.0 } })
    }

    /// That of a stored value; 0 for NaN, which becomes that in the conversion.
    pub fn of<T: Scalar>(&self, stored: T) -> u16 {
        ((self.slope.mul_add(stored.to_f64(), self.intercept) - self.low) * self.scale).round() as u16
    }
}

/// A stored distance in 16 bits, whatever precision the file has.
fn distance_bits(stored: i16, steps: u16) -> u16 {
    if stored <= DistanceQuantization::MASKED || steps == DistanceQuantization::MOST_STEPS {
        return stored as u16;
    }
    let scale = f32::from(DistanceQuantization::MOST_STEPS) / f32::from(steps);
    (f32::from(stored) * scale).round() as i16 as u16
}

/// A stored gradient magnitude at the hit in 16 bits, whatever precision the file has.
fn hit_gradient_bits(stored: u16, steps: u16) -> u16 {
    if stored == 0 || steps == HitGradientQuantization::MOST_STEPS {
        return stored;
    }
    let scale = f32::from(HitGradientQuantization::MOST_STEPS) / f32::from(steps);
    1 + (f32::from(stored - 1) * scale).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values<T: Scalar>(stored: &[T], slope: f64, intercept: f64, range: [f64; 2]) -> Vec<u16> {
        let shares = ValueShares::new(&Quantization::Linear { slope, intercept }, range).expect("is linear");
        stored.iter().map(|&stored| shares.of(stored)).collect()
    }

    #[test]
    fn eight_bits_are_kept_exactly() {
        let all: Vec<u8> = (0..=255).collect();
        let stored = values(&all, 1.0, 0.0, [0.0, 255.0]);
        assert!(stored.iter().enumerate().all(|(value, &stored)| usize::from(stored) == value * 257));
    }

    #[test]
    fn a_negative_slope_turns_the_range_round() {
        assert_eq!(values(&[-100_i16, 0, 100], -2.0, 10.0, [-190.0, 210.0]), [65535, 32768, 0]);
    }

    #[test]
    fn nan_infinity_and_flat_volumes_are_drawn_as_nothing_special() {
        let stored = values(&[f32::NAN, 1.0, f32::INFINITY, 3.0], 1.0, 0.0, [1.0, 3.0]);
        assert_eq!(stored, [0, 0, 65535, 65535]);
        assert_eq!(values(&[5.0_f64; 2], 1.0, 0.0, [5.0, 5.0]), [0, 0]);
        assert_eq!(values(&[f32::NAN], 1.0, 0.0, [0.0, 0.0]), [0]);
        assert!(ValueShares::new(&Quantization::Octahedral, [0.0, 1.0]).is_err());
    }

    #[test]
    fn every_precision_is_widened_to_the_ends() {
        for steps in [126, 2046, DistanceQuantization::MOST_STEPS] {
            assert_eq!(
                [steps as i16, 0, -(steps as i16)].map(|stored| distance_bits(stored, steps) as i16),
                [32766, 0, -32766]
            );
        }
        assert_eq!(distance_bits(DistanceQuantization::MASKED, 126) as i16, DistanceQuantization::MASKED);
        for steps in [254, 4094, HitGradientQuantization::MOST_STEPS] {
            assert_eq!([0, 1, steps + 1].map(|stored| hit_gradient_bits(stored, steps)), [0, 1, 65535]);
        }
    }

    #[test]
    fn ranges_are_copied_to_their_place() {
        let channels = [Channel::All((0..24).collect()), Channel::One(7), Channel::One(8), Channel::One(9)];
        let brick = TexelBrick { dims: [4, 3, 2], channels };
        assert_eq!((brick.texel([1, 2, 1]), brick.constant()), ([21, 7, 8, 9], None));
        let mut texels = vec![[0; 4]; 3 * 3 * 2];
        brick.copy_to([2..4, 1..3, 1..2], &mut texels, [3, 3], [1, 0, 1]);
        let written: Vec<_> = texels.iter().enumerate().filter(|(_, texel)| texel[3] > 0).collect();
        let expected = [(10, 18), (11, 19), (13, 22), (14, 23)].map(|(place, value)| (place, [value, 7, 8, 9]));
        assert_eq!(written, expected.each_ref().map(|(place, texel)| (*place, texel)));
    }
}
