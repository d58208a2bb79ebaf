//! From voxel roles in working units to a packed file in physical ones.

use std::path::Path;

use rayon::prelude::*;
use voxrole_pack::header::{Parameter, Source, Statistics};
use voxrole_pack::layer::Quantization;
use voxrole_pack::writer::Description;
use voxrole_pack::{
    DistanceQuantization, Histogram, HistogramAxis, HistogramKind, HitGradientQuantization, Layer, LayerKind,
    ScalarType, Writer, with_scalars,
};

use crate::automatic::Choice;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::joint_histogram::{BINS, DISTANCE_BINS, count, value_axis, widened};
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
    pub fn write(&self, path: &Path) -> Result<u64> {
        let mut writer = Writer::create(path, self.grid.geometry.clone())?;
        self.write_value(&mut writer)?;
        self.write_roles(&mut writer)?;
        if self.settings.keep_derivatives {
            self.write_derivatives(&mut writer)?;
        }
        for histogram in self.histograms() {
            writer.write_histogram(histogram)?;
        }
        Ok(writer.finish(self.description())?)
    }

    fn write_value(&self, writer: &mut Writer) -> Result<()> {
        let (slope, intercept) = (self.grid.slope, self.grid.intercept);
        let layer = Layer {
            kind: LayerKind::Value,
            scalar_type: self.grid.scalars.scalar_type(),
            quantization: Quantization::Linear { slope, intercept },
        };
        use voxrole_pack::scalar::Scalar;
        with_scalars!(&self.grid.scalars, values => {
            writer.write_layer(layer, values, |value| Some(slope.mul_add(value.to_f64(), intercept)))?;
        });
        Ok(())
    }

    fn write_roles(&self, writer: &mut Writer) -> Result<()> {
        let quantization = DistanceQuantization { d_max: self.d_max() };
        let world_from_working = self.field.smallest_spacing;
        let stored: Vec<i16> = self
            .roles
            .distance
            .par_iter()
            .map(|&distance| match distance {
                MASKED => DistanceQuantization::MASKED,
                distance if distance.is_nan() => DistanceQuantization::NO_BOUNDARY,
                distance => quantization.encode((f64::from(distance) * world_from_working) as f32),
            })
            .collect();
        let layer = Layer {
            kind: LayerKind::Distance,
            scalar_type: ScalarType::I16,
            quantization: Quantization::Distance(quantization),
        };
        writer.write_layer(layer, &stored, |stored| quantization.decode(stored).map(f64::from))?;
        drop(stored);

        let quantization = self.hit_gradient_quantization()?;
        let stored: Vec<u16> = self
            .roles
            .hit_gradient
            .par_iter()
            .map(|&g| if g.is_nan() { 0 } else { quantization.encode(self.physical_gradient(g) as f32) })
            .collect();
        let layer = Layer {
            kind: LayerKind::HitGradient,
            scalar_type: ScalarType::U16,
            quantization: Quantization::HitGradient(quantization),
        };
        writer.write_layer(layer, &stored, |stored| quantization.decode(stored).map(f64::from))?;

        let layer =
            Layer { kind: LayerKind::Normal, scalar_type: ScalarType::U16, quantization: Quantization::Octahedral };
        writer.write_layer(layer, &self.roles.normal, |_| None)?;
        Ok(())
    }

    fn write_derivatives(&self, writer: &mut Writer) -> Result<()> {
        for (kind, field, scale) in [
            (LayerKind::GradientMagnitude, &self.derivatives.gradient_magnitude, self.field.gradient_scale()),
            (LayerKind::SecondDerivative, &self.derivatives.second_derivative, self.field.second_derivative_scale()),
        ] {
            let layer = Layer {
                kind,
                scalar_type: ScalarType::F32,
                quantization: Quantization::Linear { slope: 1.0, intercept: 0.0 },
            };
            let physical: Vec<f32> = voxels(field).par_iter().map(|&value| (f64::from(value) * scale) as f32).collect();
            if physical.par_iter().any(|value| value.is_infinite()) {
                return Err(Error::Parameter(format!(
                    "{}: `{}` leaves the range of f32; scale the values or the spacing down",
                    self.grid.name,
                    kind.name()
                )));
            }
            writer.write_layer(layer, &physical, |value| Some(f64::from(value)))?;
        }
        Ok(())
    }

    fn hit_gradient_quantization(&self) -> Result<HitGradientQuantization> {
        let hits = self.roles.hit_gradient.iter().filter(|g| !g.is_nan());
        let (low, high) = hits.fold((f32::INFINITY, 0.0_f32), |(low, high), &g| (low.min(g), high.max(g)));
        let [low, high] = [low.min(high), high].map(|g| self.physical_gradient(g) as f32);
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

    fn largest_gradient(&self) -> f64 {
        // A spline may be steeper between the voxels than on any of them.
        let all = voxels(&self.derivatives.gradient_magnitude).iter().chain(&self.roles.hit_gradient);
        let largest = all.copied().fold(0.0, f32::max);
        self.physical_gradient(largest)
    }

    /// The histograms of every voxel, before anything is quantised.
    fn histograms(&self) -> Vec<Histogram> {
        let g = voxels(&self.derivatives.gradient_magnitude);
        let f2 = voxels(&self.derivatives.second_derivative);
        let roles = &self.roles;
        let count_all = |kind, axes, position: &(dyn Fn(usize) -> [f64; 2] + Sync)| {
            count(kind, axes, g.len(), |voxel| Some(position(voxel)).filter(|[x, y]| x.is_finite() && y.is_finite()))
        };
        let value = |voxel: usize| self.grid.physical(voxel);
        let gradient = |working: f32| self.physical_gradient(working);
        let f2_scale = self.field.second_derivative_scale();
        let largest_f2 = f64::from(f2.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()))) * f2_scale;
        let d_max = f64::from(self.d_max());
        let value_axis = value_axis(self.grid);
        let gradient_axis = if self.largest_gradient() > 0.0 {
            widened(0.0, self.largest_gradient(), BINS)
        } else {
            HistogramAxis { low: 0.0, high: 1.0, bins: BINS }
        };
        let f2_axis = widened(-largest_f2, largest_f2, BINS);
        vec![
            count_all(HistogramKind::ValueGradient, vec![value_axis, gradient_axis], &|voxel| {
                [value(voxel), gradient(g[voxel])]
            }),
            count_all(HistogramKind::ValueSecondDerivative, vec![value_axis, f2_axis], &|voxel| {
                [value(voxel), f64::from(f2[voxel]) * f2_scale]
            }),
            count_all(HistogramKind::ValueHitGradient, vec![value_axis, gradient_axis], &|voxel| {
                [value(voxel), gradient(roles.hit_gradient[voxel])]
            }),
            count_all(HistogramKind::HitValueHitGradient, vec![value_axis, gradient_axis], &|voxel| {
                let at_hit = f64::from(roles.hit_value[voxel]);
                [at_hit.mul_add(self.field.value_scale, self.field.value_offset), gradient(roles.hit_gradient[voxel])]
            }),
            count_all(
                HistogramKind::Distance,
                vec![HistogramAxis { low: -d_max, high: d_max, bins: DISTANCE_BINS }],
                &|voxel| [f64::from(roles.distance[voxel]) * self.field.smallest_spacing, 0.0],
            ),
        ]
    }

    fn description(&self) -> Description {
        let [low, high] = self.grid.scalars.finite_range().unwrap_or_default();
        let ends = [low, high].map(|end| self.grid.slope.mul_add(end, self.grid.intercept));
        Description {
            made_by: MADE_BY.into(),
            source: Source { name: self.grid.name.clone(), voxels_sha256: self.grid.voxels_sha256() },
            parameters: self.parameters(),
            statistics: Statistics {
                value_range: [ends[0].min(ends[1]), ends[0].max(ends[1])],
                max_gradient: self.largest_gradient(),
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
