//! The axes of an NRRD header: which three are space, and where they lie.

use super::header::Fields;
use super::pick::{self, AxisRole, Picks};
use super::placement::{FileFrame, Placement};
use super::read_options::ReadOptions;
use crate::Result;

/// Most axes that teem lets an NRRD file have.
const MAX_AXES: usize = 16;
/// Relative difference between `spacings` and `space directions` that is rounding.
const AGREEMENT: f64 = 1e-3;

/// What a header says of its axes, in the order of the file.
struct Axes<'f> {
    fields: &'f Fields<'f>,
    space: Space,
    sizes: Vec<u64>,
    /// World step along each axis, where the header has `space directions`; `None` for an axis that is not space.
    directions: Option<Vec<Option<[f64; 3]>>>,
    spacings: Option<Vec<f64>>,
    minima: Option<Vec<f64>>,
    maxima: Option<Vec<f64>>,
    kinds: Option<Vec<String>>,
    /// Whether an axis' minimum and maximum are at voxel centres (`node`) and not at their outer faces (`cell`).
    centers: Option<Vec<String>>,
}

/// Placement of the three spatial axes, and the place chosen along further ones of more than one sample.
///
/// # Errors
/// [`crate::Error::Format`] naming the field, what was expected and what was found.
pub(super) fn placement(fields: &Fields<'_>, options: &ReadOptions) -> Result<(Placement, Picks)> {
    let axes = Axes::new(fields)?;
    let (spatial, picks) = axes.spatial(options)?;
    let dims = fields.dims("sizes", spatial.map(|axis| axes.sizes[axis]))?;
    let frame = axes.space.frame;
    let mut placement = match &axes.directions {
        Some(directions) => {
            let placement = Placement::axis_aligned(dims, [1.0; 3]).with_steps(axes.steps(directions, spatial)?);
            axes.check_agreement(spatial, placement.spacing)?;
            Placement { frame, ..placement }
        }
        None => {
            let mut spacing = [1.0; 3];
            for (spacing, axis) in spacing.iter_mut().zip(spatial) {
                *spacing = axes.spacing(axis)?;
            }
            let origin = [0, 1, 2].map(|index| axes.first_center(spatial[index], spacing[index]));
            Placement { origin, ..Placement::axis_aligned(dims, spacing) }
        }
    };
    if let Some(text) = fields.get(&["space origin"]) {
        placement.origin = match vectors(text).as_deref() {
            // That of time is of no use to one volume.
            Some([Some(origin)]) if origin.len() == axes.space.dimension => [origin[0], origin[1], origin[2]],
            _ => return Err(fields.unexpected("space origin", axes.space.vector(), text)),
        };
    }
    placement.unit = axes.unit(spatial)?;
    Ok((placement, picks))
}

impl<'f> Axes<'f> {
    fn new(fields: &'f Fields<'f>) -> Result<Self> {
        let count: usize = match fields.number("dimension")? {
            Some(count) if (1..=MAX_AXES).contains(&count) => count,
            other => {
                let found = other.map_or("no such field".into(), |count| count.to_string());
                return Err(fields.unexpected("dimension", "a count from 1 to 16", &found));
            }
        };
        let counted = |name: &str, found: usize| {
            if found == count {
                Ok(())
            } else {
                Err(fields.unexpected(name, &format!("{count} entries"), &format!("{found} entries")))
            }
        };
        let numbers = |name: &str| -> Result<Option<Vec<f64>>> {
            let Some(text) = fields.get(&[name]) else { return Ok(None) };
            let numbers = fields.numbers(name, text)?;
            counted(name, numbers.len())?;
            Ok(Some(numbers))
        };
        let words = |names: &[&str]| -> Result<Option<Vec<String>>> {
            let Some(text) = fields.get(names) else { return Ok(None) };
            let words: Vec<_> = text.split_whitespace().map(str::to_lowercase).collect();
            counted(names[0], words.len())?;
            Ok(Some(words))
        };
        let sizes = fields.numbers("sizes", fields.required("sizes")?)?;
        counted("sizes", sizes.len())?;
        let directions = fields.get(&["space directions"]);
        let space = Space::new(fields, directions.is_some())?;
        let directions = match directions {
            None => None,
            Some(text) => {
                let expected = format!("a vector {} or none for each axis", space.vector());
                let unexpected = || fields.unexpected("space directions", &expected, text);
                let vectors = vectors(text).ok_or_else(unexpected)?;
                counted("space directions", vectors.len())?;
                let steps = vectors.iter().map(|vector| space.step(vector.as_deref())).collect::<Option<Vec<_>>>();
                Some(steps.ok_or_else(unexpected)?)
            }
        };
        Ok(Self {
            fields,
            space,
            sizes,
            directions,
            spacings: numbers("spacings")?,
            minima: numbers("axis mins")?,
            maxima: numbers("axis maxs")?,
            kinds: words(&["kinds"])?,
            centers: words(&["centers", "centerings"])?,
        })
    }

