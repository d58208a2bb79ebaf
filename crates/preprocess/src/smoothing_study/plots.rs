//! What is drawn of the study.

use super::suite::THICKNESS_NOISES;
use super::table::halves;
use super::{CannyRow, Group, KERNELS, PLACEMENTS, StudyRow};
use crate::accuracy::{Case, Drawing};
use crate::phantom::Phantom;
use crate::plot::{AxisScale, Chart, ChartAxis, Line, Point, Series, SeriesStyle};

/// How each of [`PLACEMENTS`] looks.
const STYLES: [SeriesStyle; 7] = [
    SeriesStyle::nth(0),
    SeriesStyle::nth(3),
    SeriesStyle::nth(2),
    SeriesStyle::nth(5),
    SeriesStyle::nth(6),
    SeriesStyle::nth(1),
    SeriesStyle::nth(4),
];
/// Canny's two Gaussians, and how they look.
const CANNY: [(f64, SeriesStyle); 2] = [(1.0, SeriesStyle::nth(7)), (1.5, SeriesStyle { colour: 7, shape: 1 })];

/// A figure with the number of whatever it was counted over.
type Weighted = Option<[f64; 2]>;
/// Such a figure and its place along x.
type Found = (f64, [f64; 2]);
/// What is drawn of a measurement, if anything.
type Pick<'a, Measured> = &'a dyn Fn(&Measured) -> Option<Found>;

/// A figure of a measurement that can be pooled over a group's scenes.
struct Quantity {
    name: &'static str,
    title: &'static str,
    scale: AxisScale,
    /// Whether squares are averaged.
    squared: bool,
    factor: f64,
    of: fn(&StudyRow) -> Weighted,
    of_canny: fn(&CannyRow) -> Weighted,
}

const QUANTITIES: [Quantity; 3] = [
    Quantity {
        name: "rms",
        title: "rms error of the distance [voxel]",
        scale: AxisScale::Log,
        squared: true,
        factor: 1.0,
        of: |row| Some([row.row.figures.near.rms?, hits(row)?]),
        of_canny: |row| Some([row.crossing_rms?, row.near_voxels]),
    },
    Quantity {
        name: "wrong",
        title: "hits off by more than half a voxel [%]",
        scale: AxisScale::LogOrZero,
        squared: false,
        factor: 100.0,
        of: |row| Some([row.row.figures.near.wrong_share?, hits(row)?]),
        of_canny: |row| Some([row.false_share?, row.edge_voxels]),
    },
    Quantity {
        name: "right",
        title: "voxels within two blurs with a right hit [%]",
        scale: AxisScale::Linear,
        squared: false,
        factor: 100.0,
        of: |row| {
            let near = &row.row.figures.near;
            let right = near.hit_rate? * (1.0 - near.wrong_share.unwrap_or(0.0));
            Some([right, near.voxels as f64])
        },
        // It marks boundaries alone, and no other voxel says how far they are.
        of_canny: |_| None,
    },
];

fn hits(row: &StudyRow) -> Option<f64> {
    Some(row.row.figures.near.voxels as f64 * row.row.figures.near.hit_rate?)
}

/// All drawings for which `rows` hold the cases: `rms-`, `wrong-` and `right-` for every group of scenes and
/// `faces-` for every noise,
/// with each kernel.
#[must_use]
pub fn study_drawings(rows: &[StudyRow], canny: &[CannyRow]) -> Vec<Drawing> {
    let mut drawings = Vec::new();
    for kernel in KERNELS {
        for quantity in &QUANTITIES {
            for group in Group::ALL {
                let name = format!("{}-{}-{kernel}", quantity.name, group.name());
                drawings.extend(noise_chart(rows, canny, kernel, group, quantity).map(|chart| Drawing { name, chart }));
            }
        }
        for noise in THICKNESS_NOISES {
            let name = format!("faces-noise{}-{kernel}", 100.0 * noise);
            drawings.extend(thickness_chart(rows, canny, kernel, noise).map(|chart| Drawing { name, chart }));
        }
    }
    drawings
}

