//! One picture in numbers: what camera, settings and volume come to before the first ray is cast.
//!
//! Both ray marchers start from the same [`Frame`]. Its space is the volume's: grid axes, voxel (0, 0, 0) at the origin,
//! lengths in multiples of `L_min`, so that single precision suffices whatever the world's unit.

use glam::{Mat3, Vec2, Vec3, Vec4};
use voxrole_pack::DistanceQuantization;

use crate::classify::EmphasisTable;
use crate::classify::preintegration::SHORTEST;
use crate::slicing::Slicing;
use crate::state::{
    Camera, CameraPreset, Classification, ClipPlane, Clipping, Integration, Projection, Shading, ViewAxes, ViewState,
};
use crate::volume::VolumeDescription;

/// Everything that a ray marcher needs beside texels and opacity table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Width and height in pixels.
    pub image_size: [u32; 2],
    /// Number of voxels along each axis.
    pub dims: [u32; 3],
    /// Voxel spacing.
    pub spacing: Vec3,
    /// Lower corner of the box that is drawn.
    pub box_low: Vec3,
    /// Upper corner of the box that is drawn.
    pub box_high: Vec3,
    /// Planes that cut: a unit normal and a limit each; places are drawn whose product with the normal is at most the limit.
    pub planes: [Vec4; MOST_PLANES],
    /// How many of them there are.
    pub plane_count: u32,
    /// The rays of all pixels.
    pub rays: PixelRays,
    /// Slices that are drawn in place of rays.
    pub slicing: Option<Slicing>,
    /// Distance between samples along a ray.
    pub step: f32,
    /// As [`RenderSettings::goes_by_cells`](crate::state::RenderSettings::goes_by_cells).
    pub goes_by_cells: bool,
    /// Half of what opacity is integrated along: by role, of the longest piece that what lies in a cell is cut into; else
    /// of a step, or of as much as a slice may stand for. 0 where a step's middle counts for all of it.
    pub half_step: f32,
    /// What decides on colour and opacity.
    pub classification: Classification,
    /// Whether what lies in front within a step hides what lies behind, where value alone decides.
    pub is_ordered: bool,
    /// Whether every ray has its own place within the first step: see [`Self::first_sample`].
    pub jitter: bool,
    /// A ray ends once its opacity exceeds this.
    pub termination_opacity: f32,
    /// What one step of a stored distance amounts to.
    pub distance_scale: f32,
    /// The largest stored |d| with which a voxel can be drawn somewhere in its cell and half a step beyond: its plane's
    /// distance changes by the cell's diagonal and by half a step at most, and there is a little for rounding.
    pub reach: f32,
    /// Unit vector towards the light.
    pub light: Vec3,
    /// How surfaces answer to it.
    pub shading: Shading,
    /// Colour behind the volume.
    pub background: Vec3,
}

/// Most planes that cut: the six of a box and the free ones.
pub const MOST_PLANES: usize = 6 + Clipping::MOST_PLANES;

/// Most steps across a volume: they are counted in single precision.
const MOST_STEPS: f32 = 1_048_576.0;

/// The part of a ray that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Where it begins, not before the ray's origin; behind the exit where the ray misses.
    pub entry: f32,
    /// Where it ends.
    pub exit: f32,
    /// Normal of the plane that the ray enters through, 0 where that is not one that cuts.
    pub cut: Vec3,
}

/// All rays of a picture: origin and direction are linear in the pixel's place, x from −1 (left) to 1, y from −1
/// (bottom) to 1; directions are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRays {
    /// Origin of the ray through the picture's middle.
    pub origin: Vec3,
    /// By how much the origin moves to the picture's right edge.
    pub origin_right: Vec3,
    /// By how much the origin moves to the picture's upper edge.
    pub origin_up: Vec3,
    /// Direction of the ray through the picture's middle.
    pub direction: Vec3,
    /// By how much the direction turns to the picture's right edge.
    pub direction_right: Vec3,
    /// By how much the direction turns to the picture's upper edge.
    pub direction_up: Vec3,
}

/// A ray: `origin + t · direction`, the direction a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes.
    pub direction: Vec3,
}

impl Frame {
    /// Smallest and largest step that is used, in multiples of `L_min`.
    pub const STEP_RANGE: [f32; 2] = [1.0 / 64.0, 16.0];

