//! An orbit camera: it looks at the middle of the volume from an azimuth and an elevation in the world frame.

use std::fmt;
use std::str::FromStr;

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};

use super::{ParseError, parse_number};

/// How the picture converges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    /// Through one eye point.
    #[default]
    Perspective,
    /// All rays parallel.
    Orthographic,
}

/// A camera on a sphere around the volume's middle.
///
/// At azimuth 0 and elevation 0 it stands at −y, looks along +y and sees +x to the right and +z up: in patient
/// coordinates (left, posterior, superior) it looks at the face, the patient's left to the right. Growing azimuth walks
/// it round towards +x, growing elevation up towards +z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Angle around the world's z axis, in degrees.
    pub azimuth: f32,
    /// Angle above the world's xy plane, in degrees, −90 to 90.
    pub elevation: f32,
    /// Turn around the line of sight, in degrees; positive turns the picture clockwise.
    pub roll: f32,
    /// Magnification: at 1 the sphere around the volume's box just fits the picture.
    pub zoom: f32,
    /// Where the camera looks, off the volume's middle to its right and up, in radii of the sphere around the box.
    pub pan: [f32; 2],
    /// How the picture converges.
    pub projection: Projection,
    /// Angle of view across the picture's shorter side, in degrees; 1 to 150. Used by perspective alone.
    pub field_of_view: f32,
}

impl Default for Camera {
    /// Half from the side and a little from above, 30 degrees of view.
    fn default() -> Self {
        Self {
            azimuth: 30.0,
            elevation: 20.0,
            roll: 0.0,
            zoom: 1.0,
            pan: [0.0; 2],
            projection: Projection::Perspective,
            field_of_view: 30.0,
        }
    }
}

/// The camera's axes in the world: unit vectors, `right × up = −forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAxes {
    /// To the right of the picture.
    pub right: Vec3,
    /// Up the picture.
    pub up: Vec3,
    /// Into the picture.
    pub forward: Vec3,
}

impl Camera {
    /// Smallest and largest [`Self::zoom`].
    pub const ZOOM_RANGE: [f32; 2] = [0.05, 100.0];
    /// How far [`Self::pan`] goes, either way.
    pub const FARTHEST_PAN: f32 = 100.0;
    /// Smallest and largest [`Self::field_of_view`].
    pub const FIELD_OF_VIEW_RANGE: [f32; 2] = [1.0, 150.0];

    /// The default camera moved to a preset's side.
    #[must_use]
    pub fn from_preset(preset: CameraPreset) -> Self {
        let mut camera = Self::default();
        camera.look_from(preset);
        camera
    }

    /// Turns to a preset's side, upright; zoom, pan and projection stay.
    pub fn look_from(&mut self, preset: CameraPreset) {
        [self.azimuth, self.elevation] = preset.angles();
        self.roll = 0.0;
    }

    /// Walks around the volume by degrees; the elevation stops at the poles.
    pub fn orbit(&mut self, azimuth: f32, elevation: f32) {
        self.azimuth = (self.azimuth + azimuth + 180.0).rem_euclid(360.0) - 180.0;
        self.elevation = (self.elevation + elevation).clamp(-90.0, 90.0);
    }

    /// Magnifies by a factor, within [`Self::ZOOM_RANGE`].
    pub fn zoom_by(&mut self, factor: f32) {
        if factor.is_finite() {
            self.zoom = (self.zoom * factor).clamp(Self::ZOOM_RANGE[0], Self::ZOOM_RANGE[1]);
        }
    }

    /// Moves the picture by a share of its shorter side, to the right and up, up to [`Self::FARTHEST_PAN`].
    pub fn pan_by(&mut self, right: f32, up: f32) {
        // The shorter side shows the sphere's diameter at zoom 1.
        for (pan, moved) in self.pan.iter_mut().zip([right, up]) {
            *pan = (*pan - 2.0 * moved / self.zoom).clamp(-Self::FARTHEST_PAN, Self::FARTHEST_PAN);
        }
    }

    /// The camera's axes in the world.
    #[must_use]
    pub fn axes(&self) -> ViewAxes {
        let (sin_azimuth, cos_azimuth) = self.azimuth.to_radians().sin_cos();
        let (sin_elevation, cos_elevation) = self.elevation.to_radians().sin_cos();
        let forward = Vec3::new(-sin_azimuth * cos_elevation, cos_azimuth * cos_elevation, -sin_elevation);
        let right = Vec3::new(cos_azimuth, sin_azimuth, 0.0);
        let up = Vec3::new(-sin_azimuth * sin_elevation, cos_azimuth * sin_elevation, cos_elevation);
        // A camera that turns anticlockwise sees its picture turn clockwise.
        let roll = Quat::from_axis_angle(forward, -self.roll.to_radians());
        ViewAxes { right: roll * right, up: roll * up, forward }
    }
}

/// A side to look from. In patient coordinates `Front` looks at the face and `Left` at the patient's left ear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CameraPreset {
    /// From −y.
    Front,
    /// From +y.
    Back,
    /// From +x.
    Left,
    /// From −x.
    Right,
    /// From +z, +y up.
    Top,
    /// From −z, −y up.
    Bottom,
    /// Along the space diagonal from +x, −y, +z.
    Iso,
}

impl CameraPreset {
    /// All of them, in the order of a menu.
    pub const ALL: [Self; 7] = [Self::Front, Self::Back, Self::Left, Self::Right, Self::Top, Self::Bottom, Self::Iso];