    /// Whether the header calls `axis` one of space.
    fn may_be_spatial(&self, axis: usize) -> bool {
        let kind = self.kinds.as_ref().map_or("domain", |kinds| kinds[axis].as_str());
        let has_direction = self.directions.as_ref().is_none_or(|directions| directions[axis].is_some());
        has_direction && matches!(kind, "domain" | "space" | "none" | "???")
    }

    /// What the header calls `axis`.
    fn role(&self, axis: usize) -> AxisRole {
        let kind = self.kinds.as_ref().map_or("none", |kinds| kinds[axis].as_str());
        match kind {
            _ if self.may_be_spatial(axis) => AxisRole::Space,
            "time" => AxisRole::Time,
            "domain" | "space" | "list" | "none" | "???" => AxisRole::Other,
            _ => AxisRole::Component,
        }
    }

    /// The three axes of space, fastest first, and the place chosen along the others. Axes of one sample are left out until
    /// three remain: first those that the header does not call space, then the slowest.
    fn spatial(&self, options: &ReadOptions) -> Result<([usize; 3], Picks)> {
        let mut kept: Vec<usize> = (0..self.sizes.len()).collect();
        while kept.len() > 3 {
            let single = |&axis: &usize| self.sizes[axis] == 1;
            let foreign = kept.iter().rposition(|axis| single(axis) && !self.may_be_spatial(*axis));
            let Some(index) = foreign.or_else(|| kept.iter().rposition(single)) else { break };
            kept.remove(index);
        }
        let found = format!("{:?}", self.sizes);
        if kept.len() < 3 {
            return Err(self.fields.unexpected("sizes", "the three axes of a volume", &found));
        }
        let fail = |message| self.fields.fail(format!("sizes: {message}"));
        let mut roles: Vec<_> = kept.iter().map(|&axis| (self.sizes[axis], self.role(axis))).collect();
        if kept.len() > 3 && roles.iter().all(|axis| axis.1 == AxisRole::Space) {
            let sizes: Vec<u64> = roles.iter().map(|axis| axis.0).collect();
            roles = pick::roles(&sizes, options).map_err(fail)?;
        }
        let spatial: Vec<usize> =
            kept.iter().zip(&roles).filter(|(_, role)| role.1 == AxisRole::Space).map(|(axis, _)| *axis).collect();
        let spatial = <[usize; 3]>::try_from(spatial).map_err(|_| {
            let expected = "three axes of space, and others of components or time (take them apart first, for example with \
                            `unu slice`)";
            self.fields.unexpected("sizes", expected, &found)
        })?;
        self.fields.dims("sizes", spatial.map(|axis| self.sizes[axis]))?;
        Ok((spatial, pick::choose(&roles, options).map_err(fail)?))
    }

    fn steps(&self, directions: &[Option<[f64; 3]>], spatial: [usize; 3]) -> Result<[[f64; 3]; 3]> {
        let mut steps = [[0.0; 3]; 3];
        for (step, axis) in steps.iter_mut().zip(spatial) {
            let found = directions[axis].filter(|vector| vector.iter().all(|component| component.is_finite()));
            *step = found.ok_or_else(|| {
                let text = format!("{:?}", directions[axis]);
                self.fields.unexpected("space directions", "finite numbers", &text)
            })?;
        }
        Ok(steps)
    }

