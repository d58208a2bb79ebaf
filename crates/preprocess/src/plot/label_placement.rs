//! Where the labels of points go so that they can be read.

/// A rectangle of pixels: left, top, right, bottom.
pub(super) type Rectangle = [i32; 4];

/// Space between a label and what is beside it.
const GAP: i32 = 2;
/// Distances from the point at which places are tried, in multiples of the text's height.
const RINGS: [f64; 9] = [0.6, 1.1, 1.7, 2.4, 3.2, 4.2, 5.4, 7.0, 9.0];
/// Directions that are tried on each ring.
const DIRECTIONS: usize = 16;

/// A label to be placed.
#[derive(Clone, Debug)]
pub(super) struct Label {
    /// The point it names.
    pub point: (i32, i32),
    /// Width of its text.
    pub width: i32,
}

/// The rectangles of labels of one `height`, in their order, all within `frame`: as near to their points as they can be
/// without covering one another or a marker of `radius` on any of the `markers`; where there is no such place, the one
/// that covers least.
pub(super) fn place_labels(
    labels: &[Label],
    markers: &[(i32, i32)],
    [height, radius]: [i32; 2],
    frame: Rectangle,
) -> Vec<Rectangle> {
    let markers: Vec<Rectangle> =
        markers.iter().map(|(x, y)| [x - radius, y - radius, x + radius, y + radius]).collect();
    // Those in the thick of it choose first.
    let crowd = |label: &Label| {
        let near = |other: &&Label| {
            (other.point.0 - label.point.0).abs() < label.width && (other.point.1 - label.point.1).abs() < 3 * height
        };
        labels.iter().filter(near).count()
    };
    let mut order: Vec<usize> = (0..labels.len()).collect();
    order.sort_by_key(|&index| std::cmp::Reverse(crowd(&labels[index])));
    let mut placed: Vec<Option<Rectangle>> = vec![None; labels.len()];
    for index in order {
        let cost = |place: &Rectangle| {
            let covered = |others: &mut dyn Iterator<Item = &Rectangle>| -> i64 {
                others.map(|other| overlap(place, other)).sum()
            };
            covered(&mut placed.iter().flatten()) * 2 + covered(&mut markers.iter())
        };
        let inside = |place: &Rectangle| {
            place[0] >= frame[0] && place[1] >= frame[1] && place[2] <= frame[2] && place[3] <= frame[3]
        };
        let candidates = candidates(&labels[index], height).filter(inside);
        // The first of equals is the nearest.
        placed[index] = candidates.min_by_key(cost).or(Some(beside(&labels[index], height)));
    }
    placed.into_iter().flatten().collect()
}

fn beside(label: &Label, height: i32) -> Rectangle {
    let (x, y) = label.point;
    [x + height, y - height / 2, x + height + label.width, y + height / 2]
}

fn candidates(label: &Label, height: i32) -> impl Iterator<Item = Rectangle> {
    let (label, half) = (label.clone(), [0.5 * f64::from(label.width), 0.5 * f64::from(height)]);
    let around = move |ring: f64| {
        let label = label.clone();
        (0..DIRECTIONS).map(move |direction| {
            let (sine, cosine) = (std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64).sin_cos();
            // The rectangle touches the ring with the side that faces the point.
            let reach = ring * f64::from(height);
            let centre = |along: f64, half: f64| along * reach + along.signum() * half * along.abs().powf(0.3).min(1.0);
            let x = label.point.0 + centre(cosine, half[0]).round() as i32;
            let y = label.point.1 + centre(sine, half[1]).round() as i32;
            [x - label.width / 2, y - height / 2, x - label.width / 2 + label.width, y - height / 2 + height]
        })
    };
    RINGS.into_iter().flat_map(around)
}

/// Pixels that two rectangles share, each widened by the gap.
fn overlap(a: &Rectangle, b: &Rectangle) -> i64 {
    let along = |low: usize, high: usize| i64::from((a[high].min(b[high]) - a[low].max(b[low]) + GAP).max(0));
    along(0, 2) * along(1, 3)
}

/// The point of a rectangle that is nearest to a point.
pub(super) fn nearest_point([left, top, right, bottom]: Rectangle, (x, y): (i32, i32)) -> (i32, i32) {
    (x.clamp(left, right), y.clamp(top, bottom))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_a_crowd_cover_nothing() {
        let points: Vec<(i32, i32)> =
            (0..24).map(|index| (300 + 37 * (index % 5) + index, 200 + 11 * (index / 5))).collect();
        let labels: Vec<Label> = points.iter().map(|&point| Label { point, width: 90 }).collect();
        let frame = [0, 0, 800, 600];
        let placed = place_labels(&labels, &points, [14, 5], frame);
        assert_eq!(placed.len(), labels.len());
        for (index, place) in placed.iter().enumerate() {
            assert!(place[0] >= 0 && place[1] >= 0 && place[2] <= 800 && place[3] <= 600);
            assert!(placed[..index].iter().all(|other| overlap(place, other) == 0), "{index}: {place:?}");
            let over = |&(x, y): &(i32, i32)| overlap(place, &[x - 5, y - 5, x + 5, y + 5]) > 0;
            assert!(!points.iter().any(over), "{index}: {place:?}");
        }
    }

    #[test]
    fn a_lonely_label_stands_beside_its_point() {
        let placed = place_labels(&[Label { point: (50, 50), width: 40 }], &[(50, 50)], [14, 5], [0, 0, 100, 100]);
        let (x, y) = nearest_point(placed[0], (50, 50));
        assert!((x - 50).abs() + (y - 50).abs() < 14, "{placed:?}");
        // At the frame's edge it turns inwards.
        let placed = place_labels(&[Label { point: (98, 50), width: 40 }], &[(98, 50)], [14, 5], [0, 0, 100, 100]);
        assert!(placed[0][2] <= 100, "{placed:?}");
    }
}
