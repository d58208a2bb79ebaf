//! One scalar volume out of a file that holds several: numbers per voxel, points of time.

use std::ops::Range;

use super::read_options::ReadOptions;

/// What an axis of a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AxisRole {
    Space,
    Component,
    Time,
    /// No space, but the file does not say what.
    Other,
}

/// One place along an axis that is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pick {
    /// Numbers between neighbours along the axis.
    stride: u64,
    count: u64,
    index: u64,
}

/// The numbers of a file that belong to the volume; all of them by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Picks(Vec<Pick>);

/// Most numbers whose bytes can be counted.
const MOST_NUMBERS: u64 = u64::MAX / 16;

/// Picks the place that `options` choose along each axis that is not space, given the axes' sizes, fastest first.
///
/// # Errors
/// A message when there is something to choose and nothing chosen, or the other way round.
pub(super) fn choose(axes: &[(u64, AxisRole)], options: &ReadOptions) -> Result<Picks, String> {
    let (mut component, mut time) = (None, None);
    let mut stride = 1_u64;
    for &(size, role) in axes {
        let pick = Pick { stride, count: size, index: 0 };
        stride = size
            .checked_mul(stride)
            .filter(|numbers| (1..=MOST_NUMBERS).contains(numbers))
            .ok_or_else(|| format!("expected fewer numbers, found {}, more than a machine can address", shown(axes)))?;
        if role == AxisRole::Space || size == 1 {
            continue;
        }
        let has_time = axes.iter().any(|axis| axis.1 == AxisRole::Time && axis.0 > 1);
        let is_time = match role {
            AxisRole::Time => true,
            AxisRole::Other => {
                component.is_some() || (options.time.is_some() && options.component.is_none() && !has_time)
            }
            _ => false,
        };
        let place = if is_time { &mut time } else { &mut component };
        if place.replace((pick, role)).is_some() {
            return Err(format!("expected at most one axis of components and one of time, found {}", shown(axes)));
        }
    }
    let mut picks = Vec::new();
    for (found, chosen, option, what) in [
        (component, options.component, "--component", "numbers per voxel"),
        (time, options.time, "--time", "points of time"),
    ] {
        match (found, chosen) {
            (None, None) => {}
            (Some((pick, _)), Some(index)) if (index as u64) < pick.count => {
                picks.push(Pick { index: index as u64, ..pick });
            }
            (Some((Pick { count, .. }, role)), chosen) => {
                let options =
                    if role == AxisRole::Other { "--component N or --time N" } else { &format!("{option} N") };
                let found = chosen.map_or_else(|| format!("{count} {what}"), |index| format!("{option} {index}"));
                return Err(format!(
                    "expected one scalar volume, found {found} ({}): choose with {options}, N from 0 to {}",
                    shown(axes),
                    count - 1
                ));
            }
            (None, Some(index)) => {
                return Err(format!("expected several {what} for {option} {index}, found one: leave the option out"));
            }
        }
    }
    Ok(Picks(picks))
}

/// What the axes of a file are that does not say it, fastest first: with four, the fastest is that of the components or the
/// slowest that of time, whichever is chosen; with five both are.
///
/// # Errors
/// A message for other counts, and when nothing is chosen.
pub(super) fn roles(sizes: &[u64], options: &ReadOptions) -> Result<Vec<(u64, AxisRole)>, String> {
    let count = sizes.len();
    if sizes.contains(&0) {
        return Err(format!("expected axes of at least one number, found {} (fastest first)", list(sizes)));
    }
    let (component, time) = match (count, options.component, options.time) {
        (3, ..) => (false, false),
        (4, Some(_), None) => (true, false),
        (4, None, Some(_)) => (false, true),
        (5, Some(_), Some(_)) => (true, true),
        (4, ..) => {
            return Err(format!(
                "expected the three axes of a volume, found four ({}, fastest first): choose with --component N along the \
                 first, N from 0 to {}, or with --time N along the last, N from 0 to {}",
                list(sizes),
                sizes[0] - 1,
                sizes[3] - 1
            ));
        }
        (5, ..) => {
            return Err(format!(
                "expected the three axes of a volume, found five ({}, fastest first): choose with --component N along the \
                 first and --time N along the last",
                list(sizes)
            ));
        }
        _ => {
            return Err(format!("expected the three axes of a volume, found {count} ({}, fastest first)", list(sizes)));
        }
    };
    let role = |(axis, &size): (usize, &u64)| match axis {
        0 if component => (size, AxisRole::Component),
        last if time && last == count - 1 => (size, AxisRole::Time),
        _ => (size, AxisRole::Space),
    };
    Ok(sizes.iter().enumerate().map(role).collect())
}

fn list(sizes: &[u64]) -> String {
    sizes.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ")
}

