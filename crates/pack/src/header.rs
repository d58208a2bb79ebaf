//! What a packed file says of itself.

use serde::{Deserialize, Serialize};

use crate::geometry::GridGeometry;
use crate::histogram::HistogramShape;
use crate::layer::{Layer, LayerKind, Quantization};
use crate::levels::MOST_LEVELS;
use crate::limits::Limits;
use crate::quantization::{DistanceQuantization, HitGradientQuantization};
use crate::scalar::ScalarType;
use crate::{Error, Result};

/// Where the volume came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// The input's file name, without folders.
    pub name: String,
    /// SHA-256 of the input's voxels alone: in their own type, little-endian, x fastest.
    pub voxels_sha256: [u8; 32],
}

impl Source {
    /// The hash as 64 hexadecimal digits.
    #[must_use]
    pub fn voxels_sha256_hex(&self) -> String {
        self.voxels_sha256.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// One setting that shaped the file, by the name it has on the command line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value, with unit where it has one.
    pub value: String,
}

/// Deterministic figures of the run that made the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Range of the finite physical values.
    pub value_range: [f64; 2],
    /// Largest gradient magnitude at any voxel, in value units per world unit.
    pub max_gradient: f64,
    /// Voxels with a boundary within `d_max`.
    pub hits: u64,
    /// Voxels without.
    pub misses: u64,
    /// Voxels whose stencil holds NaN or ±Inf.
    pub masked: u64,
}

/// The header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Program and version that made the file.
    pub made_by: String,
    /// Where the volume came from.
    pub source: Source,
    /// Where the voxels lie, on the finest level.
    pub geometry: GridGeometry,
    /// How many levels of detail there are, from 1 on; see [`crate::levels`].
    pub levels: u32,
    /// Settings, in the order of the command line's help.
    pub parameters: Vec<Parameter>,
    /// Figures of the run.
    pub statistics: Statistics,
    /// The layers, in the directory's order.
    pub layers: Vec<Layer>,
    /// The histograms, in the directory's order.
    pub histograms: Vec<HistogramShape>,
}

impl Header {
    /// The layer of a kind, and its place in the directory.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has none.
    pub fn layer(&self, kind: LayerKind) -> Result<(usize, &Layer)> {
        self.layers.iter().enumerate().find(|(_, layer)| layer.kind == kind).ok_or_else(|| {
            let hint = match kind {
                LayerKind::GradientMagnitude | LayerKind::SecondDerivative => {
                    ": prepare the volume again with `--keep derivatives`"
                }
                _ => "",
            };
            Error::Parameter(format!("the file has no layer `{}`{hint}", kind.name()))
        })
    }

    /// Checks that every number makes sense and stays within `limits`.
    ///
    /// # Errors
    /// [`Error::Format`] for a nonsensical number, [`Error::LimitsExceeded`] for one that asks for too much memory.
    pub fn validate(&self, limits: &Limits) -> Result<()> {
        self.geometry.validate()?;
        if !(1..=MOST_LEVELS).contains(&self.levels) {
            return Err(Error::Format(format!("{} levels of detail: expected 1 to {MOST_LEVELS}", self.levels)));
        }
        let voxels = self.geometry.voxel_count() as u64;
        check("voxels", voxels, limits.max_voxels)?;
        for (index, layer) in self.layers.iter().enumerate() {
            check("bytes of a layer", voxels * layer.scalar_type.size_in_bytes() as u64, limits.max_layer_bytes)?;
            if self.layers[..index].iter().any(|earlier| earlier.kind == layer.kind) {
                return Err(Error::Format(format!("layer `{}` is there twice", layer.kind.name())));
            }
            validate_quantization(layer)?;
        }
        for (index, shape) in self.histograms.iter().enumerate() {
            if self.histograms[..index].iter().any(|earlier| earlier.kind == shape.kind) {
                return Err(Error::Format(format!("histogram `{}` is there twice", shape.kind.name())));
            }
            let bins = shape.bin_count().unwrap_or(u64::MAX);
            check("bins of a histogram", bins, limits.max_histogram_bins)?;
            let usable = shape.axes.len() == shape.kind.axis_count()
                && shape
                    .axes
                    .iter()
                    .all(|axis| axis.bins > 0 && axis.low.is_finite() && axis.high.is_finite() && axis.low < axis.high);
            if !usable {
                return Err(Error::Format(format!("histogram `{}` has no usable axes", shape.kind.name())));
            }
        }
        Ok(())
    }
}

fn check(what: &'static str, found: u64, limit: u64) -> Result<()> {
    if found > limit { Err(Error::LimitsExceeded { what, found, limit }) } else { Ok(()) }
}

fn validate_quantization(layer: &Layer) -> Result<()> {
    let float = |value: f32| value.is_finite();
    let usable = match (layer.kind, layer.quantization) {
        (LayerKind::Value, Quantization::Linear { slope, intercept }) => {
            slope.is_finite() && slope != 0.0 && intercept.is_finite()
        }
        (LayerKind::GradientMagnitude | LayerKind::SecondDerivative, Quantization::Linear { slope, intercept }) => {
            layer.scalar_type == ScalarType::F32 && slope == 1.0 && intercept == 0.0
        }
        (LayerKind::Distance, Quantization::Distance(DistanceQuantization { d_max, steps })) => {
            let range = DistanceQuantization::FEWEST_STEPS..=DistanceQuantization::MOST_STEPS;
            float(d_max) && d_max > 0.0 && range.contains(&steps)
        }
        (LayerKind::HitGradient, Quantization::HitGradient(HitGradientQuantization { low, high, steps })) => {
            let range = HitGradientQuantization::FEWEST_STEPS..=HitGradientQuantization::MOST_STEPS;
            float(low) && float(high) && 0.0 <= low && low <= high && range.contains(&steps)
        }
        (LayerKind::Normal, Quantization::Octahedral) => true,
        _ => false,
    };
    let typed = layer.quantization.scalar_type().is_none_or(|scalar_type| scalar_type == layer.scalar_type);
    if usable && typed && layer.error_bound.is_finite() && layer.error_bound >= 0.0 {
        Ok(())
    } else {
        Err(Error::Format(format!("layer `{}` is described nonsensically: {layer:?}", layer.kind.name())))
    }
}
