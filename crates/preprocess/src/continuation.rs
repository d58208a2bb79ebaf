//! How lines of samples go on beyond their ends.

/// A sample of a continued line as a sum of samples inside: `sign · f(index) + first · f(0) + last · f(len − 1)`.
///
/// The line goes on mirrored in its end points, `f(−i) = 2f(0) − f(i)`: a ramp stays a ramp, so that gradients of it are
/// exact to the last voxel. (Mirrored in the ends alone, `f(−i) = f(i)`, they would be 0 there.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Continued {
    /// A sample inside.
    pub index: usize,
    /// Its weight, 1 or −1.
    pub sign: f32,
    /// Weight of the first sample.
    pub first: f32,
    /// Weight of the last sample.
    pub last: f32,
}

impl Continued {
    /// Sample `index` of a line of `len` samples, however far outside it lies. A single sample goes on as a constant.
    #[must_use]
    pub fn new(index: isize, len: usize) -> Self {
        let last = len as isize - 1;
        if last == 0 {
            return Self { index: 0, sign: 1.0, first: 0.0, last: 0.0 };
        }
        // Two lengths farther the line is the same but for twice its rise.
        let period = 2 * last;
        let (periods, place) = (index.div_euclid(period), index.rem_euclid(period));
        let rise = 2.0 * periods as f32;
        if place <= last {
            Self { index: place as usize, sign: 1.0, first: -rise, last: rise }
        } else {
            Self { index: (period - place) as usize, sign: -1.0, first: -rise, last: 2.0 + rise }
        }
    }

    /// The samples inside and their weights; those without weight are left out.
    pub fn terms(self, len: usize) -> impl Iterator<Item = (usize, f32)> {
        let terms = [(self.index, self.sign), (0, self.first), (len - 1, self.last)];
        terms.into_iter().filter(|(_, weight)| *weight != 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The continuation as it is defined, one mirror at a time.
    fn naive(line: &[f32], index: isize) -> f32 {
        let last = line.len() as isize - 1;
        match index {
            _ if last == 0 => line[0],
            index if index < 0 => 2.0 * line[0] - naive(line, -index),
            index if index > last => 2.0 * line[line.len() - 1] - naive(line, 2 * last - index),
            index => line[index as usize],
        }
    }

    #[test]
    fn lines_are_mirrored_in_their_end_points() {
        for len in 1..6 {
            let line: Vec<f32> = (0..len).map(|i| ((i * i * 7) % 11) as f32).collect();
            for index in -20..20 {
                let found: f32 =
                    Continued::new(index, len).terms(len).map(|(inside, weight)| weight * line[inside]).sum();
                assert_eq!(found, naive(&line, index), "sample {index} of {line:?}");
            }
        }
    }
}
