//! How opaque a voxel is by its distance to the boundary: the settings of αd(d), alike on both sides or not.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{ParseError, parse_number};

/// The shape of αd; names and equation numbers as in the paper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EmphasisKind {
    /// Eq. (7), `a (1 − d/d_c)`.
    Linear,
    /// Eq. (8), `a (1 − d/d_c)ⁿ`: thin boundaries.
    #[default]
    Concave,
    /// Eq. (9), `a (1 − (d/d_c)ⁿ)`: thick, opaque ones.
    Convex,
}

impl EmphasisKind {
    /// All of them, in the paper's order.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Concave, Self::Convex];

    /// The kind's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Concave => "concave",
            Self::Convex => "convex",
        }
    }
}

/// αd(d): opacity by distance to the boundary, zero from `d_c` on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryEmphasis {
    /// Its shape.
    pub kind: EmphasisKind,
    /// Opacity on the boundary itself, 0 to 1.
    pub a: f32,
    /// Distance from which on nothing is drawn, in multiples of `L_min`; positive, useful up to the file's `d_max`.
    pub d_c: f32,
    /// Exponent, at least 1; the linear kind has none.
    pub n: f32,
}

impl Default for BoundaryEmphasis {
    /// Concave, a = 1, three voxels wide, n = 3: a thin opaque boundary in a faint haze.
    fn default() -> Self {
        Self { kind: EmphasisKind::Concave, a: 1.0, d_c: 3.0, n: 3.0 }
    }
}

impl BoundaryEmphasis {
    /// The five settings of the paper's figure 9, with names; `d_max` in multiples of `L_min`.
    #[must_use]
    pub fn figure_9(d_max: f32) -> [(&'static str, Self); 5] {
        let preset = |kind, a, n| Self { kind, a, d_c: d_max, n };
        [
            ("linear, a = 0.1", preset(EmphasisKind::Linear, 0.1, 1.0)),
            ("convex, n = 3", preset(EmphasisKind::Convex, 1.0, 3.0)),
            ("concave, n = 3", preset(EmphasisKind::Concave, 1.0, 3.0)),
            ("concave, n = 5", preset(EmphasisKind::Concave, 1.0, 5.0)),
            ("concave, n = 7", preset(EmphasisKind::Concave, 1.0, 7.0)),
        ]
    }
}

impl FromStr for BoundaryEmphasis {
    type Err = ParseError;

    /// `KIND,a,dc[,n]`, `dc` in multiples of `L_min`.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let (kind, a, d_c, n) = match parts.as_slice() {
            [kind, a, d_c] => (kind, a, d_c, "1"),
            [kind, a, d_c, n] => (kind, a, d_c, *n),
            _ => return Err(ParseError(format!("`{text}` is not KIND,a,dc,n such as concave,1,3,3"))),
        };
        let kind = EmphasisKind::ALL.into_iter().find(|candidate| candidate.name() == *kind).ok_or_else(|| {
            ParseError(format!("kind `{kind}` is none of {}", EmphasisKind::ALL.map(EmphasisKind::name).join(", ")))
        })?;
        let emphasis = Self { kind, a: parse_number(a, "a")?, d_c: parse_number(d_c, "dc")?, n: parse_number(n, "n")? };
        let check = |good: bool, message: String| if good { Ok(()) } else { Err(ParseError(message)) };
        check((0.0..=1.0).contains(&emphasis.a), format!("a = {} is not between 0 and 1", emphasis.a))?;
        check(emphasis.d_c > 0.0, format!("dc = {} is not positive", emphasis.d_c))?;
        check((1.0..=100.0).contains(&emphasis.n), format!("n = {} is not between 1 and 100", emphasis.n))?;
        Ok(emphasis)
    }
}

impl fmt::Display for BoundaryEmphasis {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{},{},{}", self.kind.name(), self.a, self.d_c, self.n)
    }
}

/// αd on the two sides of a boundary, which signed distances tell apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct TwoSidedEmphasis {
    /// Where values are higher and distances positive, and on the boundary itself.
    pub high: BoundaryEmphasis,
    /// Where values are lower and distances negative.
    pub low: BoundaryEmphasis,
}

impl TwoSidedEmphasis {
    /// The side of a signed distance.
    #[must_use]
    pub fn side(&self, distance: f32) -> &BoundaryEmphasis {
        if distance < 0.0 { &self.low } else { &self.high }
    }
}

impl From<BoundaryEmphasis> for TwoSidedEmphasis {
    /// Both sides alike.
    fn from(emphasis: BoundaryEmphasis) -> Self {
        Self { high: emphasis, low: emphasis }
    }
}

impl FromStr for TwoSidedEmphasis {
    type Err = ParseError;

    /// One αd for both sides, or `HIGH/LOW`.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        match text.split_once('/') {
            Some((high, low)) => Ok(Self { high: high.parse()?, low: low.parse()? }),
            None => text.parse::<BoundaryEmphasis>().map(Self::from),
        }
    }
}

impl fmt::Display for TwoSidedEmphasis {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { high, low } = self;
        if high == low { write!(formatter, "{high}") } else { write!(formatter, "{high}/{low}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_forms_are_understood() {
        let emphasis = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 0.5, d_c: 2.5, n: 4.0 };
        assert_eq!("convex, 0.5,2.5,4".parse(), Ok(emphasis));
        assert_eq!(emphasis.to_string().parse(), Ok(emphasis));
        assert_eq!("linear,0.1,15".parse::<BoundaryEmphasis>().expect("no n is needed").n, 1.0);
        for wrong in
            ["", "concave", "cubic,1,3,3", "concave,1.1,3,3", "concave,1,0,3", "concave,1,3,0.5", "concave,1,x,3"]
        {
            assert!(wrong.parse::<BoundaryEmphasis>().is_err(), "{wrong}");
            assert!(format!("concave,1,3,3/{wrong}").parse::<TwoSidedEmphasis>().is_err(), "{wrong}");
        }
        for text in ["convex,0.5,2.5,4", "convex,0.5,2.5,4/linear,0.1,15,1"] {
            assert_eq!(text.parse::<TwoSidedEmphasis>().expect("is understood").to_string(), text);
        }
    }
}
