//! Where a region was grabbed, and what dragging it there does.

use egui::{CursorIcon, Pos2, Rect};

use super::axis::PlotArea;
use crate::state::{Region, Shape};

/// How far from an edge the pointer still grabs it, in points.
const REACH: f32 = 6.0;
/// A region is never made narrower than this share of the plot.
const LEAST_EXTENT: f64 = 1.0 / 512.0;

/// Which ends of a region follow the pointer: one for an edge, one of each axis for a corner, all for its inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grip {
    /// The low and the high end of its values.
    pub value: [bool; 2],
    /// The low and the high end of its gradient magnitudes.
    pub gradient: [bool; 2],
}

impl Grip {
    /// The whole region.
    pub const INSIDE: Self = Self { value: [true; 2], gradient: [true; 2] };

    /// What the pointer would grab of a region that covers `rect` on the screen.
    #[must_use]
    pub fn at(rect: Rect, pointer: Pos2) -> Option<Self> {
        if !rect.expand(REACH).contains(pointer) {
            return None;
        }
        // A small region keeps a third of itself to be moved by.
        let ends = |low: f32, high: f32, at: f32| {
            let reach = REACH.min((high - low) / 3.0);
            [at < low + reach, at > high - reach]
        };
        let value = ends(rect.left(), rect.right(), pointer.x);
        // The screen's y points down, gradient magnitudes up.
        let [high, low] = ends(rect.top(), rect.bottom(), pointer.y);
        let grip = Self { value, gradient: [low, high] };
        let nothing = Self { value: [false; 2], gradient: [false; 2] };
        Some(if grip == nothing { Self::INSIDE } else { grip })
    }

    /// The pointer's shape over it.
    #[must_use]
    pub fn cursor(self) -> CursorIcon {
        match (self.value, self.gradient) {
            ([true, true], _) => CursorIcon::Move,
            ([false, false], _) => CursorIcon::ResizeVertical,
            (_, [false, false]) => CursorIcon::ResizeHorizontal,
            ([low, _], [down, _]) if low == down => CursorIcon::ResizeNeSw,
            _ => CursorIcon::ResizeNwSe,
        }
    }

    /// `region` with the grabbed ends moved by a difference of value and gradient magnitude. An end that meets the
    /// opposite one stops short of it.
    #[must_use]
    pub fn drag(self, region: &Region, [value, gradient]: [f64; 2], area: &PlotArea) -> Region {
        let least = |[low, high]: [f64; 2]| LEAST_EXTENT * (high - low);
        Region {
            value: move_ends(region.value, self.value, value, least(area.x)),
            gradient: move_ends(region.gradient, self.gradient, gradient, least(area.y)),
            ..region.clone()
        }
    }
}

/// Where a region's value and gradient magnitude lie on the screen.
#[must_use]
pub fn screen_rect([value, gradient]: [[f32; 2]; 2], area: &PlotArea) -> Rect {
    let corner = |end: usize| area.screen_from_plot([f64::from(value[end]), f64::from(gradient[end])]);
    Rect::from_two_pos(corner(0), corner(1))
}

/// Where in a region that covers `rect` on the screen a place lies: 0 to 1 to the right and upwards.
#[must_use]
pub fn place_in(rect: Rect, place: Pos2) -> [f32; 2] {
    [(place.x - rect.left()) / rect.width(), (rect.bottom() - place.y) / rect.height()]
}

/// The region under the pointer and where it would be grabbed: an edge before an inside, of edges the selected
/// region's, of insides the smallest region's. A painted region's inside is what is painted, and it has edges while it is
/// selected.
#[must_use]
pub fn region_at(regions: &[Region], selected: Option<usize>, area: &PlotArea, pointer: Pos2) -> Option<(usize, Grip)> {
    regions
        .iter()
        .enumerate()
        .filter_map(|(index, region)| {
            let rect = screen_rect([region.value, region.gradient], area);
            let mut grip = Grip::at(rect, pointer)?;
            if let Shape::Painted(map) = &region.shape
                && (grip == Grip::INSIDE || selected != Some(index))
            {
                if map.weight_at(place_in(rect, pointer)) == 0.0 {
                    return None;
                }
                grip = Grip::INSIDE;
            }
            let inside = grip == Grip::INSIDE;
            let order = (inside, !inside && selected != Some(index), rect.area());
            Some((order, (index, grip)))
        })
        .min_by(|(a, _), (b, _)| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)))
        .map(|(_, found)| found)
}

