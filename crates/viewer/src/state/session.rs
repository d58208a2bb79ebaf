//! What the user set, as a file: TOML, in which regions, emphases and cuts are written as they are typed.

use super::{
    Camera, ClipPlane, Clipping, Crop, Curve, Isosurface, MeshFile, ParseError, Region, TransferFunction,
    TwoSidedEmphasis, ViewState,
};
use crate::frame::Frame;
use crate::reference::MAX_IMAGE_SIDE;

impl ViewState {
    /// The file's text.
    ///
    /// # Errors
    /// [`ParseError`] for numbers that TOML has no form for.
    pub fn to_toml(&self) -> Result<String, ParseError> {
        let text = toml::to_string(self).map_err(|error| ParseError(error.to_string()))?;
        Ok(format!(
            "# What voxrole-view shows: `voxrole-view FILE --session THIS`. What is left out is as by default.\n\n{text}"
        ))
    }

    /// What a file says; what it does not say is as by default.
    ///
    /// # Errors
    /// [`ParseError`] with the line of what is not understood.
    pub fn from_toml(text: &str) -> Result<Self, ParseError> {
        let state: Self = toml::from_str(text).map_err(|error| ParseError(shortened(&error.to_string())))?;
        state.check()?;
        Ok(state)
    }

    /// Makes sure that all numbers are what the window and the command line would let them be.
    fn check(&self) -> Result<(), ParseError> {
        let Self { camera, render_settings: settings, clipping, .. } = self;
        let (shading, light) = (settings.shading, settings.light);
        let any = [f32::MIN, f32::MAX];
        let mut numbers = vec![
            ("camera: azimuth", camera.azimuth, any),
            ("camera: elevation", camera.elevation, [-90.0, 90.0]),
            ("camera: roll", camera.roll, any),
            ("camera: zoom", camera.zoom, Camera::ZOOM_RANGE),
            ("camera: field_of_view", camera.field_of_view, Camera::FIELD_OF_VIEW_RANGE),
            ("step", settings.step, Frame::STEP_RANGE),
            ("termination_opacity", settings.termination_opacity, [0.0, 1.0]),
            ("ambient", shading.ambient, [0.0, 1.0]),
            ("diffuse", shading.diffuse, [0.0, 1.0]),
            ("specular", shading.specular, [0.0, 1.0]),
            ("occlusion", shading.occlusion, [0.0, 1.0]),
            ("light: azimuth", light.azimuth, any),
            ("light: elevation", light.elevation, any),
        ];
        numbers.extend(camera.pan.map(|pan| ("camera: pan", pan, [-Camera::FARTHEST_PAN, Camera::FARTHEST_PAN])));
        numbers.extend(settings.background.map(|channel| ("background", channel, [0.0, 1.0])));
        for (name, number, [low, high]) in numbers {
            if !(low..=high).contains(&number) {
                return Err(ParseError(format!("{name} = {number} is not between {low} and {high}")));
            }
        }
        if settings.image_size.iter().any(|side| !(1..=MAX_IMAGE_SIDE).contains(side)) {
            return Err(ParseError(format!(
                "image_size = {:?}: sides are from 1 to {MAX_IMAGE_SIDE}",
                settings.image_size
            )));
        }
        if clipping.planes.len() > Clipping::MOST_PLANES {
            let (found, most) = (clipping.planes.len(), Clipping::MOST_PLANES);
            return Err(ParseError(format!("planes: expected {most} at most, found {found}")));
        }
        let (found, most) = (self.transfer_function.regions.len(), TransferFunction::MOST_REGIONS);
        if found > most {
            return Err(ParseError(format!("regions: expected {most} at most, found {found}")));
        }
        self.scene.check()
    }
}

