//! From voxel roles in working units to a packed file in physical ones.

use std::path::Path;

use voxrole_pack::header::{Parameter, Source, Statistics};
use voxrole_pack::layer::Quantization;
use voxrole_pack::scalar::par_range_within;
use voxrole_pack::writer::Description;
use voxrole_pack::{
    DistanceQuantization, Histogram, HistogramAxis, HitGradientQuantization, Layer, LayerKind, ScalarType, Writer,
    with_scalars,
};

use crate::automatic::Choice;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::joint_histogram::{BINS, Binning, DISTANCE_BINS, Quantities, count, value_axis, widened};
use crate::roles::{MASKED, Roles};
use crate::settings::Settings;
use crate::smoothing::RangeSigmas;
use crate::working_field::{WorkingField, voxels};
use crate::{Error, Grid, Result};

/// Name and version of the program, as written into every file.
pub const MADE_BY: &str = concat!("voxrole ", env!("CARGO_PKG_VERSION"));

/// A volume's roles, ready to be packed.
pub struct Prepared<'a> {
    /// The input.
    pub grid: &'a Grid,
    /// Smallest and largest finite number of the input, as stored.
    pub stored_range: Option<[f64; 2]>,
    /// What shaped the result, with what was chosen by the data.
    pub settings: Settings,
    /// What was found in the data and chosen by it.
    pub choice: Option<Choice>,
    /// What the user should know of the result.
    pub warning: Option<String>,
    /// The value field that was differentiated.
    pub field: WorkingField,
    /// Its derivatives, smoothed where the settings say so.
    pub derivatives: Derivatives,
    /// The roles.
    pub roles: Roles,
    /// Estimated noise of the input, in working units.
    pub noise: f32,
    /// σr of the bilaterally filtered fields.
    pub range_sigmas: RangeSigmas,
}

