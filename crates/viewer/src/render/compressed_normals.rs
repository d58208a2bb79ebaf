//! Voxels whose normals are compressed to half of their size, in blocks of 4×4 that GPUs read as they are (BC5: two channels of
//! BC4, also called RGTC).
//!
//! A block keeps the ends of a range of each channel and 16 places of eight within. Coordinates that jump would spread it: those
//! of the whole octahedron do where it is folded. So what is kept is a place on its upper half, turned by 45° to fill the square
//! (Cigolle et al., A survey of efficient representations for independent unit vectors, JCGT 3(2), 2014, hemi-oct), with lower
//! normals mirrored into it, and which half it is stands in the lowest bit of the gradient magnitude. In engine's middle that is off by 3.3
//! degrees on average, the whole octahedron by 4.6, x and y of the normal by 4.8.

use rayon::prelude::*;
use voxrole_pack::quantization::decode_normal;

use crate::classify::opacity::gradient_bin;
use crate::volume::VolumeTexels;

/// Voxels along a side of a block.
pub const BLOCK: usize = 4;
/// Bytes of a block.
pub const BLOCK_BYTES: usize = 16;
/// Numbers of a channel of a block.
const TEXELS: usize = BLOCK * BLOCK;
/// Steps from one end of a block's range to the other.
const PARTS: f32 = 7.0;
/// The number that is stored for 1.
const ONE: f32 = 127.0;

/// The normals of some slices, x fastest, block by block; blocks at the ends of rows and slices reach beyond them.
pub fn blocks(texels: &[[u16; 4]], [width, height]: [usize; 2]) -> Vec<u8> {
    let [across, down] = [width, height].map(|side| side.div_ceil(BLOCK));
    let slices = texels.len() / (width * height);
    let mut blocks = vec![0; slices * down * across * BLOCK_BYTES];
    blocks.par_chunks_exact_mut(across * BLOCK_BYTES).enumerate().for_each(|(row, blocks)| {
        let slice = &texels[row / down * width * height..][..width * height];
        let (blocks, _) = blocks.as_chunks_mut::<BLOCK_BYTES>();
        for (column, block) in blocks.iter_mut().enumerate() {
            let places: [Option<[f32; 2]>; TEXELS] = std::array::from_fn(|texel| {
                let [x, y] = [column * BLOCK + texel % BLOCK, row % down * BLOCK + texel / BLOCK];
                if x < width && y < height { place_of(slice[y * width + x]) } else { None }
            });
            for (channel, bytes) in block.as_chunks_mut::<8>().0.iter_mut().enumerate() {
                *bytes = encode(&places.map(|place| place.map(|place| place[channel])));
            }
        }
    });
    blocks
}

/// The gradient magnitude at the hit that goes with [`blocks`]: its lowest bit says that the normal's z is negative. Off by
/// two steps at most, and always in the same bin of the opacity table.
pub fn gradient_with_side(texel @ [_, _, gradient, normal]: [u16; 4]) -> u16 {
    if !VolumeTexels::has_hit(texel) {
        return gradient;
    }
    let side = u16::from(decode_normal(normal).is_some_and(|normal| normal.z < 0.0));
    let nearest = gradient & !1 | side;
    [nearest, nearest.wrapping_add(2), nearest.wrapping_sub(2)]
        .into_iter()
        .find(|&near| near > 0 && gradient_bin(near) == gradient_bin(gradient))
        .unwrap_or(nearest)
}

/// Where a voxel's normal lies on the half octahedron, each coordinate within ±1; `None` where none is drawn.
fn place_of(texel: [u16; 4]) -> Option<[f32; 2]> {
    let normal = decode_normal(texel[3]).filter(|_| VolumeTexels::has_hit(texel))?;
    let [x, y, _] = (normal / normal.abs().element_sum()).to_array();
    Some([x + y, x - y])
}

/// Sixteen numbers within ±1 as a block of signed BC4; what is `None` may become anything.
fn encode(numbers: &[Option<f32>; TEXELS]) -> [u8; 8] {
    let wanted = || numbers.iter().flatten().copied();
    let range = wanted().fold([f32::MAX, f32::MIN], |[low, high], number| [low.min(number), high.max(number)]);
    if range[0] > range[1] {
        return [0; 8];
    }
    let first = Fit::new(numbers, range);
    // Ends that suit all numbers the best, instead of the outermost ones.
    let better = first.refit(numbers).map(|range| Fit::new(numbers, range)).filter(|fit| fit.error < first.error);
    better.unwrap_or(first).bytes()
}

