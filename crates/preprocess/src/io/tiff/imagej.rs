//! ImageJ's description of a stack: lines of `name=value`.

use std::collections::BTreeMap;

/// The fields of a description.
pub struct Description<'a> {
    fields: BTreeMap<&'a str, &'a str>,
}

impl<'a> Description<'a> {
    /// The fields, if `text` is ImageJ's.
    pub fn parse(text: &'a str) -> Option<Self> {
        if !text.starts_with("ImageJ=") {
            return None;
        }
        Some(Self { fields: text.lines().filter_map(|line| line.trim_end().split_once('=')).collect() })
    }

    /// A count of planes; `default` where there is none.
    pub fn count(&self, name: &str, default: usize) -> Option<usize> {
        match self.fields.get(name) {
            None => Some(default),
            Some(text) => text.trim().parse().ok().filter(|&count| count > 0),
        }
    }

    /// A finite number.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.fields.get(name)?.trim().parse().ok().filter(|number: &f64| number.is_finite())
    }

    /// The unit of length, whose letters outside ASCII may be written as `\u` and four hexadecimal digits.
    pub fn unit(&self) -> String {
        let unit = self.fields.get("unit").map_or("", |unit| unit.trim());
        match unit.to_ascii_lowercase().as_str() {
            "\\u00b5m" | "\\u03bcm" => "\u{b5}m".into(),
            // What ImageJ calls an image without calibration.
            "pixel" | "pixels" => String::new(),
            _ => unit.into(),
        }
    }

    /// Slope and intercept of a straight calibration function, as signed 16-bit numbers have.
    pub fn calibration(&self) -> Option<(f64, f64)> {
        (self.number("cf")? == 0.0).then_some(())?;
        Some((self.number("c1")?, self.number("c0")?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_as_written() {
        let text = "ImageJ=1.53c\nimages=6\nslices=3\r\nchannels=2\nunit=\\u00B5m\nspacing=3.5\ncf=0\nc0=-32768.0\nc1=1.0\nloop=false\n";
        let description = Description::parse(text).expect("ImageJ's");
        assert_eq!(description.count("slices", 1), Some(3));
        assert_eq!(description.count("frames", 1), Some(1));
        assert_eq!(description.number("spacing"), Some(3.5));
        assert_eq!(description.unit(), "µm");
        assert_eq!(description.calibration(), Some((1.0, -32768.0)));
        assert!(Description::parse("OME").is_none());
        let bad = Description::parse("ImageJ=1\nslices=0\nframes=-1\nspacing=inf").expect("ImageJ's");
        assert_eq!((bad.count("slices", 1), bad.count("frames", 1), bad.number("spacing")), (None, None, None));
    }
}