    /// NRRD forbids giving both; some writers do so all the same, and then they must say the same.
    fn check_agreement(&self, spatial: [usize; 3], from_directions: [f64; 3]) -> Result<()> {
        let Some(spacings) = &self.spacings else { return Ok(()) };
        for (axis, length) in spatial.into_iter().zip(from_directions) {
            let spacing = spacings[axis];
            if (spacing - length).abs() > AGREEMENT * length {
                let expected = format!("{length}, the length of axis {axis} in `space directions`");
                return Err(self.fields.unexpected("spacings", &expected, &spacing.to_string()));
            }
        }
        Ok(())
    }

    /// From `spacings`, or else from the axis' range, or else 1.
    fn spacing(&self, axis: usize) -> Result<f64> {
        let spacing = self.spacings.as_ref().map(|spacings| spacings[axis]);
        let range = self.minima.as_ref().zip(self.maxima.as_ref()).map(|(low, high)| high[axis] - low[axis]);
        match (spacing, range) {
            (Some(spacing), _) if !spacing.is_nan() => Ok(spacing),
            (_, Some(range)) if range.is_finite() && self.sizes[axis] > u64::from(self.is_node(axis)) => {
                Ok(range / (self.sizes[axis] - u64::from(self.is_node(axis))) as f64)
            }
            (None, _) => Ok(1.0),
            // An axis of one sample has no spacing to give.
            _ if self.sizes[axis] == 1 => Ok(1.0),
            _ => Err(self.fields.unexpected("spacings", "a positive length", "nan")),
        }
    }

    /// `node` for certain; teem takes axes that say nothing for `cell`.
    fn is_node(&self, axis: usize) -> bool {
        self.centers.as_ref().is_some_and(|centers| centers[axis] == "node")
    }

    /// Position of the first voxel's centre along its own axis.
    fn first_center(&self, axis: usize, spacing: f64) -> f64 {
        let minimum = self.minima.as_ref().map(|minima| minima[axis]).filter(|minimum| !minimum.is_nan());
        minimum.map_or(0.0, |minimum| if self.is_node(axis) { minimum } else { minimum + spacing / 2.0 })
    }

    /// The one unit of all three axes, or nothing.
    fn unit(&self, spatial: [usize; 3]) -> Result<String> {
        let (name, wanted) = match self.directions {
            Some(_) => ("space units", [0, 1, 2]),
            None => ("units", spatial),
        };
        let Some(text) = self.fields.get(&[name]) else { return Ok(String::new()) };
        let count = if self.directions.is_some() { self.space.dimension } else { self.sizes.len() };
        let units = quoted(text)
            .filter(|units| units.len() == count)
            .ok_or_else(|| self.fields.unexpected(name, &format!("{count} units in double quotes"), text))?;
        let mut named = wanted.map(|axis| units[axis].as_str()).into_iter().filter(|unit| !unit.is_empty());
        let unit = named.next().unwrap_or_default();
        match named.find(|other| *other != unit) {
            None => Ok(unit.to_owned()),
            Some(_) => Err(self.fields.unexpected(name, "the same unit on all three axes", text)),
        }
    }
}

/// The world that `space directions` and `space origin` are in.
#[derive(Clone, Copy, Debug)]
struct Space {
    /// What the world axes mean.
    frame: FileFrame,
    /// 3, or 4 with time behind the others.
    dimension: usize,
}