fn noise_chart(
    rows: &[StudyRow],
    canny: &[CannyRow],
    kernel: &str,
    group: Group,
    quantity: &Quantity,
) -> Option<Chart> {
    let noise = |case: &Case| (Group::of(case) == Some(group)).then_some(100.0 * case.noise);
    let ours = |row: &StudyRow| Some((noise(&row.row.case)?, (quantity.of)(row)?));
    let theirs = |row: &CannyRow| Some((noise(&row.case)?, (quantity.of_canny)(row)?));
    let pool = |found: Vec<Found>| pooled(found, quantity);
    let beside = match quantity.name {
        _ if canny.is_empty() => "",
        "rms" => "; Canny: edge voxels within two blurs",
        "wrong" => "; Canny: edge voxels off by more than a voxel",
        _ => "",
    };
    // At the junction even the best is off by tenths of a voxel: no decades to span.
    let scale =
        if group == Group::Junction && quantity.scale == AxisScale::Log { AxisScale::Linear } else { quantity.scale };
    Some(Chart {
        title: format!("Smoothing under noise: {}", group.name()),
        subtitle: format!("{}; {kernel}{beside}", group.description()),
        x: ChartAxis { title: "noise, share of the step [%]".into(), scale: AxisScale::Linear },
        y: ChartAxis { title: quantity.title.into(), scale },
        series: all_series(rows, canny, kernel, &ours, &theirs, &pool)?,
    })
}

fn thickness_chart(rows: &[StudyRow], canny: &[CannyRow], kernel: &str, noise: f64) -> Option<Chart> {
    let is_slab = |case: &Case| case.phantom == Phantom::SlabPair && Group::of(case) != Some(Group::Thick);
    let thickness = |case: &Case| (is_slab(case) && case.noise == noise).then_some(case.thickness);
    let ours = |row: &StudyRow| Some((thickness(&row.row.case)?, [100.0 * row.faces_kept?, 1.0]));
    let theirs = |row: &CannyRow| Some((thickness(&row.case)?, [100.0 * row.faces_kept?, 1.0]));
    let places = |found: Vec<Found>| found.into_iter().map(|(x, [y, _])| [x, y]).collect();
    Some(Chart {
        title: "Thin layers: what is left of the worst face".into(),
        subtitle: format!("slab-pair, blur 1, noise {} % of the step; {kernel}", 100.0 * noise),
        x: ChartAxis { title: "thickness of the slabs [voxel]".into(), scale: AxisScale::Linear },
        y: ChartAxis { title: "face voxels with a hit within a voxel of it [%]".into(), scale: AxisScale::Linear },
        series: all_series(rows, canny, kernel, &ours, &theirs, &places)?,
    })
}

/// A curve for every placement and every Gaussian of Canny's that has two points; none without a curve.
fn all_series(
    rows: &[StudyRow],
    canny: &[CannyRow],
    kernel: &str,
    ours: Pick<'_, StudyRow>,
    theirs: Pick<'_, CannyRow>,
    gather: &dyn Fn(Vec<Found>) -> Vec<[f64; 2]>,
) -> Option<Vec<Series>> {
    let series = |name: String, places: Vec<[f64; 2]>, line: Line, style: SeriesStyle| {
        let hollow = line == Line::Dashed;
        let mut points: Vec<Point> =
            places.into_iter().map(|place| Point { place, hollow, ..Point::default() }).collect();
        points.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
        Series { name, points, line, style }
    };
    let mut all: Vec<Series> = PLACEMENTS
        .iter()
        .zip(STYLES)
        .map(|(placement, style)| {
            let rows = rows.iter().filter(|row| halves(row) == (kernel, placement));
            series((*placement).to_owned(), gather(rows.filter_map(ours).collect()), Line::Solid, style)
        })
        .filter(|series| series.points.len() > 1)
        .collect();
    if all.is_empty() {
        return None;
    }
    all.extend(CANNY.map(|(sigma, style)| {
        let rows = canny.iter().filter(|row| row.sigma == sigma);
        series(format!("Canny (ITK), sigma {sigma}"), gather(rows.filter_map(theirs).collect()), Line::Dashed, style)
    }));
    all.retain(|series| series.points.len() > 1);
    Some(all)
}

