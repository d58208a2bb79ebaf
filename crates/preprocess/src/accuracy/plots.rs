//! What is drawn of the measurements.

use super::pareto::members;
use super::{Case, Dtype, Row};
use crate::phantom::Phantom;
use crate::plot::{AxisScale, Chart, ChartAxis, Line, Point, Series, SeriesStyle};

/// The noise of the case whose Pareto front is drawn beside that without, as a share of the step.
const NOISE: f64 = 0.01;

/// The methods that are drawn against the blur: each kernel at its best, and the rule sets.
const AGAINST_BLUR: [(&str, Line, SeriesStyle); 8] = [
    ("paper", Line::Dashed, SeriesStyle::nth(5)),
    ("fast", Line::Solid, SeriesStyle::nth(0)),
    ("central2+cubic", Line::Solid, SeriesStyle::nth(6)),
    ("central4+cubic", Line::Solid, SeriesStyle::nth(2)),
    ("bspline3+exact", Line::Solid, SeriesStyle::nth(3)),
    ("accurate", Line::Solid, SeriesStyle::nth(1)),
    ("gaussian:1+exact", Line::Solid, SeriesStyle::nth(7)),
    ("auto", Line::Dashed, SeriesStyle::nth(4)),
];

/// The methods that are drawn against noise and thickness: colour and shape by what smooths, dashed for differences.
const AGAINST_NOISE: [(&str, Line, SeriesStyle); 10] = [
    ("paper", Line::Dashed, SeriesStyle::nth(5)),
    ("fast", Line::Dashed, SeriesStyle::nth(0)),
    ("accurate", Line::Solid, SeriesStyle::nth(0)),
    ("fast, bilateral-derivatives", Line::Dashed, SeriesStyle::nth(3)),
    ("fast, bilateral-value", Line::Dashed, SeriesStyle::nth(2)),
    ("accurate, bilateral-value", Line::Solid, SeriesStyle::nth(2)),
    ("fast, gaussian-value", Line::Dashed, SeriesStyle::nth(1)),
    ("accurate, gaussian-value", Line::Solid, SeriesStyle::nth(1)),
    ("gaussian:1+exact", Line::Solid, SeriesStyle::nth(7)),
    ("auto", Line::Solid, SeriesStyle::nth(4)),
];

/// A chart and the name of its file, without an extension.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// The name.
    pub name: String,
    /// What is drawn.
    pub chart: Chart,
}

/// All drawings for which `rows` hold the cases.
#[must_use]
pub fn drawings(rows: &[Row]) -> Vec<Drawing> {
    let named = |name: &str| {
        let name = name.to_owned();
        |chart| Drawing { name, chart }
    };
    let pareto = |name, noise| pareto_chart(rows, noise).map(named(name));
    let all = [
        pareto("pareto", 0.0),
        pareto("pareto-noise", NOISE),
        blur_chart(rows).map(named("blur")),
        noise_chart(rows, "rms error of the distance [voxel]", AxisScale::Log, |row| row.figures.near.rms)
            .map(named("noise-rms")),
        noise_chart(rows, "hits off by more than half a voxel [%]", AxisScale::LogOrZero, |row| {
            row.figures.near.wrong_share.map(|share| 100.0 * share)
        })
        .map(named("noise-wrong")),
        slab_error_chart(rows).map(named("slabs")),
        slab_face_chart(rows).map(named("slabs-noise")),
    ];
    all.into_iter().flatten().collect()
}

fn axis(title: &str, scale: AxisScale) -> ChartAxis {
    ChartAxis { title: title.to_owned(), scale }
}

/// The base case of a phantom as it was measured, whatever its edge.
fn base(rows: &[Row], phantom: Phantom) -> Option<Case> {
    let is_base = |case: &Case| {
        case.phantom == phantom && case.blur == Case::BASE_BLUR && case.noise == 0.0 && case.dtype == Dtype::F32
    };
    rows.iter().map(|row| row.case).find(is_base)
}

