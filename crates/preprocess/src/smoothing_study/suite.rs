//! Which scenes are measured, under which noise.

use crate::accuracy::Case;
use crate::phantom::Phantom;

const EDGE: u32 = 64;
const QUICK_EDGE: u32 = 32;
/// Blur of the slabs that are thin, and of those of other thickness that are drawn beside them.
const SLAB_BLUR: f64 = 1.0;
/// The thickest slab that is thin.
const THIN: f64 = 4.0;
/// Noise as a share of the largest step.
const NOISES: [f64; 6] = [0.0, 0.005, 0.01, 0.02, 0.03, 0.05];
/// The noises under which faces kept are drawn against the thickness.
pub(super) const THICKNESS_NOISES: [f64; 2] = [0.01, 0.03];

/// Scenes whose figures are drawn together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// A ball of radius 20 voxels and slabs of 10, blur 1.5.
    Thick,
    /// Slabs of 2, 3 and 4 voxels, blur 1.
    Thin,
    /// Three materials that meet along a line, blur 1.5.
    Junction,
}

impl Group {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Thick, Self::Thin, Self::Junction];

    /// The name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Thick => "thick",
            Self::Thin => "thin",
            Self::Junction => "junction",
        }
    }

    /// What is in it.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Thick => "ball and slabs of 10 voxels, blur 1.5",
            Self::Thin => "slabs of 2, 3 and 4 voxels, blur 1",
            Self::Junction => "three materials in a T, blur 1.5",
        }
    }

    /// The group that a case is in, if any.
    #[must_use]
    pub fn of(case: &Case) -> Option<Self> {
        match case.phantom {
            Phantom::Ball => Some(Self::Thick),
            Phantom::Junction => Some(Self::Junction),
            Phantom::SlabPair if case.blur != SLAB_BLUR => Some(Self::Thick),
            Phantom::SlabPair => (case.thickness <= THIN).then_some(Self::Thin),
            _ => None,
        }
    }
}

/// A scene and the noises under which it is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The scene without noise.
    pub case: Case,
    /// Standard deviations of the noise as shares of the largest step.
    pub noises: Vec<f64>,
}

/// All scenes, each once; `quick` measures three small ones under three noises.
#[must_use]
pub fn scenes(quick: bool) -> Vec<Scene> {
    let slabs = |thickness, blur, edge| Case { thickness, blur, ..Case::base(Phantom::SlabPair, edge) };
    if quick {
        let cases = [Phantom::Ball, Phantom::Junction].map(|phantom| Case::base(phantom, QUICK_EDGE));
        let thin = [2.0, 3.0].map(|thickness| slabs(thickness, SLAB_BLUR, QUICK_EDGE));
        let noises = vec![0.0, 0.01, 0.03];
        return cases.into_iter().chain(thin).map(|case| Scene { case, noises: noises.clone() }).collect();
    }
    let mut cases = vec![Case::base(Phantom::Ball, EDGE), slabs(10.0, Case::BASE_BLUR, EDGE)];
    cases.extend([4.0, 3.0, 2.0].map(|thickness| slabs(thickness, SLAB_BLUR, EDGE)));
    cases.push(Case::base(Phantom::Junction, EDGE));
    let mut scenes: Vec<Scene> = cases.into_iter().map(|case| Scene { case, noises: NOISES.into() }).collect();
    // For the curves against thickness alone.
    let thicker = [6.0, 10.0].map(|thickness| slabs(thickness, SLAB_BLUR, EDGE));
    scenes.extend(thicker.map(|case| Scene { case, noises: THICKNESS_NOISES.into() }));
    scenes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_can_be_made_and_every_group_has_some() {
        for quick in [true, false] {
            let scenes = scenes(quick);
            for (index, scene) in scenes.iter().enumerate() {
                assert!(scene.case.phantom.scene(&scene.case.phantom_settings()).is_ok(), "{}", scene.case);
                assert!(scenes[..index].iter().all(|other| other.case != scene.case), "{} twice", scene.case);
            }
            let count = |group| scenes.iter().filter(|scene| Group::of(&scene.case) == Some(group)).count();
            let expected = if quick { [1, 2, 1] } else { [2, 3, 1] };
            assert_eq!(Group::ALL.map(count), expected);
        }
    }
}
