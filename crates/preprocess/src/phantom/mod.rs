//! Volumes made by a formula, whose boundaries are known exactly.

mod layout;
mod noise;
mod scene;

use glam::DVec3;
use rayon::prelude::*;
use voxrole_pack::{GridGeometry, ScalarType, Scalars};

use crate::{Error, Grid, Result};
pub use scene::{Boundary, Scene, Surface};

/// Distance beyond which [`Phantom::truth`] gives none, in multiples of the smallest spacing: the default `d_max`.
pub const TRUTH_REACH: f64 = 15.0;

/// How to make a phantom.
#[derive(Clone, Debug, PartialEq)]
pub struct PhantomSettings {
    /// Number of voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance between voxels along x, y, z, in world units.
    pub spacing: [f64; 3],
    /// Standard deviation of the blur in multiples of the smallest spacing; positive.
    pub blur: f64,
    /// Standard deviation of the Gaussian noise as a share of the phantom's largest step; not negative.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Type of the stored numbers.
    pub scalar_type: ScalarType,
}

impl Default for PhantomSettings {
    fn default() -> Self {
        Self { dims: [64; 3], spacing: [1.0; 3], blur: 1.5, noise: 0.0, seed: 0, scalar_type: ScalarType::F32 }
    }
}

impl PhantomSettings {
    /// The grid: at the world's origin, its axes along the world's.
    #[must_use]
    pub fn geometry(&self) -> GridGeometry {
        GridGeometry::axis_aligned(self.dims, self.spacing)
    }

    /// Checks that a phantom can be made.
    ///
    /// # Errors
    /// [`Error::Pack`] for an unusable grid, [`Error::Parameter`] for a blur that is not positive or a noise that is
    /// negative.
    pub fn validate(&self) -> Result<()> {
        self.geometry().validate()?;
        if !(self.blur.is_finite() && self.blur > 0.0) {
            return Err(Error::Parameter(format!(
                "a blur of {} voxels: give a positive one, for a sharp edge 0.01",
                self.blur
            )));
        }
        if !(self.noise.is_finite() && self.noise >= 0.0) {
            return Err(Error::Parameter(format!("a noise of {}: give a share of the step, 0 for none", self.noise)));
        }
        Ok(())
    }
}

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
}

impl Phantom {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Ball, Self::Shells, Self::Slabs, Self::ThreeBalls, Self::Torus];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Shells => "shells",
            Self::Slabs => "slabs",
            Self::ThreeBalls => "three-balls",
            Self::Torus => "torus",
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
        }
    }

    /// The phantom that [`Self::name`] gives `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|phantom| phantom.name() == name)
    }

    /// The formula on the grid of `settings`, before noise and quantisation.
    ///
    /// # Errors
    /// As [`PhantomSettings::validate`].
    pub fn scene(self, settings: &PhantomSettings) -> Result<Scene> {
        settings.validate()?;
        Ok(layout::scene(self, settings))
    }

    /// The volume: the formula at each voxel's centre, plus noise, in the type asked for.
    ///
    /// Floats hold the value itself, integers the mapping of [`stored_range`], rounded to the nearest and clamped to
    /// the type. The result is the same for any number of threads.
    ///
    /// # Errors
    /// As [`PhantomSettings::validate`]; [`Error::OutOfMemory`] for a volume that does not fit.
    pub fn generate(self, settings: &PhantomSettings) -> Result<Grid> {
        let scene = self.scene(settings)?;
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

    /// The true signed distance of every voxel, x fastest: world units, positive on the side of the higher value, NaN
    /// farther than [`TRUTH_REACH`] smallest spacings from every boundary.
    ///
    /// The distance is the shortest one. Near the middle between two boundaries a voxel's own gradient may lead to the
    /// one that is farther.
    ///
    /// # Errors
    /// As [`PhantomSettings::validate`]; [`Error::OutOfMemory`] for a volume that does not fit.
    pub fn truth(self, settings: &PhantomSettings) -> Result<Vec<f32>> {
        let scene = self.scene(settings)?;
        let reach = TRUTH_REACH * settings.geometry().smallest_spacing();
        fill(&settings.geometry(), |_, point| {
            let distance = scene.signed_distance(point);
            if distance.abs() <= reach { distance as f32 } else { f32::NAN }
        })
    }
}

/// The stored numbers of a phantom's lowest and highest plateau, or `None` for floats, which hold the value itself.
///
/// Both lie inside the type's range, so that noise of a few per cent is seldom clamped.
#[must_use]
pub const fn stored_range(scalar_type: ScalarType) -> Option<[f64; 2]> {
    match scalar_type {
        ScalarType::U8 => Some([20.0, 235.0]),
        ScalarType::I8 => Some([-100.0, 100.0]),
        ScalarType::U16 | ScalarType::I16 => Some([1000.0, 30_000.0]),
        ScalarType::U32 | ScalarType::I32 => Some([100_000.0, 3_000_000.0]),
        ScalarType::F32 | ScalarType::F64 => None,
    }
}

/// A scene with what turns its value into a stored number.
struct Sampler<'a> {
    scene: &'a Scene,
    geometry: GridGeometry,
    noise_sigma: f64,
    seed: u64,
    slope: f64,
    intercept: f64,
}

impl<'a> Sampler<'a> {
    fn new(scene: &'a Scene, settings: &PhantomSettings) -> Self {
        let [low, high] = scene.value_range;
        let [stored_low, stored_high] = stored_range(settings.scalar_type).unwrap_or(scene.value_range);
        let slope = (stored_high - stored_low) / (high - low);
        Self {
            scene,
            geometry: settings.geometry(),
            noise_sigma: settings.noise * scene.largest_step(),
            seed: settings.seed,
            slope,
            intercept: stored_low - slope * low,
        }
    }

    fn volume<T: Copy + Default + Send>(&self, convert: impl Fn(f64) -> T + Sync) -> Result<Vec<T>> {
        fill(&self.geometry, |index, point| {
            let mut value = self.scene.value(point);
            if self.noise_sigma > 0.0 {
                value += self.noise_sigma * noise::standard_normal(self.seed, index as u64);
            }
            convert(self.slope * value + self.intercept)
        })
    }
}

/// One number for every voxel of an axis-aligned grid at the origin, from its index and its place in the world.
fn fill<T, F>(geometry: &GridGeometry, number: F) -> Result<Vec<T>>
where
    T: Copy + Default + Send,
    F: Fn(usize, DVec3) -> T + Sync,
{
    let count = geometry.voxel_count();
    let mut volume = Vec::new();
    volume.try_reserve_exact(count).map_err(|_| Error::OutOfMemory {
        what: format!("a phantom of {:?} voxels", geometry.dims),
        bytes: count as u128 * size_of::<T>() as u128,
    })?;
    volume.resize(count, T::default());

    let [width, height, _] = geometry.dims_usize();
    let spacing = DVec3::from_array(geometry.spacing);
    volume.par_chunks_mut(width).enumerate().for_each(|(row_index, row)| {
        let (y, z) = (row_index % height, row_index / height);
        for (x, voxel) in row.iter_mut().enumerate() {
            *voxel = number(row_index * width + x, DVec3::new(x as f64, y as f64, z as f64) * spacing);
        }
    });
    Ok(volume)
}

#[cfg(test)]
mod tests;
