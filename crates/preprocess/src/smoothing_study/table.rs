//! The study's measurements as a table of comma-separated values and as one for the eye.

use std::fmt::Write;

use super::StudyRow;
use crate::plot::numbers::short_number;

/// A column of the table: its name with its unit, and what stands in it.
type Column = (&'static str, fn(&StudyRow) -> String);

/// Lengths are in voxels, shares and rates from 0 to 1, the gradient's bias relative.
const COLUMNS: [Column; 17] = [
    ("phantom", |row| row.row.case.phantom.name().to_owned()),
    ("edge [voxel]", |row| row.row.case.edge.to_string()),
    ("blur [voxel]", |row| row.row.case.blur.to_string()),
    ("thickness [voxel]", |row| row.row.case.thickness.to_string()),
    ("noise [step]", |row| row.row.case.noise.to_string()),
    ("kernel", |row| halves(row).0.to_owned()),
    ("placement", |row| halves(row).1.to_owned()),
    ("settings", |row| row.row.chosen.replace(',', ";")),
    ("time [s / voxel]", |row| row.row.seconds_per_voxel.to_string()),
    ("voxels", |row| row.row.figures.near.voxels.to_string()),
    ("hit_rate", |row| number(row.row.figures.near.hit_rate)),
    ("distance_rms [voxel]", |row| number(row.row.figures.near.rms)),
    ("distance_rms_to_own_crossing [voxel]", |row| number(row.row.figures.own_rms)),
    ("wrong_share", |row| number(row.row.figures.near.wrong_share)),
    ("false_share", |row| number(row.row.figures.false_share)),
    ("gradient_bias", |row| number(row.row.figures.near.gradient_bias)),
    ("faces_kept", |row| number(row.faces_kept)),
];

/// Kernel and placement of a row, from its method's name.
pub(super) fn halves(row: &StudyRow) -> (&str, &str) {
    row.row.method.split_once(", ").unwrap_or((&row.row.method, ""))
}

/// All figures of all rows: one line a case and method under a header with units in brackets; a figure that could not be
/// counted is empty.
#[must_use]
pub fn study_csv(rows: &[StudyRow]) -> String {
    let header = COLUMNS.map(|(name, _)| name).join(",") + "\n";
    let body = rows.iter().map(|row| COLUMNS.map(|(_, of)| of(row)).join(",") + "\n");
    std::iter::once(header).chain(body).collect()
}

fn number(figure: Option<f64>) -> String {
    figure.map(|figure| figure.to_string()).unwrap_or_default()
}

/// The rows of one case for the eye.
#[must_use]
pub fn study_table(rows: &[StudyRow]) -> String {
    let mut table = rows.first().map(|row| format!("{}\n", row.row.case)).unwrap_or_default();
    let _infallible = writeln!(
        table,
        "  {:<32} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "method", "rms", "own rms", "wrong %", "hit %", "false %", "g bias %", "faces %", "ns/voxel"
    );
    for StudyRow { row, faces_kept } in rows {
        let length = |figure: Option<f64>| figure.map_or("-".into(), short_number);
        let percent = |figure: Option<f64>| figure.map_or("-".into(), |share| format!("{:.2}", 100.0 * share));
        let near = &row.figures.near;
        let _infallible = writeln!(
            table,
            "  {:<32} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8.0}",
            row.method,
            length(near.rms),
            length(row.figures.own_rms),
            percent(near.wrong_share),
            percent(near.hit_rate),
            percent(row.figures.false_share),
            percent(near.gradient_bias),
            percent(*faces_kept),
            1e9 * row.seconds_per_voxel
        );
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::{Case, Figures, Found, Row};
    use crate::phantom::Phantom;

    #[test]
    fn every_line_has_a_cell_for_every_column() {
        let near = Found { voxels: 10, hit_rate: Some(0.5), rms: Some(0.25), ..Found::default() };
        let row = Row {
            case: Case { noise: 0.01, ..Case::base(Phantom::SlabPair, 64) },
            method: "central2, gaussian-value 1.5".into(),
            chosen: "central2+linear, smoothing gaussian-value 1.5".into(),
            seconds_per_voxel: 1e-7,
            figures: Figures { near, own_rms: Some(0.125), ..Figures::default() },
        };
        let rows = [StudyRow { row, faces_kept: Some(0.75) }];
        let table = study_csv(&rows);
        let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        assert!(lines.len() == 2 && lines.iter().all(|cells| cells.len() == COLUMNS.len()), "{table}");
        let cell = |name: &str| lines[1][lines[0].iter().position(|column| *column == name).expect(name)];
        assert_eq!([cell("kernel"), cell("placement")], ["central2", "gaussian-value 1.5"]);
        assert_eq!([cell("distance_rms [voxel]"), cell("distance_rms_to_own_crossing [voxel]")], ["0.25", "0.125"]);
        assert_eq!([cell("faces_kept"), cell("false_share"), cell("noise [step]")], ["0.75", "", "0.01"]);
        let text = study_table(&rows);
        assert!(text.starts_with("slab-pair 4 voxels thick, 64³") && text.contains(" 75.00 "), "{text}");
    }
}
