//! Which neighbours a voxel has, where they lie in memory, and what they count for by their distance.

/// All offsets of a neighbourhood, in their order in memory.
#[must_use]
pub fn neighbourhood(reach: [usize; 3]) -> Vec<[isize; 3]> {
    let [x, y, z] = reach.map(|reach| -(reach as isize)..=reach as isize);
    let slice = |z: isize| {
        let x = x.clone();
        y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
    };
    z.flat_map(slice).collect()
}

/// Whether an offset leads to a voxel that comes after its origin in memory; the opposite offset leads to one before.
#[must_use]
pub fn is_later(&[x, y, z]: &[isize; 3]) -> bool {
    [z, y, x] > [0; 3]
}

/// Wd of the neighbour at an offset.
#[must_use]
pub fn spatial_weight(offset: &[isize; 3], spacing: [f32; 3], sigma: f32) -> f32 {
    let squared: f32 = offset.iter().zip(spacing).map(|(&steps, h)| (steps as f32 * h).powi(2)).sum();
    libm::exp(f64::from(-0.5 * squared / sigma.powi(2))) as f32
}

/// How far after a sample the one at an offset comes.
#[must_use]
pub fn shift(offset: [isize; 3], strides: [usize; 3]) -> isize {
    let along = |axis: usize| offset[axis] * strides[axis] as isize;
    along(0) + along(1) + along(2)
}
