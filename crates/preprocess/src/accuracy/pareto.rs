//! Which methods nothing else beats.

use super::Row;

/// Methods that lose more voxels than this are no members of a front: what is lost is counted in no error.
const LEAST_HIT_RATE: f64 = 0.99;

/// Which points no other is better than in one coordinate without being worse in the other; smaller is better. Points that
/// are not finite are never on it, and of equal points all are.
#[must_use]
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<bool> {
    let dominates = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && (a[0] < b[0] || a[1] < b[1]);
    points
        .iter()
        .map(|point| {
            point.iter().all(|coordinate| coordinate.is_finite()) && !points.iter().any(|other| dominates(other, point))
        })
        .collect()
}

/// The members of the front of rms error against time among the rows of one case, of those that find at least 99 % of the
/// voxels near boundaries.
#[must_use]
pub fn members(rows: &[&Row]) -> Vec<bool> {
    let point = |row: &&Row| {
        let complete = row.figures.near.hit_rate.is_some_and(|rate| rate >= LEAST_HIT_RATE);
        let error = row.figures.near.rms.filter(|_| complete);
        error.map_or([f64::NAN; 2], |error| [row.seconds_per_voxel, error])
    };
    pareto_front(&rows.iter().map(point).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nothing_beats_is_on_the_front() {
        let points = [[1.0, 9.0], [2.0, 5.0], [3.0, 5.0], [2.5, 6.0], [4.0, 1.0], [9.0, 0.5], [8.0, 1.5]];
        assert_eq!(pareto_front(&points), [true, true, false, false, true, true, false]);
        assert_eq!(
            pareto_front(&[[1.0, 1.0], [1.0, 1.0], [1.0, f64::NAN], [0.5, f64::NAN]]),
            [true, true, false, false]
        );
        assert!(pareto_front(&[]).is_empty());
    }
}