fn pareto_chart(rows: &[Row], noise: f64) -> Option<Chart> {
    let case = Case { noise, ..base(rows, Phantom::Ball)? };
    let rows: Vec<&Row> = rows.iter().filter(|row| row.case == case).collect();
    let is_member = members(&rows);
    let place = |row: &Row| [1e9 * row.seconds_per_voxel, row.figures.near.rms.unwrap_or(f64::NAN)];
    let mut front: Vec<Point> = rows
        .iter()
        .zip(&is_member)
        .filter(|(_, member)| **member)
        .map(|(row, _)| Point { place: place(row), ..Point::default() })
        .collect();
    front.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
    let mut series =
        vec![Series { name: "Pareto front".into(), points: front, line: Line::Bare, style: SeriesStyle::nth(0) }];
    for family in ["paper", "central2", "central4", "bspline3", "bspline5", "gaussian:1", "auto"] {
        let points: Vec<Point> = rows
            .iter()
            .zip(&is_member)
            .filter(|(row, _)| family_of(row) == family)
            .map(|(row, member)| Point { place: place(row), label: Some(row.method.clone()), hollow: !member })
            .collect();
        if !points.is_empty() {
            let style = SeriesStyle::nth(series.len() - 1);
            series.push(Series { name: family.to_owned(), points, line: Line::None, style });
        }
    }
    (!rows.is_empty()).then(|| Chart {
        title: "Accuracy against time".into(),
        subtitle: format!("{case}; filled: nothing is both faster and better; hollow: something is"),
        x: axis("time per voxel [ns]", AxisScale::Log),
        y: axis("rms error of the distance [voxel]", AxisScale::Log),
        series,
    })
}

/// What colours a method: its rule set where that chooses, its kernel otherwise.
fn family_of(row: &Row) -> &str {
    match row.method.as_str() {
        rule_set @ ("paper" | "auto") => rule_set,
        _ => row.chosen.split('+').next().unwrap_or_default(),
    }
}

/// Curves of some methods over the cases that `belongs` picks, of which there must be two.
fn curves(
    rows: &[Row],
    methods: &[(&str, Line, SeriesStyle)],
    belongs: impl Fn(&Case) -> bool,
    place: impl Fn(&Row) -> [f64; 2],
) -> Option<Vec<Series>> {
    let of = |&(name, line, style): &(&str, Line, SeriesStyle)| {
        let rows = rows.iter().filter(|row| row.method == name && belongs(&row.case));
        let mut points: Vec<Point> = rows
            .map(|row| Point { place: place(row), hollow: line == Line::Dashed, ..Point::default() })
            .filter(|point| point.place.iter().all(|number| number.is_finite()))
            .collect();
        points.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
        Series { name: name.to_owned(), points, line, style }
    };
    let series: Vec<Series> = methods.iter().map(of).filter(|series| series.points.len() > 1).collect();
    (!series.is_empty()).then_some(series)
}

fn blur_chart(rows: &[Row]) -> Option<Chart> {
    let base = base(rows, Phantom::Ball)?;
    let belongs = |case: &Case| case.differs_in_blur_alone(&base);
    let series = curves(rows, &AGAINST_BLUR, belongs, |row| [row.case.blur, row.figures.near.rms.unwrap_or(f64::NAN)])?;
    Some(Chart {
        title: "Accuracy against blur".into(),
        subtitle: format!("ball, {}³, no noise, f32", base.edge),
        x: axis("blur of the boundary [voxel]", AxisScale::Linear),
        y: axis("rms error of the distance [voxel]", AxisScale::Log),
        series,
    })
}

fn noise_chart(rows: &[Row], title: &str, scale: AxisScale, figure: impl Fn(&Row) -> Option<f64>) -> Option<Chart> {
    let base = base(rows, Phantom::Ball)?;
    let belongs = |case: &Case| case.differs_in_noise_alone(&base);
    let place = |row: &Row| [100.0 * row.case.noise, figure(row).unwrap_or(f64::NAN)];
    Some(Chart {
        title: "Accuracy under noise".into(),
        subtitle: format!("ball, {}³, blur {}, f32; hollow and dashed: central differences", base.edge, base.blur),
        x: axis("noise, share of the step [%]", AxisScale::Linear),
        y: axis(title, scale),
        series: curves(rows, &AGAINST_NOISE, belongs, place)?,
    })
}