impl Space {
    /// Directions without a space that names them, or at least counts them, are refused, as teem does.
    fn new(fields: &Fields<'_>, has_directions: bool) -> Result<Self> {
        let space = |dimension, frame| Ok(Self { frame, dimension });
        let given = fields.get(&["space"]);
        let name = given.map(str::to_lowercase);
        match name.as_deref() {
            Some("right-anterior-superior" | "ras") => space(3, FileFrame::RightAnteriorSuperior),
            Some("left-anterior-superior" | "las") => space(3, FileFrame::LeftAnteriorSuperior),
            Some("left-posterior-superior" | "lps") => space(3, FileFrame::LeftPosteriorSuperior),
            Some("scanner-xyz" | "3d-right-handed" | "3d-left-handed") => space(3, FileFrame::Unspecified),
            Some("right-anterior-superior-time" | "rast") => space(4, FileFrame::RightAnteriorSuperior),
            Some("left-anterior-superior-time" | "last") => space(4, FileFrame::LeftAnteriorSuperior),
            Some("left-posterior-superior-time" | "lpst") => space(4, FileFrame::LeftPosteriorSuperior),
            Some("scanner-xyz-time" | "3d-right-handed-time" | "3d-left-handed-time") => {
                space(4, FileFrame::Unspecified)
            }
            Some(_) => Err(fields.unexpected("space", "a space of three dimensions", given.unwrap_or_default())),
            None => match fields.get(&["space dimension"]) {
                Some("3") => space(3, FileFrame::Unspecified),
                Some("4") => space(4, FileFrame::Unspecified),
                None if !has_directions => space(3, FileFrame::Unspecified),
                Some("2") => Err(fields.unexpected(
                    "space dimension",
                    "3, or 4 with time (join pictures to a volume first, for example with `unu join`)",
                    "2",
                )),
                other => {
                    let found = other.unwrap_or("no such field, and no `space`");
                    Err(fields.unexpected("space dimension", "3, or 4 with time", found))
                }
            },
        }
    }

    /// How a vector is written.
    fn vector(self) -> &'static str {
        if self.dimension == 4 { "(x,y,z,0) or (0,0,0,t)" } else { "(x,y,z)" }
    }

    /// The step in space along an axis, which is none along that of time; `None` for a vector that is of both or of another
    /// length.
    fn step(self, vector: Option<&[f64]>) -> Option<Option<[f64; 3]>> {
        match vector {
            None => Some(None),
            Some(&[x, y, z]) if self.dimension == 3 => Some(Some([x, y, z])),
            Some(&[x, y, z, 0.0]) if self.dimension == 4 => Some(Some([x, y, z])),
            Some(&[0.0, 0.0, 0.0, _]) if self.dimension == 4 => Some(None),
            Some(_) => None,
        }
    }
}

/// `(x,y,z) none …`, or `None` if it is anything else.
fn vectors(text: &str) -> Option<Vec<Option<Vec<f64>>>> {
    let mut vectors = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        let (vector, after) = match rest.strip_prefix('(') {
            Some(inner) => {
                let (inner, after) = inner.split_once(')')?;
                let components: Option<Vec<f64>> = inner.split(',').map(|word| word.trim().parse().ok()).collect();
                (Some(components?), after)
            }
            None => (None, rest.strip_prefix("none")?),
        };
        vectors.push(vector);
        rest = after.trim_start();
    }
    Some(vectors)
}

