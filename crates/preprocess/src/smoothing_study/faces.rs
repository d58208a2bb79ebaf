//! How much of a slab's faces is left.

use crate::accuracy::Truth;

/// Voxels this close to a face, in voxels, are on it.
const ON_FACE: f64 = 0.5;
/// A hit this close to the face, in voxels, is a hit of that face.
const KEPT: f64 = 1.0;

/// The share of the voxels on a true face whose hit lies within a voxel of that face: of the face of which least is left.
///
/// A voxel is on a face within half a voxel of the sharp surface, and at least four voxels from the volume's border.
/// `distance` is the signed distance of every voxel, not finite without a hit. A hit lies `surface − distance` beside the
/// face: one of a slab's other face is as far from it as the slab is thick, and does not count. None without any face.
#[must_use]
pub fn faces_kept(truth: &Truth, distance: &[f32]) -> Option<f64> {
    let on_face = truth.near.iter().filter_map(|expected| {
        let surface = expected.surface.filter(|surface| surface.abs() <= ON_FACE)?;
        Some((expected.boundary?, (f64::from(distance[expected.voxel]) - surface).abs() <= KEPT))
    });
    let mut counts: Vec<[usize; 2]> = Vec::new();
    for (face, kept) in on_face {
        counts.resize(counts.len().max(face + 1), [0; 2]);
        counts[face][0] += usize::from(kept);
        counts[face][1] += 1;
    }
    let shares = counts.into_iter().filter(|[_, all]| *all > 0).map(|[kept, all]| kept as f64 / all as f64);
    shares.min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::Case;
    use crate::phantom::Phantom;

    /// Slabs of two voxels, and roles that are those of the true surfaces.
    fn exact() -> (Truth, Vec<f32>) {
        let case = Case { thickness: 2.0, blur: 1.0, ..Case::base(Phantom::SlabPair, 32) };
        let truth = Truth::new(&case).expect("slabs");
        let mut distance = vec![f32::NAN; 32 * 32 * 32];
        for expected in &truth.near {
            distance[expected.voxel] = expected.surface.expect("slabs have surfaces") as f32;
        }
        (truth, distance)
    }

    fn on_face(truth: &Truth, face: usize) -> Vec<(usize, f64)> {
        let surfaces = truth.near.iter().filter(|expected| expected.boundary == Some(face));
        let of = surfaces.filter_map(|expected| Some((expected.voxel, expected.surface?)));
        of.filter(|(_, surface)| surface.abs() <= 0.5).collect()
    }

    #[test]
    fn true_roles_keep_all_and_none_keep_nothing() {
        let (truth, distance) = exact();
        assert!((0..4).all(|face| on_face(&truth, face).len() > 100));
        assert_eq!(faces_kept(&truth, &distance), Some(1.0));
        assert_eq!(faces_kept(&truth, &vec![f32::NAN; distance.len()]), Some(0.0));
        assert_eq!(faces_kept(&Truth::default(), &distance), None);
    }

    #[test]
    fn the_worst_face_counts() {
        let (truth, mut distance) = exact();
        let [first, second] = [on_face(&truth, 1), on_face(&truth, 2)];
        for (voxel, _) in first.iter().take(first.len() / 4).chain(second.iter().take(second.len() / 2)) {
            distance[*voxel] = f32::NAN;
        }
        let expected = 1.0 - (second.len() / 2) as f64 / second.len() as f64;
        assert_eq!(faces_kept(&truth, &distance), Some(expected));
    }

    #[test]
    fn a_hit_counts_by_its_place() {
        let (truth, distance) = exact();
        let face = on_face(&truth, 3);
        let with = |change: &dyn Fn(f64) -> f64| {
            let mut distance = distance.clone();
            face.iter().for_each(|&(voxel, surface)| distance[voxel] = change(surface) as f32);
            faces_kept(&truth, &distance)
        };
        assert_eq!(with(&|surface| surface + 0.95), Some(1.0));
        assert_eq!(with(&|surface| surface - 1.05), Some(0.0));
        // The other face, two voxels away across the slab.
        assert_eq!(with(&|surface| 2.0 - surface), Some(0.0));
    }
}