fn shown(axes: &[(u64, AxisRole)]) -> String {
    let counts = axes.iter().filter(|(size, role)| *size != 1 || *role == AxisRole::Space);
    list(&counts.map(|axis| axis.0).collect::<Vec<_>>())
}

impl Picks {
    /// How many volumes the file holds.
    pub fn volumes(&self) -> u64 {
        self.0.iter().fold(1, |product, pick| product.saturating_mul(pick.count))
    }

    /// From the first number of a file of `total` that belongs to the volume to behind the last.
    pub fn range(&self, total: u64) -> Range<u64> {
        let before: u64 = self.0.iter().map(|pick| pick.index * pick.stride).sum();
        let behind: u64 = self.0.iter().map(|pick| (pick.count - 1 - pick.index) * pick.stride).sum();
        before..total - behind
    }

    /// Moves those of the numbers in `bytes`, of `size` bytes each and the first the file's number `position`, that belong to
    /// the volume to the front; returns their length in bytes.
    pub fn keep(&self, position: u64, bytes: &mut [u8], size: usize) -> usize {
        // Strides of slower axes are multiples of those of faster ones: within a run nothing changes.
        let Some(run) = self.0.iter().map(|pick| pick.stride).min() else { return bytes.len() };
        let (mut kept, mut at) = (0, 0);
        while at < bytes.len() {
            let number = position + (at / size) as u64;
            let left = (run - number % run).min(((bytes.len() - at) / size) as u64) as usize * size;
            if self.0.iter().all(|pick| number / pick.stride % pick.count == pick.index) {
                bytes.copy_within(at..at + left, kept);
                kept += left;
            }
            at += left;
        }
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_nothing_are_refused() {
        let message = roles(&[0, 4, 1, 4, 5], &ReadOptions::default()).expect_err("nothing");
        assert!(message.contains("at least one number, found 0 x 4 x 1 x 4 x 5"), "{message}");
    }

    fn options(component: Option<usize>, time: Option<usize>) -> ReadOptions {
        ReadOptions { component, time, ..ReadOptions::default() }
    }

    #[test]
    fn numbers_are_picked_wherever_their_axis_is() {
        use AxisRole::{Component, Space, Time};
        // Numbers 0 to 119 of 2 × 3 × 4 × 5.
        for (roles, options, expected) in [
            ([Component, Space, Space, Space], options(Some(1), None), (0..60).map(|n| 2 * n + 1).collect::<Vec<u8>>()),
            ([Space, Space, Space, Time], options(None, Some(3)), (72..96).collect()),
            (
                [Space, Component, Space, Space],
                options(Some(2), None),
                (0..40).map(|n| n / 2 * 6 + 4 + n % 2).collect(),
            ),
            ([Component, Space, Space, Time], options(Some(0), Some(4)), (48..60).map(|n| 2 * n).collect()),
        ] {
            let axes: Vec<_> = [2, 3, 4, 5].into_iter().zip(roles).collect();
            let picks = choose(&axes, &options).expect("a choice");
            let mut bytes: Vec<u8> = (0..120).collect();
            let kept = picks.keep(0, &mut bytes, 1);
            assert_eq!(bytes[..kept], expected, "{roles:?}");
            let range = picks.range(120);
            assert_eq!([range.start, range.end - 1], [u64::from(expected[0]), u64::from(expected[expected.len() - 1])]);
            // In two parts of whole numbers of two bytes.
            let mut words: Vec<u8> = (0..120).flat_map(|n| [n, 0]).collect();
            let (first, second) = words.split_at_mut(2 * 37);
            let parts = [picks.keep(0, first, 2), picks.keep(37, second, 2)];
            let joined = [&first[..parts[0]], &second[..parts[1]]].concat();
            assert_eq!(joined.iter().copied().step_by(2).collect::<Vec<_>>(), expected);
        }
    }

    #[test]
    fn choices_must_be_made_and_must_have_an_effect() {
        use AxisRole::{Component, Other, Space, Time};
        let axes = |first, last| [(3, first), (4, Space), (5, Space), (6, Space), (7, last)];
        for (axes, options, expected) in [
            (
                axes(Component, Time),
                options(None, None),
                "3 numbers per voxel (3 x 4 x 5 x 6 x 7): choose with --component N",
            ),
            (axes(Component, Time), options(Some(0), None), "7 points of time"),
            (axes(Component, Time), options(Some(3), Some(0)), "found --component 3"),
            (axes(Component, Space), options(Some(0), Some(0)), "found one: leave the option out"),
            (axes(Component, Component), options(Some(0), Some(0)), "at most one axis of components"),
            (axes(Space, Other), options(None, None), "choose with --component N or --time N, N from 0 to 6"),
        ] {
            let message = choose(&axes, &options).expect_err(expected);
            assert!(message.contains(expected), "{message}");
        }
        for options in [options(Some(6), None), options(None, Some(6))] {
            assert!(choose(&axes(Space, Other), &options).is_ok());
        }
    }
}
