//! How a picture is drawn, whatever it shows.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{Classification, Technique};

/// What a sample says of the step that it stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
pub enum Integration {
    /// The opacity in the middle counts for all of it.
    #[value(name = "post")]
    #[serde(rename = "post")]
    PostClassified,
    /// αd is integrated along the step, so that no boundary is missed, however thin it is and however long the step.
    #[default]
    #[value(name = "pre")]
    #[serde(rename = "pre")]
    Preintegrated,
    /// The same, and where value alone decides, what lies in front within a step hides what lies behind it.
    #[value(name = "pre-2d")]
    #[serde(rename = "pre-2d")]
    FrontToBack,
}

/// Sampling, light and background.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderSettings {
    /// Where the volume is sampled.
    pub technique: Technique,
    /// Distance between samples along a ray, or between slices, in multiples of `L_min`; positive. Where the opacity of
    /// roles is integrated, rays are cut at the borders of cells, and between into pieces of half a step at most.
    pub step: f32,
    /// How samples stand for steps.
    pub integration: Integration,
    /// Whether rays begin at places of their own within the first step, so that what long steps miss shows as grain and
    /// not as rings; slices lie where they lie, and rays that are followed from cell to cell miss nothing.
    pub jitter: bool,
    /// Red, green, blue behind the volume as display values, 0 to 1.
    pub background: [f32; 3],
    /// Whether rays leap over space in which nothing can be drawn; the picture is the same without.
    pub leaps: bool,
    /// Where the light comes from.
    pub light: Light,
    /// How surfaces answer to it.
    pub shading: Shading,
    /// A ray ends once its opacity exceeds this; 1 − 1/512 cannot be told from 1 in an 8-bit picture.
    pub termination_opacity: f32,
    /// Width and height of a saved picture in pixels.
    pub image_size: [u32; 2],
}

impl RenderSettings {
    /// Whether rays are followed from cell to cell, and opacity is integrated along what lies in each; else samples are
    /// taken at equal distances.
    #[must_use]
    pub fn goes_by_cells(&self, classification: Classification) -> bool {
        classification == Classification::Roles && self.integration != Integration::PostClassified
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            technique: Technique::default(),
            step: 0.5,
            integration: Integration::default(),
            jitter: false,
            background: [0.0; 3],
            leaps: true,
            light: Light::default(),
            shading: Shading::default(),
            termination_opacity: 1.0 - 1.0 / 512.0,
            image_size: [1024, 1024],
        }
    }
}

/// One white light, infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Light {
    /// Whether the angles count from the camera's line of sight, or from the world's front.
    pub follows_camera: bool,
    /// To the right, in degrees.
    pub azimuth: f32,
    /// Upwards, in degrees.
    pub elevation: f32,
}

impl Default for Light {
    /// Over the viewer's left shoulder.
    fn default() -> Self {
        Self { follows_camera: true, azimuth: -25.0, elevation: 30.0 }
    }
}

/// Shares of the light that a surface gives back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Shading {
    /// From everywhere, in the surface's colour.
    pub ambient: f32,
    /// `|N·L|`, in the surface's colour; both sides of a boundary are lit alike.
    pub diffuse: f32,
    /// `|N·H|⁸`, in white.
    pub specular: f32,
    /// How much of the light from everywhere and of the lamp's, highlights aside, is kept from places that lie among
    /// others that are drawn: 0 for none, 1 for all of it where they lie the densest.
    pub occlusion: f32,
}

impl Default for Shading {
    fn default() -> Self {
        Self { ambient: 0.3, diffuse: 0.7, specular: 0.25, occlusion: 0.0 }
    }
}