/// The ends of a range, and the nearest of its steps for every number.
struct Fit {
    /// As stored; low and high.
    ends: [i8; 2],
    /// Steps from the high end.
    steps: [u8; TEXELS],
    /// Sum of squares.
    error: f32,
}

impl Fit {
    fn new(numbers: &[Option<f32>; TEXELS], range: [f32; 2]) -> Self {
        let ends = range.map(|end| (end.clamp(-1.0, 1.0) * ONE).round() as i8);
        let [low, high] = ends.map(|end| f32::from(end) / ONE);
        let per_number = if high > low { PARTS / (high - low) } else { 0.0 };
        let (mut steps, mut error) = ([0; TEXELS], 0.0);
        for (step, number) in steps.iter_mut().zip(numbers) {
            let Some(number) = number else { continue };
            let place = ((high - number) * per_number).round().clamp(0.0, PARTS);
            error += (high + (low - high) * (place / PARTS) - number).powi(2);
            *step = place as u8;
        }
        Self { ends, steps, error }
    }

    /// The range with the least sum of squares for these steps; `None` where all are one.
    fn refit(&self, numbers: &[Option<f32>; TEXELS]) -> Option<[f32; 2]> {
        let [mut high_high, mut high_low, mut low_low, mut high, mut low] = [0.0; 5];
        for (step, number) in self.steps.iter().zip(numbers) {
            let Some(number) = number else { continue };
            let place = f32::from(*step) / PARTS;
            high_high += (1.0 - place) * (1.0 - place);
            high_low += (1.0 - place) * place;
            low_low += place * place;
            high += (1.0 - place) * number;
            low += place * number;
        }
        let determinant = high_high * low_low - high_low * high_low;
        (determinant > 1e-6).then(|| {
            let ends =
                [high_high * low - high_low * high, low_low * high - high_low * low].map(|end| end / determinant);
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        })
    }