impl Prepared<'_> {
    /// `d_max` in world units.
    #[must_use]
    pub fn d_max(&self) -> f32 {
        (self.settings.d_max * self.field.smallest_spacing) as f32
    }

    /// Writes the packed file and returns its length in bytes.
    ///
    /// # Errors
    /// [`Error::Pack`] when writing fails, [`Error::Parameter`] when derivatives of these values leave the range of f32.
    pub fn write(self, path: &Path) -> Result<u64> {
        let extremes = Extremes::new(&self);
        // What only one thread can do, hashing and handing bytes to the system, goes on beside the rest.
        let ((writer, histograms), voxels_sha256) = rayon::join(
            || rayon::join(|| self.write_layers(path, &extremes), || self.histograms(&extremes)),
            || self.grid.voxels_sha256(),
        );
        let mut writer = writer?;
        writer.write_histograms(histograms)?;
        let description = self.description(&extremes, voxels_sha256);
        // Memory is given back while the disk is waited for.
        let Self { field, derivatives, roles, .. } = self;
        let (file_bytes, _) =
            rayon::join(|| writer.finish(description), || rayon::join(|| drop((field, derivatives)), || drop(roles)));
        Ok(file_bytes?)
    }

    fn write_layers(&self, path: &Path, extremes: &Extremes) -> Result<Writer> {
        let mut writer = Writer::create(path, self.grid.geometry.clone())?;
        let (slope, intercept) = (self.grid.slope, self.grid.intercept);
        let layer = Layer {
            kind: LayerKind::Value,
            scalar_type: self.grid.scalars.scalar_type(),
            quantization: Quantization::Linear { slope, intercept },
        };
        with_scalars!(&self.grid.scalars, values => writer.write_layer(layer, values)?);
        self.write_roles(&mut writer, extremes)?;
        if self.settings.keep_derivatives {
            self.write_derivatives(&mut writer, extremes)?;
        }
        Ok(writer)
    }

    fn write_roles(&self, writer: &mut Writer, extremes: &Extremes) -> Result<()> {
        let quantization = DistanceQuantization { d_max: self.d_max() };
        let world_from_working = self.field.smallest_spacing;
        let layer = Layer {
            kind: LayerKind::Distance,
            scalar_type: ScalarType::I16,
            quantization: Quantization::Distance(quantization),
        };
        writer.write_encoded_layer(layer, &self.roles.distance, move |distance| match distance {
            MASKED => DistanceQuantization::MASKED,
            distance if distance.is_nan() => DistanceQuantization::NO_BOUNDARY,
            distance => quantization.encode((f64::from(distance) * world_from_working) as f32),
        })?;

        let quantization = self.hit_gradient_quantization(extremes)?;
        let layer = Layer {
            kind: LayerKind::HitGradient,
            scalar_type: ScalarType::U16,
            quantization: Quantization::HitGradient(quantization),
        };
        let scale = self.field.gradient_scale();
        writer.write_encoded_layer(layer, &self.roles.hit_gradient, move |g: f32| {
            if g.is_nan() { 0 } else { quantization.encode((f64::from(g) * scale) as f32) }
        })?;

        let layer =
            Layer { kind: LayerKind::Normal, scalar_type: ScalarType::U16, quantization: Quantization::Octahedral };
        writer.write_layer(layer, &self.roles.normal)?;
        Ok(())
    }

    fn write_derivatives(&self, writer: &mut Writer, extremes: &Extremes) -> Result<()> {
        let Derivatives { gradient_magnitude, second_derivative } = &self.derivatives;
        for (kind, field, largest, scale) in [
            (LayerKind::GradientMagnitude, gradient_magnitude, extremes.gradient, self.field.gradient_scale()),
            (
                LayerKind::SecondDerivative,
                second_derivative,
                extremes.second_derivative,
                self.field.second_derivative_scale(),
            ),
        ] {
            let layer = Layer {
                kind,
                scalar_type: ScalarType::F32,
                quantization: Quantization::Linear { slope: 1.0, intercept: 0.0 },
            };
            let physical = move |working: f32| (f64::from(working) * scale) as f32;
            if physical(largest).is_infinite() {
                return Err(Error::Parameter(format!(
                    "{}: `{}` leaves the range of f32; scale the values or the spacing down",
                    self.grid.name,
                    kind.name()
                )));
            }
            writer.write_encoded_layer(layer, voxels(field), physical)?;
        }
        Ok(())
    }

    fn hit_gradient_quantization(&self, extremes: &Extremes) -> Result<HitGradientQuantization> {
        let [low, high] = extremes.hit_gradient.map(|g| self.physical_gradient(g) as f32);
        if high.is_infinite() {
            return Err(Error::Parameter(format!(
                "{}: the gradient magnitude at boundaries leaves the range of f32; scale the values or the spacing down",
                self.grid.name
            )));
        }
        Ok(HitGradientQuantization { low, high })
    }

    fn physical_gradient(&self, working: f32) -> f64 {
        f64::from(working) * self.field.gradient_scale()
    }

    fn largest_gradient(&self, extremes: &Extremes) -> f64 {
        // A spline may be steeper between the voxels than on any of them.
        self.physical_gradient(extremes.gradient.max(extremes.hit_gradient[1]))
    }

    /// The histograms of every voxel, before anything is quantised.
    fn histograms(&self, extremes: &Extremes) -> Vec<Histogram> {
        let field = &self.field;
        let largest_gradient = self.largest_gradient(extremes);
        let gradient_axis = if largest_gradient > 0.0 {
            widened(0.0, largest_gradient, BINS)
        } else {
            HistogramAxis { low: 0.0, high: 1.0, bins: BINS }
        };
        let largest_f2 = f64::from(extremes.second_derivative) * field.second_derivative_scale();
        let d_max = f64::from(self.d_max());
        let value_axis = value_axis(self.grid, self.stored_range.unwrap_or([0.0, 1.0]));
        let binning = |slope, intercept, axis| Binning { slope, intercept, axis };
        count(&Quantities {
            value: (&self.grid.scalars, binning(self.grid.slope, self.grid.intercept, value_axis)),
            gradient: (
                voxels(&self.derivatives.gradient_magnitude),
                binning(field.gradient_scale(), 0.0, gradient_axis),
            ),
            second_derivative: (
                voxels(&self.derivatives.second_derivative),
                binning(field.second_derivative_scale(), 0.0, widened(-largest_f2, largest_f2, BINS)),
            ),
            hit_gradient: &self.roles.hit_gradient,
            hit_value: (&self.roles.hit_value, binning(field.value_scale, field.value_offset, value_axis)),
            distance: (
                &self.roles.distance,
                binning(field.smallest_spacing, 0.0, HistogramAxis { low: -d_max, high: d_max, bins: DISTANCE_BINS }),
            ),
        })
    }

    fn description(&self, extremes: &Extremes, voxels_sha256: [u8; 32]) -> Description {
        let ends = self.stored_range.unwrap_or_default().map(|end| self.grid.slope.mul_add(end, self.grid.intercept));
        Description {
            made_by: MADE_BY.into(),
            source: Source { name: self.grid.name.clone(), voxels_sha256 },
            parameters: self.parameters(),
            statistics: Statistics {
                value_range: [ends[0].min(ends[1]), ends[0].max(ends[1])],
                max_gradient: self.largest_gradient(extremes),
                hits: self.roles.hits,
                misses: self.roles.misses(),
                masked: self.roles.masked,
            },
        }
    }

    /// What shaped the result; skipping and threads do not.
    fn parameters(&self) -> Vec<Parameter> {
        let Settings { method, smoothing, kernel, reconstruction, climb, step, d_max, noise_floor, .. } = self.settings;
        let mut parameters = vec![
            ("method", method.to_string()),
            ("smooth", smoothing.placement.to_string()),
            ("derivative", kernel.to_string()),
            ("reconstruction", reconstruction.to_string()),
            ("root", self.settings.root_finder.name().to_owned()),
            ("climb", climb.to_string()),
            ("step", format!("{step} L_min")),
            ("dmax", format!("{d_max} L_min")),
            ("noise", format!("{:.6e} (estimated)", f64::from(self.noise) * self.field.value_scale)),
            ("noise-floor", format!("{noise_floor} times the gradient noise")),
        ];
        if smoothing.placement != crate::settings::Smoothing::None {
            parameters.push(("spatial-sigma", format!("{} L_min", smoothing.spatial_sigma)));
            parameters.push(("radius", format!("{} voxels", smoothing.radius)));
        }
        if self.settings.operator == EdgeOperator::Plus {
            parameters.push(("edge", "plus".into()));
        }
        if let Some(blur) = self.choice.as_ref().and_then(|choice| choice.blur) {
            parameters.push(("blur", format!("{blur:.3} L_min (estimated)")));
        }
        for sigma in &self.range_sigmas {
            parameters.push(("range-sigma", format!("{:.6} of the range of {}", sigma.share, sigma.field)));
        }
        parameters.into_iter().map(|(name, value)| Parameter { name: name.into(), value }).collect()
    }
}

/// What axes and quantisations are made of, in working units.
struct Extremes {
    /// Largest gradient magnitude of a voxel; 0 if there is none.
    gradient: f32,
    /// Largest magnitude of a second derivative; 0 if there is none.
    second_derivative: f32,
    /// Smallest and largest gradient magnitude at a hit; 0 if there is none.
    hit_gradient: [f32; 2],
}

impl Extremes {
    fn new(prepared: &Prepared<'_>) -> Self {
        let range = |values| par_range_within(values, f32::NEG_INFINITY, f32::INFINITY).unwrap_or_default();
        let Derivatives { gradient_magnitude, second_derivative } = &prepared.derivatives;
        let [lowest, highest] = range(voxels(second_derivative));
        Self {
            gradient: range(voxels(gradient_magnitude))[1],
            second_derivative: lowest.abs().max(highest.abs()),
            hit_gradient: range(&prepared.roles.hit_gradient),
        }
    }
}
