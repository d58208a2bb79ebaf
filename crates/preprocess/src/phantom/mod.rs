//! Volumes made by a formula, whose boundaries are known exactly.

mod blurred_ball;
mod blurred_box;
mod boundary;
mod crossing;
mod derivatives;
mod junction;
mod layout;
mod marschner_lobb;
mod noise;
mod part;
mod profile;
mod quantization;
mod rotation;
mod sampling;
mod scene;
mod settings;
mod surface;
mod volume;

use voxrole_pack::{ScalarType, Scalars};

use crate::{Error, Grid, Result};
pub use blurred_ball::BlurredBall;
pub use blurred_box::BlurredBox;
pub use boundary::Boundary;
pub use crossing::Crossing;
pub use derivatives::Derivatives;
pub use junction::Junction;
pub use marschner_lobb::MarschnerLobb;
pub use noise::NoiseKind;
pub use part::{Part, Shape};
pub use quantization::{Quantization, stored_range};
use sampling::Sampler;
pub use scene::Scene;
pub use settings::PhantomSettings;
pub use surface::Surface;

/// Distance beyond which [`Phantom::truth`] gives none, in multiples of the smallest spacing: the default `d_max`.
pub const TRUTH_REACH: f64 = 15.0;

/// The phantoms there are.
///
/// Lengths follow the smallest extent of the volume (voxels times spacing), so that shapes stay what they are on any
/// grid; `Phantom::scene` gives them. Blurs follow the smallest spacing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phantom {
    /// One ball.
    Ball,
    /// Two concentric boundaries with different steps.
    Shells,
    /// A thick and a thin slab, oblique to the grid.
    Slabs,
    /// Three balls with different steps and blurs.
    ThreeBalls,
    /// A tilted ring.
    Torus,
    /// One ball, truly convolved with a Gaussian.
    BlurredBall,
    /// Two oblique slabs of a given thickness.
    SlabPair,
    /// A box with its edges and corners, truly convolved with a Gaussian.
    Box,
    /// Three materials that meet along an oblique line, truly convolved with a Gaussian.
    Junction,
    /// The test signal of Marschner and Lobb, which has no surface.
    MarschnerLobb,
}