    /// The high end first, by which decoders know that there are six steps between; then three bits a number.
    fn bytes(&self) -> [u8; 8] {
        let codes = self.steps.iter().rev().fold(0_u64, |codes, &step| {
            // The ends are 0 and 1.
            let code = match step {
                0 => 0,
                7 if self.ends[0] < self.ends[1] => 1,
                between => u64::from(between) + 1,
            };
            codes << 3 | code
        });
        let [low, high] = self.ends;
        let mut bytes = (codes << 16).to_le_bytes();
        (bytes[0], bytes[1]) = (high as u8, low as u8);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use voxrole_pack::quantization::encode_normal;

    use super::*;

    /// A block of signed BC4, by the words of the Khronos Data Format Specification, 14.1 and 14.2.
    fn decode(block: [u8; 8]) -> [f32; TEXELS] {
        let [red_0, red_1] = [block[0], block[1]].map(|byte| (f32::from(byte as i8) / 127.0).max(-1.0));
        let bits = u64::from_le_bytes(block) >> 16;
        std::array::from_fn(|texel| match (bits >> (3 * texel)) & 7 {
            0 => red_0,
            1 => red_1,
            code if red_0 > red_1 => ((8 - code) as f32 * red_0 + (code - 1) as f32 * red_1) / 7.0,
            6 => -1.0,
            7 => 1.0,
            code => ((6 - code) as f32 * red_0 + (code - 1) as f32 * red_1) / 5.0,
        })
    }

    /// What shaders make of a place and a side.
    fn normal_at([u, v]: [f32; 2], gradient: u16) -> Vec3 {
        let [x, y] = [0.5 * (u + v), 0.5 * (u - v)];
        let z = 1.0 - x.abs() - y.abs();
        Vec3::new(x, y, if gradient & 1 == 1 { -z } else { z }).normalize()
    }

    proptest! {
        #[test]
        fn a_block_is_as_good_as_its_range(
            numbers in prop::array::uniform16(prop::option::weighted(0.8, -1_f32..=1.0)),
            squeeze in 0_f32..=1.0,
        ) {
            let numbers = numbers.map(|number| number.map(|number| 0.3 + squeeze * (number - 0.3)));
            let found = decode(encode(&numbers));
            let wanted: Vec<f32> = numbers.iter().flatten().copied().collect();
            let squares = numbers.iter().zip(found).filter_map(|(number, found)| number.map(|it| (it - found).powi(2)));
            let rms = (squares.sum::<f32>() / wanted.len().max(1) as f32).sqrt();
            let range = wanted.iter().copied().fold(f32::MIN, f32::max) - wanted.iter().copied().fold(f32::MAX, f32::min);
            // Half of a step, and half of what ends are rounded to.
            prop_assert!(wanted.is_empty() || rms <= (range + 1.0 / 127.0) / 14.0 + 0.5 / 127.0, "{rms} of {range}");
        }

        #[test]
        fn one_normal_keeps_its_direction(
            (x, y, z) in (-1_f32..=1.0, -1_f32..=1.0, -1_f32..=1.0),
            gradient in 1_u16..,
        ) {
            prop_assume!(Vec3::new(x, y, z).length() > 0.1);
            let stored = encode_normal(Vec3::new(x, y, z).normalize());
            let exact = decode_normal(stored).expect("a normal");
            let texel = [7, 5, gradient, stored];
            let block = blocks(&[texel; 25], [5, 5]);
            prop_assert_eq!(block.len(), 4 * BLOCK_BYTES);
            let (channels, _) = block.as_chunks::<8>();
            for pair in channels.chunks_exact(2) {
                let place = [decode(pair[0])[0], decode(pair[1])[0]];
                let angle = normal_at(place, gradient_with_side(texel)).angle_between(exact).to_degrees();
                prop_assert!(angle < 0.6, "{exact}: {angle} degrees");
            }
        }
    }

    #[test]
    fn a_side_changes_no_bin() {
        for gradient in 1..=u16::MAX {
            for (side, z) in [(0, 0.5), (1, -0.5)] {
                let found = gradient_with_side([0, 0, gradient, encode_normal(Vec3::new(0.1, 0.2, z))]);
                assert!(found > 0 && found & 1 == side && found.abs_diff(gradient) <= 2, "{gradient}: {found}");
                assert_eq!(gradient_bin(found), gradient_bin(gradient));
            }
        }
        assert_eq!(gradient_with_side([0, 0, 0, encode_normal(Vec3::NEG_Z)]), 0);
    }

    /// By how many degrees normals are off: on average, and at the 99th percentile.
    fn errors(texels: &[[u16; 4]], [width, height]: [usize; 2]) -> [f32; 2] {
        let blocks = blocks(texels, [width, height]);
        let (blocks, _) = blocks.as_chunks::<BLOCK_BYTES>();
        let [across, down] = [width, height].map(|side| side.div_ceil(BLOCK));
        let angle = |(index, &texel): (usize, &[u16; 4])| {
            let exact = decode_normal(texel[3]).filter(|_| VolumeTexels::has_hit(texel))?;
            let [x, y, z] = [index % width, index / width % height, index / (width * height)];
            let block = &blocks[(z * down + y / BLOCK) * across + x / BLOCK];
            let within = y % BLOCK * BLOCK + x % BLOCK;
            let channel = |first: usize| decode(block[first..first + 8].try_into().expect("eight bytes"))[within];
            Some(normal_at([channel(0), channel(8)], gradient_with_side(texel)).angle_between(exact).to_degrees())
        };
        let mut angles: Vec<_> = texels.iter().enumerate().filter_map(angle).collect();
        angles.sort_by(f32::total_cmp);
        let sum: f64 = angles.iter().map(|&angle| f64::from(angle)).sum();
        [(sum / angles.len() as f64) as f32, angles[angles.len() * 99 / 100]]
    }

    #[test]
    fn the_normals_of_a_ball_stay_within_a_few_degrees() {
        let side = 24;
        let texel = |index: usize| {
            let place = [index % side, index / side % side, index / (side * side)].map(|place| place as f32 - 11.3);
            [0, 0, 1000, encode_normal(Vec3::from_array(place))]
        };
        let texels: Vec<_> = (0..side.pow(3)).map(texel).collect();
        let [mean, percentile] = errors(&texels, [side; 2]);
        assert!(mean < 1.5 && percentile < 8.0, "{mean} on average, {percentile}");
    }

    #[test]
    fn errors_of_a_packed_file() {
        let Some(path) = std::env::var_os("VOXROLE_PACKED") else {
            eprintln!("skipped: VOXROLE_PACKED names no packed file");
            return;
        };
        let reader = voxrole_pack::Reader::open(std::path::Path::new(&path)).expect("opens");
        let volume = VolumeTexels::read(&reader).expect("is read");
        let [width, height, _] = volume.description.texel_dims().map(|dim| dim as usize);
        let [mean, percentile] = errors(&volume.texels, [width, height]);
        println!("{}: {mean:.2} degrees on average, {percentile:.1} at the 99th percentile", path.display());
    }
}
