//! Concentric shells with known roles: `v(r) = Σ step/2 · erfc((r − R)/(√2 σ))`, so that values fall outwards.
//!
//! Shells lie many σ apart, so that every boundary is at its R, its gradient magnitude `step/(√(2π) σ)`.

use glam::DVec3;
use rayon::prelude::*;
use voxrole_pack::quantization::encode_normal;
use voxrole_pack::{DistanceQuantization, GridGeometry, HitGradientQuantization, Precision};
use voxrole_viewer::state::{Camera, CameraPreset, Projection, Region, Shape, TransferFunction};
use voxrole_viewer::{ViewState, VolumeDescription, VolumeTexels};

/// Blur of all phantoms, in world units.
pub const SIGMA: f64 = 1.5;

/// A spherical boundary.
#[derive(Clone, Copy, Debug)]
pub struct Shell {
    pub radius: f64,
    pub step: f64,
}

impl Shell {
    /// Gradient magnitude on the boundary.
    pub fn gradient(&self) -> f64 {
        self.step / (std::f64::consts::TAU.sqrt() * SIGMA)
    }
}

/// Shells around a place in a grid.
#[derive(Clone, Debug)]
pub struct Phantom {
    pub geometry: GridGeometry,
    /// In world units from voxel (0, 0, 0), along the grid's axes.
    pub center: DVec3,
    pub shells: Vec<Shell>,
    /// In world units.
    pub d_max: f64,
}

/// The inner shell's step is larger, so that the two differ in g.
pub const SHELLS: [Shell; 2] = [Shell { radius: 12.0, step: 150.0 }, Shell { radius: 24.0, step: 60.0 }];

/// Value, and signed distance, gradient magnitude at the hit and normal where there is a boundary.
pub type Role = (f64, Option<(f64, f64, DVec3)>);

impl Phantom {
    /// Shells in the middle of a cube.
    pub fn cube(edge: u32, shells: &[Shell]) -> Self {
        let center = DVec3::splat(0.5 * f64::from(edge - 1));
        let geometry = GridGeometry::axis_aligned([edge; 3], [1.0; 3]);
        Self { geometry, center, shells: shells.to_vec(), d_max: 15.0 }
    }

    pub fn ball() -> Self {
        Self::cube(64, &[Shell { radius: 20.0, step: 100.0 }])
    }

    pub fn concentric_shells() -> Self {
        Self::cube(64, &SHELLS)
    }

    /// Value, and where there is one within `d_max`: signed distance, gradient magnitude at the hit, normal.
    pub fn role(&self, index: DVec3) -> Role {
        let from_center = index * DVec3::from_array(self.geometry.spacing) - self.center;
        let r = from_center.length();
        let value = self
            .shells
            .iter()
            .map(|shell| 0.5 * shell.step * libm::erfc((r - shell.radius) / (std::f64::consts::SQRT_2 * SIGMA)));
        let nearest = self
            .shells
            .iter()
            .map(|shell| (shell.radius - r, shell.gradient()))
            .min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
            .filter(|(distance, _)| distance.abs() <= self.d_max);
        (value.sum(), nearest.map(|(distance, gradient)| (distance, gradient, -from_center.normalize_or_zero())))
    }

    pub fn hit_gradient(&self) -> HitGradientQuantization {
        let gradients = self.shells.iter().map(|shell| shell.gradient() as f32);
        let low = gradients.clone().fold(f32::INFINITY, f32::min);
        HitGradientQuantization::new(low, gradients.fold(0.0, f32::max), Precision::default())
    }

    pub fn value_range(&self) -> [f64; 2] {
        [0.0, self.shells.iter().map(|shell| shell.step).sum()]
    }

    pub fn texels(&self) -> VolumeTexels {
        let distance_quantization = DistanceQuantization::new(self.d_max as f32, Precision::default());
        let hit_gradient = self.hit_gradient();
        let [_, high] = self.value_range();
        let [width, height, depth] = self.geometry.dims;
        let texels = (0..width * height * depth)
            .into_par_iter()
            .map(|voxel| {
                let index = [voxel % width, voxel / width % height, voxel / (width * height)].map(f64::from);
                let (value, hit) = self.role(DVec3::from_array(index));
                let value = (value / high * 65535.0).round() as u16;
                match hit {
                    None => [value, DistanceQuantization::NO_BOUNDARY as u16, 0, encode_normal(glam::Vec3::ZERO)],
                    Some((distance, gradient, normal)) => [
                        value,
                        distance_quantization.encode(distance as f32) as u16,
                        hit_gradient.encode(gradient as f32),
                        encode_normal(normal.as_vec3()),
                    ],
                }
            })
            .collect();
        let description = VolumeDescription::new(&self.geometry, self.d_max as f32, self.value_range(), hit_gradient);
        VolumeTexels { description, texels }
    }

    /// A region around each shell: all values, gradients within a tenth; the outermost faint.
    pub fn transfer_function(&self) -> TransferFunction {
        let count = self.shells.len();
        let regions = self.shells.iter().enumerate().map(|(index, shell)| {
            let outermost = index + 1 == count && count > 1;
            region_at(
                shell.gradient(),
                if outermost { 0.25 } else { 0.9 },
                [[1.0, 0.6, 0.1], [0.3, 0.6, 1.0]][index % 2],
            )
        });
        TransferFunction { regions: regions.collect(), ..TransferFunction::default() }
    }

    /// A picture of 128 x 128 pixels from `camera`.
    pub fn state(&self, camera: Camera) -> ViewState {
        let mut state = ViewState { camera, transfer_function: self.transfer_function(), ..ViewState::default() };
        state.render_settings.image_size = [128, 128];
        state
    }
}

/// All values that any phantom has, gradient magnitudes within a tenth of `gradient`.
pub fn region_at(gradient: f64, opacity: f32, color: [f32; 3]) -> Region {
    Region {
        shape: Shape::Box,
        value: [-100.0, 1000.0],
        gradient: [0.9, 1.1].map(|share| (share * gradient) as f32),
        color,
        opacity,
        softness: 0.0,
        emphasis: None,
    }
}

pub fn orthographic(preset: CameraPreset) -> Camera {
    Camera { projection: Projection::Orthographic, ..Camera::from_preset(preset) }
}
