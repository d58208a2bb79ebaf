//! Measurements as a table of comma-separated values and as one for the eye.

use std::fmt::Write;

use super::pareto::members;
use super::{Case, Row};
use crate::plot::numbers::short_number;

/// A column of the table: its name with its unit, and what stands in it.
type Column = (&'static str, fn(&Row) -> String);

/// Lengths are in voxels (multiples of the smallest spacing), shares and rates from 0 to 1, gradient errors relative.
const COLUMNS: [Column; 34] = [
    ("phantom", |row| row.case.phantom.name().to_owned()),
    ("edge [voxel]", |row| row.case.edge.to_string()),
    ("blur [voxel]", |row| row.case.blur.to_string()),
    ("thickness [voxel]", |row| row.case.thickness.to_string()),
    ("noise [step]", |row| row.case.noise.to_string()),
    ("dtype", |row| row.case.dtype.name().to_owned()),
    ("method", |row| row.method.clone()),
    ("settings", |row| row.chosen.clone()),
    ("time [s / voxel]", |row| row.seconds_per_voxel.to_string()),
    ("voxels", |row| row.figures.near.voxels.to_string()),
    ("hit_rate", |row| number(row.figures.near.hit_rate)),
    ("distance_rms [voxel]", |row| number(row.figures.near.rms)),
    ("distance_p99 [voxel]", |row| number(row.figures.near.p99)),
    ("distance_max [voxel]", |row| number(row.figures.near.max)),
    ("distance_rms_to_surface [voxel]", |row| number(row.figures.surface_rms)),
    ("distance_rms_to_own_crossing [voxel]", |row| number(row.figures.own_rms)),
    ("wrong_share", |row| number(row.figures.near.wrong_share)),
    ("false_share", |row| number(row.figures.false_share)),
    ("weakest_boundary_rate", |row| number(row.figures.weakest_boundary)),
    ("gradient_bias", |row| number(row.figures.near.gradient_bias)),
    ("gradient_rms", |row| number(row.figures.near.gradient_rms)),
    ("border_voxels", |row| row.figures.border.voxels.to_string()),
    ("border_hit_rate", |row| number(row.figures.border.hit_rate)),
    ("border_distance_rms [voxel]", |row| number(row.figures.border.rms)),
    ("border_distance_max [voxel]", |row| number(row.figures.border.max)),
    ("border_wrong_share", |row| number(row.figures.border.wrong_share)),
    ("border_gradient_bias", |row| number(row.figures.border.gradient_bias)),
    ("border_false_share", |row| number(row.figures.border_false_share)),
    ("around_voxels", |row| row.figures.around.voxels.to_string()),
    ("around_hit_rate", |row| number(row.figures.around.hit_rate)),
    ("around_distance_rms [voxel]", |row| number(row.figures.around.rms)),
    ("around_distance_max [voxel]", |row| number(row.figures.around.max)),
    ("around_wrong_share", |row| number(row.figures.around.wrong_share)),
    ("around_gradient_bias", |row| number(row.figures.around.gradient_bias)),
];

/// All figures of all rows: one line a case and method under a header with units in brackets; a figure that could not be
/// counted is empty. `near` voxels, those within two blurs of the true surface, have no prefix.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    let line = |cells: Vec<String>| cells.join(",") + "\n";
    let header = line(COLUMNS.iter().map(|(name, _)| quoted((*name).to_owned())).collect());
    let body = rows.iter().map(|row| line(COLUMNS.iter().map(|(_, of)| quoted(of(row))).collect()));
    std::iter::once(header).chain(body).collect()
}

fn number(figure: Option<f64>) -> String {
    figure.map(|figure| figure.to_string()).unwrap_or_default()
}

fn quoted(cell: String) -> String {
    if cell.contains([',', '"']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell }
}

/// The rows of one case for the eye, the members of its Pareto front (rms error against time) marked by `*`.
#[must_use]
pub fn text_table(case: &Case, rows: &[Row]) -> String {
    let rows: Vec<&Row> = rows.iter().filter(|row| row.case == *case).collect();
    let width = rows.iter().map(|row| row.method.len()).max().unwrap_or(0).max(6);
    let mut table = format!("{case}\n");
    let _infallible = writeln!(
        table,
        "  {:<width$} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>9}",
        "method", "rms", "p99", "max", "hit %", "wrong %", "false %", "g bias %", "ns/voxel"
    );
    for (row, member) in rows.iter().zip(members(&rows)) {
        let near = &row.figures.near;
        let length = |figure: Option<f64>| figure.map_or("-".into(), short_number);
        let percent = |figure: Option<f64>| figure.map_or("-".into(), |share| format!("{:.3}", 100.0 * share));
        let _infallible = writeln!(
            table,
            "{} {:<width$} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>9.0}",
            if member { "*" } else { " " },
            row.method,
            length(near.rms),
            length(near.p99),
            length(near.max),
            percent(near.hit_rate),
            percent(near.wrong_share),
            percent(row.figures.false_share),
            percent(near.gradient_bias),
            1e9 * row.seconds_per_voxel
        );
    }
    table
}

#[cfg(test)]
mod tests {
    use super::super::{Figures, Found};
    use super::*;
    use crate::phantom::Phantom;

    fn row(method: &str, seconds_per_voxel: f64, rms: f64) -> Row {
        let near = Found { voxels: 10, hit_rate: Some(1.0), rms: Some(rms), ..Found::default() };
        Row {
            case: Case::base(Phantom::Torus, 64),
            method: method.into(),
            chosen: String::new(),
            seconds_per_voxel,
            figures: Figures { near, ..Figures::default() },
        }
    }

    #[test]
    fn tables_have_a_cell_for_every_column() {
        let table = csv(&[row("fast, root cubic", 1e-7, 0.25), row("accurate", 2e-7, 0.001)]);
        let lines: Vec<&str> = table.lines().collect();
        assert!(lines.len() == 3 && lines[0].starts_with("phantom,edge [voxel],blur [voxel],"), "{}", lines[0]);
        let begin = "torus,64,1.5,4,0,f32,\"fast, root cubic\",,0.0000001,10,1,0.25,,";
        assert!(lines[1].starts_with(begin), "{}", lines[1]);
        assert_eq!(lines[2].split(',').count(), COLUMNS.len());
    }

    #[test]
    fn members_of_the_front_are_marked() {
        let rows = [row("fast", 1e-7, 0.25), row("slow", 3e-7, 0.25), row("accurate", 2e-7, 0.001)];
        let table = text_table(&rows[0].case, &rows);
        let marks: Vec<bool> = table.lines().skip(2).map(|line| line.starts_with('*')).collect();
        assert_eq!(marks, [true, false, true]);
        assert!(table.lines().nth(2).is_some_and(|line| line.contains("0.25") && line.ends_with(" 100")), "{table}");
    }
}