    /// The preset's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
            Self::Left => "left",
            Self::Right => "right",
            Self::Top => "top",
            Self::Bottom => "bottom",
            Self::Iso => "iso",
        }
    }

    /// Azimuth and elevation in degrees.
    #[must_use]
    pub const fn angles(self) -> [f32; 2] {
        match self {
            Self::Front => [0.0, 0.0],
            Self::Back => [180.0, 0.0],
            Self::Left => [90.0, 0.0],
            Self::Right => [-90.0, 0.0],
            Self::Top => [0.0, 90.0],
            Self::Bottom => [0.0, -90.0],
            Self::Iso => [45.0, 35.264_39],
        }
    }
}

impl FromStr for Camera {
    type Err = ParseError;

    /// `azimuth,elevation[,zoom[,roll]]` in degrees, or a preset's name, `[,zoom[,roll]]` too.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let preset = CameraPreset::ALL.into_iter().find(|preset| preset.name() == parts[0]);
        let mut camera = Self::default();
        let rest = match (preset, parts.as_slice()) {
            (Some(preset), [_, rest @ ..]) => {
                camera.look_from(preset);
                rest
            }
            (None, [azimuth, elevation, rest @ ..]) => {
                camera.azimuth = parse_number(azimuth, "azimuth")?;
                camera.elevation = parse_number(elevation, "elevation")?;
                rest
            }
            _ => return Err(usage(text)),
        };
        match rest {
            [] => {}
            [zoom] => camera.zoom = parse_number(zoom, "zoom")?,
            [zoom, roll] => {
                camera.zoom = parse_number(zoom, "zoom")?;
                camera.roll = parse_number(roll, "roll")?;
            }
            _ => return Err(usage(text)),
        }
        let [least, most] = Self::ZOOM_RANGE;
        if !(least..=most).contains(&camera.zoom) {
            return Err(ParseError(format!("zoom {} is not between {least} and {most}", camera.zoom)));
        }
        if camera.elevation.abs() > 90.0 {
            return Err(ParseError(format!("elevation {} is not between -90 and 90 degrees", camera.elevation)));
        }
        Ok(camera)
    }
}

fn usage(text: &str) -> ParseError {
    let names = CameraPreset::ALL.map(CameraPreset::name).join(", ");
    ParseError(format!("camera `{text}` is neither AZIMUTH,ELEVATION[,ZOOM[,ROLL]] in degrees nor one of {names}"))
}

impl fmt::Display for Camera {
    /// The command line's form; pan and projection have none.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{},{}", self.azimuth, self.elevation, self.zoom)?;
        if self.roll == 0.0 { Ok(()) } else { write!(formatter, ",{}", self.roll) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: Vec3, expected: [f32; 3]) {
        assert!((found - Vec3::from_array(expected)).length() < 1e-6, "{found} is not {expected:?}");
    }

    #[test]
    fn front_looks_at_the_face_with_the_patients_left_to_the_right() {
        let axes = Camera::from_preset(CameraPreset::Front).axes();
        assert_near(axes.forward, [0.0, 1.0, 0.0]);
        assert_near(axes.right, [1.0, 0.0, 0.0]);
        assert_near(axes.up, [0.0, 0.0, 1.0]);
        assert_near(Camera::from_preset(CameraPreset::Left).axes().forward, [-1.0, 0.0, 0.0]);
        assert_near(Camera::from_preset(CameraPreset::Top).axes().up, [0.0, 1.0, 0.0]);
        assert_near(Camera::from_preset(CameraPreset::Bottom).axes().up, [0.0, -1.0, 0.0]);
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed_everywhere() {
        for azimuth in [-170.0, -30.0, 0.0, 77.0, 180.0] {
            for elevation in [-90.0, -20.0, 0.0, 45.0, 90.0] {
                let axes = Camera { azimuth, elevation, roll: 33.0, ..Camera::default() }.axes();
                assert!((axes.right.cross(axes.up) + axes.forward).length() < 1e-5);
                assert!((axes.right.length() - 1.0).abs() < 1e-5 && axes.right.dot(axes.up).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_roll_turns_the_picture_clockwise() {
        let axes = Camera { roll: 90.0, ..Camera::from_preset(CameraPreset::Front) }.axes();
        // What was up now lies to the right.
        assert_near(axes.right, [0.0, 0.0, 1.0]);
    }

    #[test]
    fn typed_forms_are_understood() {
        let camera: Camera = "-30, 15,2".parse().expect("a camera");
        assert_eq!((camera.azimuth, camera.elevation, camera.zoom), (-30.0, 15.0, 2.0));
        assert_eq!(camera.to_string().parse::<Camera>(), Ok(camera));
        assert_eq!("back".parse::<Camera>(), Ok(Camera::from_preset(CameraPreset::Back)));
        let rolled: Camera = "front,3,180".parse().expect("a camera");
        assert_eq!((rolled.zoom, rolled.roll), (3.0, 180.0));
        assert_eq!(rolled.to_string().parse::<Camera>(), Ok(rolled));
        for wrong in ["", "12", "1,2,3,4,5", "a,b", "front,1,2,3", "0,91", "0,0,0", "0,0,-1", "nan,0", "side"] {
            assert!(wrong.parse::<Camera>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn orbit_wraps_and_stops_at_the_poles() {
        let mut camera = Camera::from_preset(CameraPreset::Back);
        camera.orbit(30.0, 100.0);
        assert_eq!((camera.azimuth, camera.elevation), (-150.0, 90.0));
    }
}