/// A message without the rest of lines that are too long to be read, as those of painted maps are.
fn shortened(message: &str) -> String {
    const MOST: usize = 160;
    let lines = message.trim_end().lines().map(|line| match line.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line.to_owned(),
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Files hold these as they are typed.
macro_rules! written_as_typed {
    ($($kind:ty),*) => {$(
        impl From<$kind> for String {
            fn from(typed: $kind) -> Self {
                typed.to_string()
            }
        }

        impl TryFrom<String> for $kind {
            type Error = ParseError;

            fn try_from(text: String) -> Result<Self, ParseError> {
                text.parse()
            }
        }
    )*};
}

written_as_typed!(ClipPlane, Crop, Curve, Isosurface, MeshFile, Region, TwoSidedEmphasis);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Integration, PaintedMap, Projection, SavedVolume, Technique};

    #[test]
    fn everything_survives_the_round_trip() {
        let projection = Projection::Orthographic;
        let camera = Camera { azimuth: -12.3, zoom: 0.1, pan: [0.1, -0.2], projection, ..Camera::default() };
        let mut state = ViewState { camera, ..ViewState::default() };
        state.transfer_function.regions = vec![
            "-1000:250.5,0:1e-3,FF8000".parse().expect("a region"),
            "1:2,3:4,00ff00,0.5,0@linear,1,2".parse().expect("a region"),
        ];
        state.transfer_function.emphasis = "concave,1,3,5/linear,0.2,8".parse().expect("an emphasis");
        let mut map = PaintedMap::blank();
        map.stroke([0.1, 0.2], [0.8, 0.9], [0.1, 0.05], false);
        let painted = format!("painted:{map},1:2,3:4,00FF00,0.5@linear,1,2");
        state.transfer_function.regions.push(painted.parse().expect("a region"));
        state.clipping.crop = "10:,:,:40.5".parse().expect("a crop");
        state.clipping.planes = vec!["30,20,0.1".parse().expect("a plane")];
        state.render_settings.technique = Technique::Stacks;
        state.render_settings.integration = Integration::PostClassified;
        state.render_settings.image_size = [1, 16384];
        state.render_settings.shading.occlusion = 0.7;
        state.scene.axes = true;
        state.scene.meshes = vec!["a,b.stl,00FF00".parse().expect("a mesh")];
        state.scene.isosurfaces = vec!["0.1,FF0000".parse().expect("an isosurface")];
        assert!(!state.to_toml().expect("is written").contains("[volume]"));
        state.volume = Some(SavedVolume { name: "a \"b\".nrrd".into(), value_range: [-0.1, 1e300] });
        let text = state.to_toml().expect("is written");
        assert_eq!(ViewState::from_toml(&text), Ok(state), "{text}");
        for line in [
            "zoom = 0.1",
            "technique = \"stacks\"",
            "crop = \"10:,:,:40.5\"",
            "emphasis = \"concave,1,3,5/linear,0.2,8,1\"",
        ] {
            assert!(text.contains(line), "{line} is not in:\n{text}");
        }
    }

    #[test]
    fn what_is_left_out_is_as_by_default() {
        assert_eq!(ViewState::from_toml(""), Ok(ViewState::default()));
        let state = ViewState::from_toml("[camera]\nazimuth = 5\n").expect("a state");
        assert_eq!(state, ViewState { camera: Camera { azimuth: 5.0, ..Camera::default() }, ..ViewState::default() });
    }

    #[test]
    fn what_is_not_understood_is_told_with_its_line() {
        for (text, expected) in [
            ("[camera]\nazimut = 5\n", "unknown field `azimut`"),
            ("[transfer_function]\nregions = [\"1:2,3:4\"]\n", "is not [SHAPE,]v0:v1"),
            ("[camera]\nazimuth = \"left\"\n", "line 2"),
            ("camera", "line 1"),
            ("[camera]\nzoom = 0\n", "zoom = 0 is not between"),
            ("[camera]\nazimuth = nan\n", "azimuth = NaN"),
            ("[render_settings]\nstep = -1\n", "step = -1"),
            ("[render_settings.shading]\nocclusion = 1.5\n", "occlusion = 1.5 is not between 0 and 1"),
            ("[render_settings]\nimage_size = [0, 5]\n", "image_size"),
            ("[clipping]\nplanes = [\"0,0\", \"0,0\", \"0,0\", \"0,0\", \"0,0\"]\n", "4 at most"),
        ] {
            let message = ViewState::from_toml(text).expect_err(text).to_string();
            assert!(message.contains(expected), "{message}");
        }
        let regions = "\"1:2,3:4,FFFFFF\", ".repeat(TransferFunction::MOST_REGIONS + 1);
        let text = format!("[transfer_function]\nregions = [{regions}]\n");
        let message = ViewState::from_toml(&text).expect_err("too many").to_string();
        assert!(message.contains("regions: expected 256 at most, found 257"), "{message}");
        let map = "A".repeat(80_000);
        let text = format!("[transfer_function]\nregions = [\"painted:{map},1:2,3:4,00FF00\"]\n");
        let message = ViewState::from_toml(&text).expect_err("is no map").to_string();
        assert!(message.contains("a map is a PNG") && message.len() < 1000, "{message}");
    }
}