    /// The numbers for a picture of `image_size` pixels. Settings out of range are brought to the nearest one in range.
    #[must_use]
    pub fn new(state: &ViewState, volume: &VolumeDescription, emphases: &EmphasisTable, image_size: [u32; 2]) -> Self {
        let settings = &state.render_settings;
        let spacing = Vec3::from_array(volume.relative_spacing());
        let [box_low, box_high] = drawn_box(volume.dims, spacing);
        let axes_from_world = volume.axes_from_world();
        let view = rotate(&state.camera.axes(), axes_from_world);
        let light_view = if settings.light.follows_camera {
            view
        } else {
            rotate(&Camera::from_preset(CameraPreset::Front).axes(), axes_from_world)
        };
        let steps = f32::from(DistanceQuantization::MOST_STEPS);
        let shortest = (box_high - box_low).length() / MOST_STEPS;
        let step = within(settings.step, Self::STEP_RANGE, 0.5).max(shortest);
        let texel_spacing = Vec3::from_array(volume.texel_spacing());
        let rays = pixel_rays(&state.camera, &view, box_low, box_high, image_size);
        let slicing = Slicing::new(settings.technique, &rays, [box_low, box_high], texel_spacing, step);
        let classification = state.transfer_function.classification;
        let goes_by_cells = settings.goes_by_cells(classification);
        let half_step = match &slicing {
            _ if goes_by_cells => half_piece(step, texel_spacing),
            Some(slicing) => slicing.longest_half_step,
            None => 0.5 * step,
        };
        let planes = planes(&state.clipping, volume, [box_low, box_high]);
        let mut all_planes = [Vec4::ZERO; MOST_PLANES];
        all_planes[..planes.len()].copy_from_slice(&planes);
        Self {
            image_size,
            dims: volume.texel_dims(),
            spacing: texel_spacing,
            box_low,
            box_high,
            planes: all_planes,
            plane_count: planes.len() as u32,
            rays,
            slicing,
            step,
            goes_by_cells,
            half_step: if settings.integration == Integration::PostClassified { 0.0 } else { half_step },
            classification,
            is_ordered: settings.integration == Integration::FrontToBack,
            jitter: settings.jitter,
            termination_opacity: within(settings.termination_opacity, [0.0, 1.0], 1.0),
            distance_scale: volume.d_max_in_spacings() / steps,
            reach: (emphases.largest_d_c() + texel_spacing.length() + half_step) * 1.001,
            light: light_direction(&light_view, settings.light.azimuth, settings.light.elevation),
            shading: Shading { occlusion: within(settings.shading.occlusion, [0.0, 1.0], 0.0), ..settings.shading },
            background: Vec3::from_array(settings.background),
        }
    }

    /// The ray through the middle of a pixel, counted from the top left.
    #[must_use]
    pub fn ray(&self, x: u32, y: u32) -> Ray {
        let size = Vec2::new(self.image_size[0] as f32, self.image_size[1] as f32);
        let right = (x as f32 + 0.5) / size.x * 2.0 - 1.0;
        let up = 1.0 - (y as f32 + 0.5) / size.y * 2.0;
        let rays = &self.rays;
        let origin = rays.origin + right * rays.origin_right + up * rays.origin_up;
        let direction = rays.direction + right * rays.direction_right + up * rays.direction_up;
        Ray { origin, direction: direction / direction.dot(direction).sqrt() }
    }