/// Without noise every rule but the literal one keeps every face: what differs is where.
fn slab_error_chart(rows: &[Row]) -> Option<Chart> {
    let place = |row: &Row| [row.case.thickness, row.figures.near.rms.unwrap_or(f64::NAN)];
    let (base, series) = slab_curves(rows, &AGAINST_BLUR, 0.0, place)?;
    Some(Chart {
        title: "Thin layers: accuracy against thickness".into(),
        subtitle: format!("slab-pair, {}³, blur {}, no noise, f32", base.edge, base.blur),
        x: axis("thickness of the slabs [voxel]", AxisScale::Linear),
        y: axis("rms error of the distance [voxel]", AxisScale::Log),
        series,
    })
}

fn slab_face_chart(rows: &[Row]) -> Option<Chart> {
    let place = |row: &Row| [row.case.thickness, row.figures.weakest_boundary.map_or(f64::NAN, |rate| 100.0 * rate)];
    let (base, series) = slab_curves(rows, &AGAINST_NOISE, NOISE, place)?;
    Some(Chart {
        title: "Thin layers: what noise leaves of the weakest face".into(),
        subtitle: format!(
            "slab-pair, {}³, blur {}, noise {} %, f32; hollow and dashed: central differences",
            base.edge,
            base.blur,
            100.0 * NOISE
        ),
        x: axis("thickness of the slabs [voxel]", AxisScale::Linear),
        y: axis("weakest face: voxels with a hit within a voxel of it [%]", AxisScale::Linear),
        series,
    })
}

fn slab_curves(
    rows: &[Row],
    methods: &[(&str, Line, SeriesStyle)],
    noise: f64,
    place: impl Fn(&Row) -> [f64; 2],
) -> Option<(Case, Vec<Series>)> {
    let base = Case { noise, ..base(rows, Phantom::SlabPair)? };
    Some((base, curves(rows, methods, |case| case.differs_in_thickness_alone(&base), place)?))
}

#[cfg(test)]
mod tests {
    use super::super::{Figures, Found, methods};
    use super::*;

    fn row(case: Case, method: &str) -> Row {
        let near = Found { hit_rate: Some(1.0), rms: Some(0.01), wrong_share: Some(0.0), ..Found::default() };
        let figures = Figures { near, weakest_boundary: Some(0.9), ..Figures::default() };
        Row { case, method: method.into(), chosen: "central2+linear".into(), seconds_per_voxel: 1e-7, figures }
    }

    #[test]
    fn methods_that_are_drawn_exist() {
        let methods = methods();
        for (name, ..) in AGAINST_BLUR.iter().chain(&AGAINST_NOISE) {
            assert!(methods.iter().any(|method| method.name == *name), "{name}");
        }
    }

    #[test]
    fn a_drawing_for_whatever_was_measured() {
        let ball = Case::base(Phantom::Ball, 32);
        let slabs = Case::base(Phantom::SlabPair, 32);
        let names = |cases: &[Case]| -> Vec<String> {
            let rows: Vec<Row> =
                cases.iter().flat_map(|&case| ["fast", "auto"].map(|method| row(case, method))).collect();
            drawings(&rows).into_iter().map(|drawing| drawing.name).collect()
        };
        assert_eq!(names(&[ball]), ["pareto"]);
        let noisy = Case { noise: NOISE, ..ball };
        assert_eq!(names(&[ball, noisy]), ["pareto", "pareto-noise", "noise-rms", "noise-wrong"]);
        assert_eq!(names(&[ball, Case { blur: 1.0, ..ball }]), ["pareto", "blur"]);
        let thinner = Case { thickness: 2.0, ..slabs };
        assert_eq!(names(&[slabs, thinner]), ["slabs"]);
        let noisy = [slabs, thinner].map(|slabs| Case { noise: NOISE, ..slabs });
        assert_eq!(names(&[slabs, noisy[0], noisy[1]]), ["slabs-noise"]);
        assert!(names(&[Case::base(Phantom::Torus, 32)]).is_empty());
    }
}