/// `"mm" "mm" …`, or `None` if it is anything else.
fn quoted(text: &str) -> Option<Vec<String>> {
    let mut words = Vec::new();
    let mut characters = text.chars();
    while let Some(character) = characters.next() {
        if character.is_whitespace() {
            continue;
        }
        if character != '"' {
            return None;
        }
        let mut word = String::new();
        loop {
            match characters.next()? {
                '"' => break,
                '\\' => word.push(characters.next()?),
                other => word.push(other),
            }
        }
        words.push(word);
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn placed(lines: &[&str]) -> Result<Placement> {
        placed_with(lines, &ReadOptions::default())
    }

    fn placed_with(lines: &[&str], options: &ReadOptions) -> Result<Placement> {
        let mut fields = Fields::new(Path::new("a.nrrd"));
        for line in lines {
            let (name, value) = line.split_once(':').expect("a field");
            fields.insert(name, value).expect("once each");
        }
        Ok(placement(&fields, options)?.0)
    }

    #[test]
    fn single_sample_axes_are_left_out() {
        for (dimension, sizes) in
            [("3", "4 5 6"), ("4", "4 5 6 1"), ("4", "1 4 5 6"), ("5", "1 4 5 1 6"), ("4", "4 1 5 6")]
        {
            let dimension = format!("dimension: {dimension}");
            let placement = placed(&[&dimension, &format!("sizes: {sizes}")]).expect(sizes);
            assert_eq!(placement.dims, [4, 5, 6], "{sizes}");
        }
        // The header says which of the two single samples is no space.
        let placement = placed(&[
            "dimension: 4",
            "sizes: 1 4 5 1",
            "space dimension: 3",
            "space directions: none (1,0,0) (0,2,0) (0,0,3)",
        ]);
        let placement = placement.expect("a slice");
        assert_eq!((placement.dims, placement.spacing), ([4, 5, 1], [1.0, 2.0, 3.0]));
    }

    #[test]
    fn several_numbers_per_voxel_are_refused() {
        for lines in [
            ["dimension: 4", "sizes: 3 4 5 6", "kinds: vector domain domain domain"],
            ["dimension: 3", "sizes: 3 4 5", "kinds: RGB-color domain domain"],
            ["dimension: 3", "sizes: 3 4 5", "kinds: domain domain time"],
            ["dimension: 2", "sizes: 3 4", "kinds: domain domain"],
        ] {
            let message = placed(&lines).expect_err("not a volume").to_string();
            assert!(message.contains("a.nrrd") && message.contains("expected"), "{message}");
        }
    }

    #[test]
    fn axis_ranges_give_spacing_and_origin() {
        let lines =
            ["dimension: 3", "sizes: 4 5 6", "axis mins: 0 10 nan", "axis maxs: 8 18 nan", "centers: cell node cell"];
        let placement = placed(&lines).expect("ranges");
        // Cells: 8/4, first centre half a cell in. Nodes: 8/(5 − 1), first centre at the minimum.
        assert_eq!((placement.spacing, placement.origin), ([2.0, 2.0, 1.0], [1.0, 10.0, 0.0]));
    }

    #[test]
    fn contradicting_spacings_are_refused() {
        let lines = |spacings| {
            ["dimension: 3", "sizes: 4 5 6", "space: LPS", "space directions: (0,2,0) (3,0,0) (0,0,4)", spacings]
        };
        assert!(placed(&lines("spacings: 2 3 4")).is_ok());
        assert!(placed(&lines("spacings: nan nan nan")).is_ok());
        let message = placed(&lines("spacings: 2 3 4.1")).expect_err("contradiction").to_string();
        assert!(message.contains("spacings: expected 4") && message.contains("found \"4.1\""), "{message}");
    }

    #[test]
    fn time_may_be_a_fourth_dimension() {
        fn lines(directions: &str) -> [&str; 6] {
            let origin = "space origin: (7,8,9,10)";
            [
                "dimension: 4",
                "sizes: 3 4 5 2",
                "space dimension: 4",
                directions,
                origin,
                "kinds: domain domain domain domain",
            ]
        }
        let options = ReadOptions { time: Some(1), ..ReadOptions::default() };
        let found = placed_with(&lines("space directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,2.5)"), &options);
        let found = found.expect("a point of time");
        assert_eq!((found.dims, found.spacing, found.origin), ([3, 4, 5], [1.0, 2.0, 3.0], [7.0, 8.0, 9.0]));
        let several = placed(&lines("space directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,2.5)"));
        assert!(several.expect_err("two volumes").to_string().contains("--time N, N from 0 to 1"));
        for bad in ["(1,0,0,1) (0,2,0,0) (0,0,3,0) (0,0,0,1)", "(1,0,0) (0,2,0) (0,0,3) none"] {
            let bad = format!("space directions: {bad}");
            let message = placed_with(&lines(&bad), &options).expect_err(&bad).to_string();
            assert!(message.contains("space directions: expected a vector (x,y,z,0) or (0,0,0,t)"), "{message}");
        }
        let picture = ["dimension: 2", "sizes: 3 4", "space dimension: 2", "space directions: (1,0) (0,1)"];
        let message = placed(&picture).expect_err("a picture").to_string();
        assert!(message.contains("space dimension: expected 3") && message.contains("unu join"), "{message}");
    }

    #[test]
    fn lists_are_parsed() {
        let expected = vec![Some(vec![1.0, 2.0, 3.0]), None, Some(vec![4.0, 5.0])];
        assert_eq!(vectors("(1, 2,3) none(4,5)"), Some(expected));
        for bad in ["(1,2,3", "1,2,3", "(1,2,x)", "nothing"] {
            assert_eq!(vectors(bad), None, "{bad}");
        }
        assert_eq!(quoted(r#""mm" "a \"b\"" """#), Some(vec!["mm".into(), "a \"b\"".into(), String::new()]));
        assert_eq!(quoted("mm mm mm"), None);
        assert_eq!(quoted("\"mm"), None);
    }
}