impl Phantom {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Ball,
        Self::Shells,
        Self::Slabs,
        Self::ThreeBalls,
        Self::Torus,
        Self::BlurredBall,
        Self::SlabPair,
        Self::Box,
        Self::Junction,
        Self::MarschnerLobb,
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Shells => "shells",
            Self::Slabs => "slabs",
            Self::ThreeBalls => "three-balls",
            Self::Torus => "torus",
            Self::BlurredBall => "blurred-ball",
            Self::SlabPair => "slab-pair",
            Self::Box => "box",
            Self::Junction => "junction",
            Self::MarschnerLobb => "marschner-lobb",
        }
    }

    /// What it is, in a line.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Ball => "one ball of radius 20/64 of the volume, step 1",
            Self::Shells => "two concentric balls, radii 26/64 and 12/64, value 0 to 0.3 to 1",
            Self::Slabs => "two oblique slabs, 12/64 and 4/64 thick, steps 1 and 0.6",
            Self::ThreeBalls => "a large ball holding a brighter and a darker one, steps 0.5, 0.3 and -0.2",
            Self::Torus => "a tilted ring torus, radii 18/64 and 8/64, step 1",
            Self::BlurredBall => "one sharp ball of radius 20/64, truly blurred, step 1",
            Self::SlabPair => "two oblique slabs as thick as --thickness says, steps 1 and 0.6",
            Self::Box => "a sharp box of 36/64 by 30/64 by 24/64, truly blurred, step 1",
            Self::Junction => "three materials that meet in an oblique T, truly blurred, values 0, 0.4 and 1",
            Self::MarschnerLobb => "the test signal of Marschner and Lobb (1994), which has no sharp surface",
        }
    }

    /// The phantom that [`Self::name`] gives `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|phantom| phantom.name() == name)
    }

    /// The formula on the grid of `settings`, before noise and quantisation; its values are those of a float type, scale
    /// and offset included.
    ///
    /// # Errors
    /// As [`PhantomSettings::validate`]; [`Error::Parameter`] for slabs of a pair too thick for the volume.
    pub fn scene(self, settings: &PhantomSettings) -> Result<Scene> {
        Ok(self.unscaled_scene(settings)?.with_values(settings.value_scale, settings.value_offset))
    }

    fn unscaled_scene(self, settings: &PhantomSettings) -> Result<Scene> {
        settings.validate()?;
        layout::scene(self, settings)
    }

    /// The volume: the formula at each voxel's centre, plus noise, in the type asked for.
    ///
    /// Floats hold the value itself, times the value scale, plus the value offset, rounded once to `f64`. Integers hold
    /// the mapping of [`Quantization`], rounded to the nearest and clamped. The result is the same for any number of
    /// threads.
    ///
    /// # Errors
    /// As [`Self::scene`]; [`Error::OutOfMemory`] for a volume that does not fit.
    pub fn generate(self, settings: &PhantomSettings) -> Result<Grid> {
        let scene = self.unscaled_scene(settings)?;
        let sampler = Sampler::new(&scene, settings);
        let scalars = match settings.scalar_type {
            ScalarType::U8 => Scalars::U8(sampler.volume(|stored| stored.round() as u8)?),
            ScalarType::I8 => Scalars::I8(sampler.volume(|stored| stored.round() as i8)?),
            ScalarType::U16 => Scalars::U16(sampler.volume(|stored| stored.round() as u16)?),
            ScalarType::I16 => Scalars::I16(sampler.volume(|stored| stored.round() as i16)?),
            ScalarType::U32 => Scalars::U32(sampler.volume(|stored| stored.round() as u32)?),
            ScalarType::I32 => Scalars::I32(sampler.volume(|stored| stored.round() as i32)?),
            ScalarType::F32 => Scalars::F32(sampler.volume(|stored| stored as f32)?),
            ScalarType::F64 => Scalars::F64(sampler.volume(|stored| stored)?),
        };
        Grid::new(self.name(), settings.geometry(), scalars)
    }

    /// The true signed distance of every voxel to the sharp surface that was blurred, x fastest: world units, positive on
    /// the side of the higher value, NaN farther than [`TRUTH_REACH`] smallest spacings from every surface.
    ///
    /// The distance is the shortest one. Near the middle between two surfaces a voxel's own gradient may lead to the one
    /// that is farther.
    ///
    /// # Errors
    /// As [`Self::scene`]; [`Error::Parameter`] for a phantom without a surface; [`Error::OutOfMemory`] for a volume that
    /// does not fit.
    pub fn truth(self, settings: &PhantomSettings) -> Result<Vec<f32>> {
        let scene = self.scene(settings)?;
        if !scene.has_true_surface() {
            return Err(Error::Parameter(format!(
                "{} was never sharp, so that there is no true surface to measure to: ask for the distance to its zero \
                 crossing of f''",
                self.name()
            )));
        }
        let reach = TRUTH_REACH * settings.geometry().smallest_spacing();
        volume::fill(&settings.geometry(), |_, point| {
            scene.signed_distance(point).filter(|distance| distance.abs() <= reach).map_or(f32::NAN, |d| d as f32)
        })
    }

    /// The signed distance of every voxel along its own gradient to the formula's nearest authentic zero crossing of f''
    /// ([`Scene::crossing`]), x fastest: world units, positive on the side of the higher value, NaN for voxels without one
    /// within [`TRUTH_REACH`] smallest spacings.
    ///
    /// # Errors
    /// As [`Self::scene`]; [`Error::OutOfMemory`] for a volume that does not fit.
    pub fn crossing_distances(self, settings: &PhantomSettings) -> Result<Vec<f32>> {
        let scene = self.scene(settings)?;
        let reach = TRUTH_REACH * settings.geometry().smallest_spacing();
        volume::fill(&settings.geometry(), |_, point| {
            scene.crossing_near(point, reach).map_or(f32::NAN, |crossing| crossing.distance as f32)
        })
    }
}

#[cfg(test)]
mod test_support;
#[cfg(test)]
mod tests;
