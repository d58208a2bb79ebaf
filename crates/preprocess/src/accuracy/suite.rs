//! Which cases are measured together.

use super::{Case, Dtype};
use crate::phantom::Phantom;

/// Voxels along the edge of a case's volume.
const EDGE: u32 = 64;
/// That of the cases of [`Extent::Quick`].
const QUICK_EDGE: u32 = 32;
const BLURS: [f64; 4] = [0.7, 1.0, 1.5, 2.0];
const NOISES: [f64; 5] = [0.0, 0.005, 0.01, 0.03, 0.05];
/// The noise under which slabs are measured once more, as a share of the step.
const SLAB_NOISE: f64 = 0.01;
const THICKNESSES: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 10.0];
/// Beside the ball and the slab pair.
const OTHERS: [Phantom; 6] =
    [Phantom::BlurredBall, Phantom::Torus, Phantom::Shells, Phantom::Box, Phantom::Junction, Phantom::MarschnerLobb];

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// A few small volumes, to see that all is well: 32³.
    Quick,
    /// The ball at blur 1.5 without noise as f32, from which one factor at a time varies; every other phantom as such a
    /// base, slab pairs of every thickness also with noise: 64³.
    Standard,
    /// Every phantom with every blur, noise and type: 64³, hours.
    Full,
}

/// The cases of an extent, each once.
#[must_use]
pub fn suite(extent: Extent) -> Vec<Case> {
    match extent {
        Extent::Quick => quick(),
        Extent::Standard => standard(),
        Extent::Full => full(),
    }
}

fn quick() -> Vec<Case> {
    let ball = Case::base(Phantom::Ball, QUICK_EDGE);
    let slabs = Case { thickness: 3.0, ..Case::base(Phantom::SlabPair, QUICK_EDGE) };
    vec![ball, Case { noise: 0.01, ..ball }, slabs]
}

fn standard() -> Vec<Case> {
    let ball = Case::base(Phantom::Ball, EDGE);
    let mut cases = vec![ball];
    cases.extend(BLURS.map(|blur| Case { blur, ..ball }));
    cases.extend(NOISES.map(|noise| Case { noise, ..ball }));
    cases.extend(Dtype::ALL.map(|dtype| Case { dtype, ..ball }));
    cases.extend(OTHERS.map(|phantom| Case::base(phantom, EDGE)));
    for noise in [0.0, SLAB_NOISE] {
        cases.extend(slab_pairs().map(|slabs| Case { noise, ..slabs }));
    }
    unique(cases)
}

fn full() -> Vec<Case> {
    let phantoms = [Phantom::Ball].into_iter().chain(OTHERS).map(|phantom| Case::base(phantom, EDGE));
    let mut cases = Vec::new();
    for base in phantoms.chain(slab_pairs()) {
        for noise in NOISES {
            for dtype in Dtype::ALL {
                // The signal of Marschner and Lobb has no blur to vary.
                let blurs: &[f64] = if base.phantom == Phantom::MarschnerLobb { &[base.blur] } else { &BLURS };
                cases.extend(blurs.iter().map(|&blur| Case { blur, noise, dtype, ..base }));
            }
        }
    }
    cases
}

fn slab_pairs() -> impl Iterator<Item = Case> {
    THICKNESSES.into_iter().map(|thickness| Case { thickness, ..Case::base(Phantom::SlabPair, EDGE) })
}

fn unique(cases: Vec<Case>) -> Vec<Case> {
    let mut kept: Vec<Case> = Vec::new();
    for case in cases {
        if !kept.contains(&case) {
            kept.push(case);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_can_be_made_and_comes_once() {
        for extent in [Extent::Quick, Extent::Standard, Extent::Full] {
            let cases = suite(extent);
            for (index, case) in cases.iter().enumerate() {
                assert!(case.phantom.scene(&case.phantom_settings()).is_ok(), "{case}");
                assert!(!cases[..index].contains(case), "{case} twice");
            }
        }
        assert_eq!(suite(Extent::Standard).len(), 1 + 3 + 4 + 3 + 6 + 12);
        assert_eq!(suite(Extent::Full).len(), 12 * 80 + 20);
    }
}