    /// Where in the first step of a pixel's ray the first sample lies, 0 to 1: its middle or, with jitter, a place that differs
    /// as much as possible from those of the pixels around. Whole numbers, so that the GPU has the same bits.
    ///
    /// Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018: R2, of the plastic number.
    #[must_use]
    pub fn first_sample(&self, x: u32, y: u32) -> f32 {
        if !self.jitter {
            return 0.5;
        }
        let sum = x.wrapping_mul(3_242_174_889).wrapping_add(y.wrapping_mul(2_447_445_414));
        (sum >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// By how much a ray's parameter grows per unit along each axis; finite.
    #[must_use]
    pub fn inverse_direction(ray: &Ray) -> Vec3 {
        // A component of exactly 0 would make 0 · ∞. All others keep their sign, by which rays go forwards or backwards.
        let nonzero = |component: f32| match component {
            0.0..1e-20 => 1e-20,
            -1e-20..0.0 => -1e-20,
            _ => component,
        };
        Vec3::new(nonzero(ray.direction.x), nonzero(ray.direction.y), nonzero(ray.direction.z)).recip()
    }

    /// Where a ray enters and leaves the box, not before its origin; the entry lies behind the exit where it misses.
    #[must_use]
    pub fn intersect_box(&self, ray: &Ray) -> [f32; 2] {
        let inverse = Self::inverse_direction(ray);
        let to_low = (self.box_low - ray.origin) * inverse;
        let to_high = (self.box_high - ray.origin) * inverse;
        let (near, far) = (to_low.min(to_high), to_low.max(to_high));
        [near.x.max(near.y).max(near.z).max(0.0), far.x.min(far.y).min(far.z)]
    }

    /// The planes that cut: unit normal, and the largest product with it that is drawn.
    #[must_use]
    pub fn cutting_planes(&self) -> &[Vec4] {
        &self.planes[..self.plane_count as usize]
    }

    /// The part of a ray inside the box that no plane cuts away.
    #[must_use]
    pub fn interval(&self, ray: &Ray) -> Interval {
        let [entry, exit] = self.intersect_box(ray);
        let mut interval = Interval { entry, exit, cut: Vec3::ZERO };
        for plane in self.cutting_planes() {
            let normal = plane.truncate();
            let (along, room) = (normal.dot(ray.direction), plane.w - normal.dot(ray.origin));
            // A ray along the plane lies on one side of it as a whole.
            let is_parallel = along.abs() < 1e-20;
            if is_parallel && room < 0.0 {
                interval.exit = -1.0;
            } else if !is_parallel && along > 0.0 {
                interval.exit = interval.exit.min(room / along);
            } else if !is_parallel && room / along > interval.entry {
                (interval.entry, interval.cut) = (room / along, normal);
            }
        }
        interval
    }
}

/// Half of the longest piece that a ray is cut into within a cell: two of them in a step, or one across a cell.
fn half_piece(step: f32, spacing: Vec3) -> f32 {
    (0.25 * step).min(0.5 * spacing.length()).max(0.5 * SHORTEST)
}

/// From the first voxel's middle to the last's; an axis with one voxel is a slab as thick as its spacing.
pub(crate) fn drawn_box(dims: [u32; 3], spacing: Vec3) -> [Vec3; 2] {
    let axis = |dim: u32, spacing: f32| match dim {
        0 | 1 => [-0.5 * spacing, 0.5 * spacing],
        _ => [0.0, (dim - 1) as f32 * spacing],
    };
    let [x, y, z] = [axis(dims[0], spacing.x), axis(dims[1], spacing.y), axis(dims[2], spacing.z)];
    [Vec3::new(x[0], y[0], z[0]), Vec3::new(x[1], y[1], z[1])]
}

/// The planes that cut something off the box, those of its own sides first.
fn planes(clipping: &Clipping, volume: &VolumeDescription, [box_low, box_high]: [Vec3; 2]) -> Vec<Vec4> {
    let spacing = Vec3::from_array(volume.relative_spacing());
    let mut planes = Vec::new();
    for (axis, [low, high]) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().zip(clipping.crop.faces()) {
        let [low, high] = [low, high].map(|end| end * axis.dot(spacing));
        if low > axis.dot(box_low) {
            planes.push((-axis).extend(-low));
        }
        if high < axis.dot(box_high) {
            planes.push(axis.extend(high));
        }
    }
    let (middle, radius) = (0.5 * (box_low + box_high), 0.5 * (box_high - box_low).length());
    for &ClipPlane { azimuth, elevation, offset } in clipping.planes.iter().take(Clipping::MOST_PLANES) {
        let viewer = Camera { azimuth, elevation, ..Camera::default() };
        let normal = -rotate(&viewer.axes(), volume.axes_from_world()).forward;
        planes.push(normal.extend(normal.dot(middle) + offset * radius));
    }
    planes
}

fn rotate(axes: &ViewAxes, rotation: Mat3) -> ViewAxes {
    ViewAxes { right: rotation * axes.right, up: rotation * axes.up, forward: rotation * axes.forward }
}

fn pixel_rays(camera: &Camera, view: &ViewAxes, box_low: Vec3, box_high: Vec3, image_size: [u32; 2]) -> PixelRays {
    let radius = 0.5 * (box_high - box_low).length();
    let [pan_right, pan_up] = camera.pan;
    let target = 0.5 * (box_low + box_high) + radius * (pan_right * view.right + pan_up * view.up);
    let zoom = within(camera.zoom, Camera::ZOOM_RANGE, 1.0);
    // From the shorter side's half extent to each side's.
    let shorter = image_size[0].min(image_size[1]).max(1) as f32;
    let [wide, tall] = image_size.map(|side| side.max(1) as f32 / shorter);
    match camera.projection {
        Projection::Perspective => {
            let half_angle = 0.5 * within(camera.field_of_view, Camera::FIELD_OF_VIEW_RANGE, 30.0).to_radians();
            // The cone of view touches the sphere around the box at zoom 1.
            let distance = radius / (half_angle.sin() * zoom);
            PixelRays {
                origin: target - distance * view.forward,
                origin_right: Vec3::ZERO,
                origin_up: Vec3::ZERO,
                direction: view.forward,
                direction_right: wide * half_angle.tan() * view.right,
                direction_up: tall * half_angle.tan() * view.up,
            }
        }
        Projection::Orthographic => PixelRays {
            // Far enough back that nothing of the box lies behind, wherever the camera is panned to.
            origin: target - radius * (2.0 + pan_right.hypot(pan_up)) * view.forward,
            origin_right: wide * radius / zoom * view.right,
            origin_up: tall * radius / zoom * view.up,
            direction: view.forward,
            direction_right: Vec3::ZERO,
            direction_up: Vec3::ZERO,
        },
    }
}

fn light_direction(view: &ViewAxes, azimuth: f32, elevation: f32) -> Vec3 {
    let (sin_azimuth, cos_azimuth) = azimuth.to_radians().sin_cos();
    let (sin_elevation, cos_elevation) = elevation.to_radians().sin_cos();
    let level = sin_azimuth * view.right - cos_azimuth * view.forward;
    (cos_elevation * level + sin_elevation * view.up).normalize_or(-view.forward)
}

/// A setting brought into its range; `otherwise` for NaN.
pub(crate) fn within(number: f32, [low, high]: [f32; 2], otherwise: f32) -> f32 {
    if number.is_nan() { otherwise } else { number.clamp(low, high) }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;

    fn frame_of(state: &ViewState, volume: &VolumeDescription, size: [u32; 2]) -> Frame {
        Frame::new(state, volume, &EmphasisTable::new(&state.transfer_function), size)
    }

    fn volume(dims: [u32; 3], spacing: [f64; 3]) -> VolumeDescription {
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let geometry = GridGeometry::axis_aligned(dims, spacing);
        VolumeDescription::new(&geometry, 15.0 * geometry.smallest_spacing() as f32, [0.0, 1.0], hit_gradient)
    }

    fn frame_from(preset: CameraPreset, projection: Projection, size: [u32; 2]) -> Frame {
        let camera = Camera { projection, ..Camera::from_preset(preset) };
        let state = ViewState { camera, ..ViewState::default() };
        frame_of(&state, &volume([11, 21, 31], [0.5; 3]), size)
    }

    #[test]
    fn lengths_are_multiples_of_the_smallest_spacing() {
        let frame = frame_of(&ViewState::default(), &volume([3, 3, 1], [2e-9, 1e-9, 3e-9]), [8, 8]);
        assert!((frame.spacing - Vec3::new(2.0, 1.0, 3.0)).length() < 1e-5);
        assert!((frame.box_high - Vec3::new(4.0, 2.0, 1.5)).length() < 1e-5);
        assert!((frame.distance_scale * 32766.0 - 15.0).abs() < 1e-4);
    }

    #[test]
    fn every_projection_shows_the_box_whole_and_the_corners_miss_it() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for (size, corner) in [([101, 101], [0, 0]), ([201, 101], [0, 50]), ([101, 201], [50, 0])] {
                let frame = frame_from(CameraPreset::Iso, projection, size);
                let [entry, exit] = frame.intersect_box(&frame.ray(size[0] / 2, size[1] / 2));
                assert!(entry > 0.0 && exit > entry);
                let [entry, exit] = frame.intersect_box(&frame.ray(corner[0], corner[1]));
                assert!(entry > exit, "{projection:?} {size:?}");
            }
        }
    }