/// One place for each x: the weighted mean, or root mean square, of all that was found there.
fn pooled(found: Vec<Found>, quantity: &Quantity) -> Vec<[f64; 2]> {
    let mut sums: Vec<Found> = Vec::new();
    for (x, [figure, weight]) in found {
        let term = weight * if quantity.squared { figure * figure } else { figure };
        match sums.iter_mut().find(|(known, _)| *known == x) {
            Some((_, [sum, weights])) => (*sum, *weights) = (*sum + term, *weights + weight),
            None => sums.push((x, [term, weight])),
        }
    }
    let mean = |[sum, weights]: [f64; 2]| if quantity.squared { (sum / weights).sqrt() } else { sum / weights };
    let kept = sums.into_iter().filter(|(_, [_, weights])| *weights > 0.0);
    kept.map(|(x, sum)| [x, quantity.factor * mean(sum)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::{self, Figures, Row};

    fn row(case: Case, method: &str, rms: f64, voxels: usize) -> StudyRow {
        let near = accuracy::Found {
            voxels,
            hit_rate: Some(1.0),
            rms: Some(rms),
            wrong_share: Some(rms / 10.0),
            ..Default::default()
        };
        let figures = Figures { near, ..Figures::default() };
        let row = Row { case, method: method.into(), chosen: String::new(), seconds_per_voxel: 1e-7, figures };
        StudyRow { row, faces_kept: Some(0.5) }
    }

    fn thin(thickness: f64, noise: f64) -> Case {
        Case { thickness, noise, blur: 1.0, ..Case::base(Phantom::SlabPair, 64) }
    }

    #[test]
    fn scenes_of_a_group_are_pooled_by_their_hits() {
        let rows = [
            row(thin(2.0, 0.01), "bspline5, auto", 0.3, 300),
            row(thin(3.0, 0.01), "bspline5, auto", 0.1, 100),
            row(thin(3.0, 0.0), "bspline5, auto", 0.2, 100),
            row(thin(3.0, 0.0), "central2, auto", 0.7, 100),
        ];
        let drawings = study_drawings(&rows, &[]);
        let names: Vec<&str> = drawings.iter().map(|drawing| drawing.name.as_str()).collect();
        assert_eq!(names, ["rms-thin-bspline5", "wrong-thin-bspline5", "right-thin-bspline5", "faces-noise1-bspline5"]);
        let places = |index: usize| -> Vec<[f64; 2]> {
            drawings[index].chart.series[0].points.iter().map(|point| point.place).collect()
        };
        let pooled = ((300.0 * 0.09 + 100.0 * 0.01) / 400.0_f64).sqrt();
        assert!((places(0)[1][1] - pooled).abs() < 1e-12 && places(0)[0] == [0.0, 0.2], "{:?}", places(0));
        assert!((places(1)[1][1] - 2.5).abs() < 1e-12, "{:?}", places(1));
        // Wrong hits: 3 % of three quarters and 1 % of the rest.
        assert!((places(2)[1][1] - 97.5).abs() < 1e-12, "{:?}", places(2));
        assert_eq!(places(3), [[2.0, 50.0], [3.0, 50.0]]);
    }

    #[test]
    fn canny_is_drawn_beside_them() {
        let rows = [0.0, 0.01].map(|noise| row(thin(3.0, noise), "central2, none", 0.3, 300));
        let canny = [0.0, 0.01].map(|noise| CannyRow {
            case: thin(3.0, noise),
            sigma: 1.5,
            edge_voxels: 200.0,
            near_voxels: 100.0,
            crossing_rms: Some(0.4),
            false_share: Some(0.5),
            faces_kept: Some(0.9),
        });
        let drawings = study_drawings(&rows, &canny);
        let names: Vec<&str> = drawings[0].chart.series.iter().map(|series| series.name.as_str()).collect();
        assert_eq!(names, ["none", "Canny (ITK), sigma 1.5"]);
        assert_eq!(drawings[1].chart.series[1].points[0].place, [0.0, 50.0]);
    }
}
