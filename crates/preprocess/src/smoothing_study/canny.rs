//! Figures of Canny's edge detector, read from a table.

use crate::accuracy::Case;
use crate::phantom::Phantom;
use crate::{Error, Result};

/// What was measured of Canny's detector on one case: it marks voxels, without place in between nor distance.
#[derive(Clone, Debug, PartialEq)]
pub struct CannyRow {
    /// The case.
    pub case: Case,
    /// Standard deviation of its Gaussian in voxels.
    pub sigma: f64,
    /// Marked voxels at least four voxels from the volume's border.
    pub edge_voxels: f64,
    /// Those of them within two blurs of a true surface.
    pub near_voxels: f64,
    /// Root mean square distance of the latter along the gradient to the formula's crossing, in voxels.
    pub crossing_rms: Option<f64>,
    /// Share of the marked voxels that are more than a voxel from every true surface.
    pub false_share: Option<f64>,
    /// Of the voxels on each true face, the share with a marked voxel within one voxel; the smallest of all faces.
    pub faces_kept: Option<f64>,
}

/// Reads the table that `tests/peers/canny.py` writes: comma-separated values under a header, columns in any order, others
/// ignored.
///
/// # Errors
/// [`Error::Parameter`], naming line and column of what is missing or no number.
pub fn parse_canny(text: &str) -> Result<Vec<CannyRow>> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let Some((_, header)) = lines.next() else {
        return Err(Error::Parameter("the table is empty: it should begin with a line that names its columns".into()));
    };
    let header: Vec<&str> = header.split(',').map(str::trim).collect();
    lines
        .map(|(index, line)| row(&Cells { header: &header, line: index + 1, cells: line.split(',').collect() }))
        .collect()
}

fn row(cells: &Cells<'_>) -> Result<CannyRow> {
    let name = cells.text("phantom")?;
    let phantom = Phantom::from_name(name).ok_or_else(|| {
        Error::Parameter(format!("line {}: there is no phantom {name}: see voxrole phantom --list", cells.line))
    })?;
    let edge = cells.number("edge [voxel]")?;
    if !(edge.fract() == 0.0 && (1.0..=65536.0).contains(&edge)) {
        return Err(Error::Parameter(format!("line {}: an edge of {edge} voxels: give a whole number", cells.line)));
    }
    let case = Case {
        blur: cells.number("blur [voxel]")?,
        thickness: cells.number("thickness [voxel]")?,
        noise: cells.number("noise [step]")?,
        ..Case::base(phantom, edge as u32)
    };
    Ok(CannyRow {
        case,
        sigma: cells.number("sigma [voxel]")?,
        edge_voxels: cells.number("edge_voxels")?,
        near_voxels: cells.number("near_voxels")?,
        crossing_rms: cells.number_or_none("distance_rms [voxel]")?,
        false_share: cells.number_or_none("false_share")?,
        faces_kept: cells.number_or_none("faces_kept")?,
    })
}

struct Cells<'a> {
    header: &'a [&'a str],
    /// Counted from 1.
    line: usize,
    cells: Vec<&'a str>,
}

impl<'a> Cells<'a> {
    fn text(&self, column: &str) -> Result<&'a str> {
        let place = self.header.iter().position(|name| *name == column);
        place.and_then(|place| self.cells.get(place)).map(|cell| cell.trim()).ok_or_else(|| {
            Error::Parameter(format!(
                "line {}: no column \"{column}\": is this a table of tests/peers/canny.py?",
                self.line
            ))
        })
    }

    fn number(&self, column: &str) -> Result<f64> {
        self.number_or_none(column)?
            .ok_or_else(|| Error::Parameter(format!("line {}: column \"{column}\" is empty", self.line)))
    }

    fn number_or_none(&self, column: &str) -> Result<Option<f64>> {
        let text = self.text(column)?;
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Some(number)),
            _ => Err(Error::Parameter(format!("line {}: column \"{column}\": {text} is no number", self.line))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "phantom,edge [voxel],blur [voxel],thickness [voxel],noise [step],sigma [voxel],edge_voxels,\
                          near_voxels,distance_rms [voxel],false_share,faces_kept";

    #[test]
    fn a_table_is_read_by_the_names_of_its_columns() {
        let rows =
            parse_canny(&format!("{HEADER}\nslab-pair,64,1,3,0.01,1.5,900,800,0.4,0.1,0.75\n\n")).expect("a table");
        let case = Case { blur: 1.0, thickness: 3.0, noise: 0.01, ..Case::base(Phantom::SlabPair, 64) };
        let [crossing_rms, false_share, faces_kept] = [0.4, 0.1, 0.75].map(Some);
        let expected = CannyRow {
            case,
            sigma: 1.5,
            edge_voxels: 900.0,
            near_voxels: 800.0,
            crossing_rms,
            false_share,
            faces_kept,
        };
        assert_eq!(rows, [expected]);
        let without = parse_canny(&format!("{HEADER}\nball,64,1.5,4,0,1,0,0,,,")).expect("a table");
        assert_eq!((without[0].crossing_rms, without[0].faces_kept), (None, None));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let message = |text: &str| parse_canny(text).expect_err("no table").to_string();
        assert!(message("").contains("empty"));
        assert!(message("a,b\n1,2").contains("line 2: no column \"phantom\""));
        assert!(message(&format!("{HEADER}\ncone,64,1,3,0,1,9,8,0.4,0.1,0.7")).contains("no phantom cone"));
        assert!(message(&format!("{HEADER}\nball,6.5,1,3,0,1,9,8,0.4,0.1,0.7")).contains("whole number"));
        assert!(message(&format!("{HEADER}\nball,64,1,3,inf,1,9,8,0.4,0.1,0.7")).contains("inf is no number"));
        assert!(message(&format!("{HEADER}\nball,64,1,3,0,1,9,8")).contains("distance_rms"));
    }
}