    #[test]
    fn front_sees_x_to_the_right_and_z_up() {
        let frame = frame_from(CameraPreset::Front, Projection::Orthographic, [100, 100]);
        let [middle, right, above] = [frame.ray(50, 50), frame.ray(60, 50), frame.ray(50, 40)];
        assert!(right.origin.x > middle.origin.x && (right.origin.z - middle.origin.z).abs() < 1e-4);
        assert!(above.origin.z > middle.origin.z && (above.origin.x - middle.origin.x).abs() < 1e-4);
        assert_eq!(middle.direction, Vec3::Y);
    }

    #[test]
    fn the_grid_s_own_direction_turns_the_view() {
        let mut description = volume([11, 21, 31], [1.0; 3]);
        // Index axis x runs along the world's −y: the front camera looks along −x of the grid.
        description.world_from_axes = DMat3::from_cols_array_2d(&[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        let state = ViewState { camera: Camera::from_preset(CameraPreset::Front), ..ViewState::default() };
        let ray = frame_of(&state, &description, [9, 9]).ray(4, 4);
        assert!((ray.direction - Vec3::NEG_X).length() < 1e-6, "{ray:?}");
    }

    #[test]
    fn light_comes_from_behind_the_viewer() {
        let frame = frame_from(CameraPreset::Front, Projection::Perspective, [9, 9]);
        assert!(frame.light.y < -0.5 && frame.light.z > 0.0 && frame.light.x < 0.0, "{}", frame.light);
    }

    #[test]
    fn nonsense_settings_are_brought_into_range() {
        let mut state = ViewState::default();
        state.render_settings.step = f32::NAN;
        state.transfer_function.emphasis.high.d_c = 0.0;
        state.camera.zoom = 0.0;
        let frame = frame_of(&state, &volume([2, 2, 2], [1.0; 3]), [4, 4]);
        assert!(frame.step > 0.0 && frame.reach > 0.0 && frame.rays.origin.is_finite());
    }
}