fn move_ends([low, high]: [f32; 2], ends: [bool; 2], by: f64, least: f64) -> [f32; 2] {
    let [low, high] = [low, high].map(f64::from);
    let moved = match ends {
        [true, true] => [low + by, high + by],
        [true, false] => [(low + by).min(high - least), high],
        [false, true] => [low, (high + by).max(low + least)],
        [false, false] => [low, high],
    };
    moved.map(|end| end as f32)
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;
    use crate::state::PaintedMap;

    fn area() -> PlotArea {
        PlotArea { rect: Rect::from_min_max(pos2(0.0, 0.0), pos2(200.0, 100.0)), x: [0.0, 200.0], y: [0.0, 100.0] }
    }

    fn region(value: [f32; 2], gradient: [f32; 2]) -> Region {
        Region { shape: Shape::Box, value, gradient, color: [1.0; 3], opacity: 1.0, softness: 0.1, emphasis: None }
    }

    #[test]
    fn edges_corners_and_inside_are_told_apart() {
        let rect = screen_rect([[50.0, 150.0], [20.0, 80.0]], &area());
        assert_eq!(rect, Rect::from_min_max(pos2(50.0, 20.0), pos2(150.0, 80.0)));
        let grip = |value, gradient| Some(Grip { value, gradient });
        assert_eq!(Grip::at(rect, pos2(100.0, 50.0)), Some(Grip::INSIDE));
        assert_eq!(Grip::at(rect, pos2(48.0, 50.0)), grip([true, false], [false, false]));
        assert_eq!(Grip::at(rect, pos2(100.0, 22.0)), grip([false, false], [false, true]));
        assert_eq!(Grip::at(rect, pos2(151.0, 79.0)), grip([false, true], [true, false]));
        assert_eq!(Grip::at(rect, pos2(40.0, 50.0)), None);
    }

    #[test]
    fn a_tiny_region_can_still_be_moved() {
        let rect = Rect::from_center_size(pos2(50.0, 50.0), egui::vec2(6.0, 6.0));
        assert_eq!(Grip::at(rect, pos2(50.0, 50.0)), Some(Grip::INSIDE));
    }

    #[test]
    fn dragging_moves_the_grabbed_ends_and_they_never_cross() {
        let start = region([50.0, 150.0], [20.0, 80.0]);
        let moved = Grip::INSIDE.drag(&start, [10.0, -5.0], &area());
        assert_eq!((moved.value, moved.gradient), ([60.0, 160.0], [15.0, 75.0]));
        let corner = Grip { value: [false, true], gradient: [true, false] };
        let resized = corner.drag(&start, [-20.0, 10.0], &area());
        assert_eq!((resized.value, resized.gradient), ([50.0, 130.0], [30.0, 80.0]));
        let crossed = corner.drag(&start, [-500.0, 500.0], &area());
        assert!(crossed.value[0] < crossed.value[1] && crossed.gradient[0] < crossed.gradient[1]);
    }

    #[test]
    fn the_smallest_inside_and_the_selected_edge_win() {
        let regions = [region([0.0, 200.0], [0.0, 100.0]), region([80.0, 120.0], [40.0, 60.0])];
        let found = |selected, x, y| region_at(&regions, selected, &area(), pos2(x, y)).map(|(index, _)| index);
        assert_eq!(found(None, 100.0, 50.0), Some(1));
        assert_eq!(found(Some(0), 100.0, 50.0), Some(1));
        assert_eq!(found(None, 30.0, 50.0), Some(0));
        let mut map = PaintedMap::blank();
        map.stroke([0.75, 0.5], [0.75, 0.5], [0.1, 0.1], false);
        let painted = [Region { shape: Shape::Painted(map), ..regions[0].clone() }];
        let found = |selected, x, y| region_at(&painted, selected, &area(), pos2(x, y)).map(|(_, grip)| grip);
        assert_eq!([found(None, 150.0, 50.0), found(None, 50.0, 50.0)], [Some(Grip::INSIDE), None]);
        assert_eq!([found(None, 0.0, 50.0), found(Some(0), 50.0, 50.0)], [None, None]);
        assert_eq!(found(Some(0), 0.0, 50.0), Some(Grip { value: [true, false], gradient: [false, false] }));
        let twins = [regions[1].clone(), regions[1].clone()];
        assert_eq!(region_at(&twins, Some(1), &area(), pos2(80.0, 50.0)).map(|(index, _)| index), Some(1));
    }
}
