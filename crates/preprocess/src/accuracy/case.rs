//! What a method is measured on.

use std::fmt;

use voxrole_pack::ScalarType;

use crate::phantom::{Phantom, PhantomSettings, Quantization};

/// A type of number as phantoms are stored in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dtype {
    /// 32-bit floats: the value itself.
    F32,
    /// 215 steps between the plateaus.
    U8,
    /// 3440 steps, as scanners store.
    U12,
    /// 29,000 steps.
    U16,
}

impl Dtype {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::F32, Self::U8, Self::U12, Self::U16];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::U8 => "u8",
            Self::U12 => "u12",
            Self::U16 => "u16",
        }
    }

    const fn scalar_type(self) -> ScalarType {
        match self {
            Self::F32 => ScalarType::F32,
            Self::U8 => ScalarType::U8,
            Self::U12 | Self::U16 => ScalarType::U16,
        }
    }
}

/// One volume that methods are measured on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// The phantom.
    pub phantom: Phantom,
    /// Voxels along each edge; the spacing is 1.
    pub edge: u32,
    /// Standard deviation of the blur in voxels.
    pub blur: f64,
    /// Thickness of the slabs of [`Phantom::SlabPair`] in voxels; of no effect on others.
    pub thickness: f64,
    /// Standard deviation of Gaussian noise as a share of the largest step.
    pub noise: f64,
    /// Type of the stored numbers.
    pub dtype: Dtype,
}

impl Case {
    /// Blur, in voxels, of the case that all others differ from in one respect.
    pub const BASE_BLUR: f64 = 1.5;

    /// A phantom of `edge`³ voxels at its base: blur 1.5, no noise, f32.
    #[must_use]
    pub const fn base(phantom: Phantom, edge: u32) -> Self {
        Self { phantom, edge, blur: Self::BASE_BLUR, thickness: 4.0, noise: 0.0, dtype: Dtype::F32 }
    }

    /// The volume's settings.
    #[must_use]
    pub fn phantom_settings(&self) -> PhantomSettings {
        PhantomSettings {
            dims: [self.edge; 3],
            blur: self.blur,
            thickness: self.thickness,
            noise: self.noise,
            scalar_type: self.dtype.scalar_type(),
            quantization: (self.dtype == Dtype::U12).then_some(Quantization::U12),
            ..PhantomSettings::default()
        }
    }

    /// The same scene without noise, as floats.
    #[must_use]
    pub const fn clean(&self) -> Self {
        Self { noise: 0.0, dtype: Dtype::F32, ..*self }
    }

    /// Whether [`Self::clean`] is another volume.
    #[must_use]
    pub fn is_disturbed(&self) -> bool {
        *self != self.clean()
    }

    /// Whether two cases are the same but for the noise.
    #[must_use]
    pub fn differs_in_noise_alone(&self, other: &Self) -> bool {
        Self { noise: 0.0, ..*self } == Self { noise: 0.0, ..*other }
    }

    /// Whether two cases are the same but for the blur.
    #[must_use]
    pub fn differs_in_blur_alone(&self, other: &Self) -> bool {
        Self { blur: 1.0, ..*self } == Self { blur: 1.0, ..*other }
    }

    /// Whether two cases are the same but for the thickness.
    #[must_use]
    pub fn differs_in_thickness_alone(&self, other: &Self) -> bool {
        Self { thickness: 1.0, ..*self } == Self { thickness: 1.0, ..*other }
    }
}

impl fmt::Display for Case {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.phantom.name())?;
        if self.phantom == Phantom::SlabPair {
            write!(formatter, " {} voxels thick", self.thickness)?;
        }
        write!(formatter, ", {}³", self.edge)?;
        if self.phantom != Phantom::MarschnerLobb {
            write!(formatter, ", blur {}", self.blur)?;
        }
        let noise = if self.noise > 0.0 { format!("noise {} %", 100.0 * self.noise) } else { "no noise".to_owned() };
        write!(formatter, ", {noise}, {}", self.dtype.name())
    }
}
