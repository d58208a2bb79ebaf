//! From blocks in working units to a packed file in physical ones.

use std::path::Path;

use sha2::{Digest, Sha256};
use voxrole_pack::header::{Parameter, Source, Statistics};
use voxrole_pack::layer::Quantization;
use voxrole_pack::levels::usual_levels;
use voxrole_pack::packed_brick::{PackedBrick, PackedLayerBrick, PackedMask, pack_bricks};
use voxrole_pack::quantization::narrow_distance;
use voxrole_pack::scalar::par_range_within;
use voxrole_pack::unfinished::Unfinished;
use voxrole_pack::writer::Description;
use voxrole_pack::{
    DistanceQuantization, HistogramAxis, HitGradientQuantization, Layer, LayerKind, ScalarType, Scalars, Writer,
    with_scalar_type, with_scalars,
};

use crate::assembly::FinishedBricks;
use crate::block_plan::BlockPlan;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::joint_histogram::{Axes, Binning, DISTANCE_BINS, Quantities, Tally, value_axis};
use crate::recipe::{Block, Recipe, Spare};
use crate::roles::{MASKED, Roles};
use crate::scan;
use crate::settings::Settings;
use crate::source::cropped;
use crate::summary::Summary;
use crate::working_field::{voxels, voxels_mut};
use crate::{Error, Result};

/// Name and version of the program, as written into every file.
pub const MADE_BY: &str = concat!("voxrole ", env!("CARGO_PKG_VERSION"));

/// Where unfinished blocks have the gradient magnitude at the hit, the only layer whose numbers depend on all of the volume:
/// as f32, in working units.
const HIT_GRADIENT: usize = 2;

/// What a recipe's file looks like.
pub struct Packing<'r, 'a>(pub &'r Recipe<'a>);

impl Packing<'_, '_> {
    /// `d_max` in world units.
    #[must_use]
    pub fn d_max(&self) -> f32 {
        (self.0.settings.d_max * self.0.scaling.smallest_spacing()) as f32
    }

    /// The axes of the histograms, as far as they are known beforehand.
    #[must_use]
    pub fn axes(&self) -> Axes {
        let Recipe { source, scan, scaling, .. } = self.0;
        let value = value_axis(source, scan.range);
        let d_max = f64::from(self.d_max());
        let distance = HistogramAxis { low: -d_max, high: d_max, bins: DISTANCE_BINS };
        Axes {
            value: Binning { slope: source.slope, intercept: source.intercept, axis: value },
            hit_value: Binning { slope: scaling.value_scale(), intercept: scaling.value_offset(), axis: value },
            distance: Binning { slope: scaling.smallest_spacing(), intercept: 0.0, axis: distance },
            gradient_scale: scaling.gradient_scale(),
            second_derivative_scale: scaling.second_derivative_scale(),
        }
    }

    /// Packs a volume that is one block, and returns the file's length in bytes and what it says of all voxels.
    ///
    /// # Errors
    /// [`Error::Pack`] when writing fails, [`Error::Parameter`] when derivatives of these values leave the range of f32.
    pub fn write(&self, block: Block<'_>, path: &Path) -> Result<(u64, Summary)> {
        let hit_gradient = hit_gradient_range(&block.roles);
        // What only one thread can do, hashing and handing bytes to the system, goes on beside the rest.
        let ((writer, tally), voxels_sha256) = rayon::join(
            || {
                let Derivatives { gradient_magnitude, second_derivative } = &block.derivatives;
                let derivatives = [voxels(gradient_magnitude), voxels(second_derivative)];
                rayon::join(
                    || self.write_layers(path, &block, hit_gradient),
                    || self.tally(&block.scalars, derivatives, &block.roles),
                )
            },
            || {
                let mut hasher = Sha256::new();
                scan::hash(&block.scalars, &mut hasher);
                hasher.finalize().into()
            },
        );
        let mut writer = writer?;
        let Block { scalars, field, derivatives, roles, counts, edges, spare, .. } = block;
        let summary = Summary { counts, hit_gradient, tally, edges };
        writer.write_histograms(summary.tally.histograms(&self.axes()))?;
        let description = self.description(&summary, voxels_sha256);
        // Memory is given back while the disk is waited for.
        let (file_bytes, _) = rayon::join(
            || writer.finish(description),
            || rayon::join(|| drop((scalars, field, derivatives, spare)), || drop(roles)),
        );
        Ok((file_bytes?, summary))
    }

    fn write_layers(&self, path: &Path, block: &Block<'_>, hit_gradient: Option<[f32; 2]>) -> Result<Writer> {
        let Block { derivatives, roles, .. } = block;
        let mut writer = self.writer(path)?;
        with_scalars!(&*block.scalars, values => writer.write_layer(self.value_layer(), values)?);
        let (layer, encode) = self.distance_layer();
        if layer.scalar_type == ScalarType::I8 {
            writer.write_encoded_layer(layer, &roles.distance, move |d| narrow_distance(encode(d)))?;
        } else {
            writer.write_encoded_layer(layer, &roles.distance, encode)?;
        }
        let (layer, encode) = self.hit_gradient_layer(hit_gradient)?;
        if layer.scalar_type == ScalarType::U8 {
            writer.write_encoded_layer(layer, &roles.hit_gradient, move |g| encode(g) as u8)?;
        } else {
            writer.write_encoded_layer(layer, &roles.hit_gradient, encode)?;
        }
        writer.write_layer(normal_layer(), &roles.normal)?;
        if self.0.settings.keep_derivatives {
            let Derivatives { gradient_magnitude, second_derivative } = derivatives;
            let derivatives = [voxels(gradient_magnitude), voxels(second_derivative)];
            for (layer, field, scale) in self.derivative_layers(derivatives)? {
                writer.write_encoded_layer(layer, field, to_physical(scale))?;
            }
        }
        Ok(writer)
    }

    fn writer(&self, path: &Path) -> Result<Writer> {
        let geometry = self.0.source.geometry;
        let levels = self.0.settings.levels.unwrap_or_else(|| usual_levels(geometry.dims));
        Ok(Writer::create(path, geometry.clone(), levels)?)
    }

    /// Packs one block of several: its bricks, layer by layer and the masks behind them, and what is to be said of its voxels.
    /// The block's memory is handed back.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn pack(&self, mut block: Block<'_>) -> Result<(Vec<Vec<PackedBrick>>, Summary, Spare)> {
        let Block { interior, padded, scalars, derivatives, roles, .. } = &mut block;
        let (dims, inner, padded) = (interior.dims(), interior.within(padded), padded.dims());
        let scalars = cropped(scalars, padded, &inner);
        let Derivatives { gradient_magnitude, second_derivative } = derivatives;
        let derivatives =
            [gradient_magnitude, second_derivative].map(|field| &*inner.gather(voxels_mut(field), padded));
        let value = self.value_layer();
        let mut layers = vec![
            with_scalars!(&*scalars, values => only_bricks(pack_bricks(&value, dims, values, |value| value, &[])?)),
        ];
        let (layer, encode) = self.distance_layer();
        let (distance, masks) = if layer.scalar_type == ScalarType::I8 {
            with_masks(pack_bricks(&layer, dims, &roles.distance, move |d| narrow_distance(encode(d)), &[])?)
        } else {
            with_masks(pack_bricks(&layer, dims, &roles.distance, encode, &[])?)
        };
        layers.push(distance);
        layers.push(only_bricks(pack_bricks(&working_layer(), dims, &roles.hit_gradient, |g| g, &[])?));
        let (masks, bits): (Vec<_>, Vec<_>) = masks.into_iter().map(|mask| (mask.brick, mask.bits_crc32)).unzip();
        layers.push(only_bricks(pack_bricks(&normal_layer(), dims, &roles.normal, |normal| normal, &bits)?));
        if self.0.settings.keep_derivatives {
            for (layer, field, scale) in self.derivative_layers(derivatives)? {
                layers.push(only_bricks(pack_bricks(&layer, dims, field, to_physical(scale), &[])?));
            }
        }
        layers.push(masks);
        let (hit_gradient, tally) = (hit_gradient_range(roles), self.tally(&scalars, derivatives, roles));
        let summary = Summary { counts: block.counts, hit_gradient, tally, edges: block.edges.take() };
        Ok((layers, summary, block.into_spare()))
    }

    /// Makes the packed file of finished blocks, and returns its length in bytes.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn assemble(
        &self,
        unfinished: &Unfinished,
        plan: &BlockPlan,
        summary: &Summary,
        voxels_sha256: [u8; 32],
        path: &Path,
    ) -> Result<u64> {
        let mut writer = self.writer(path)?;
        let (hit_gradient, encode) = self.hit_gradient_layer(summary.hit_gradient)?;
        let mut layers = vec![self.value_layer(), self.distance_layer().0, hit_gradient, normal_layer()];
        if self.0.settings.keep_derivatives {
            layers.extend(derivative_layers());
        }
        let finished = FinishedBricks::new(unfinished, plan, self.0.source.dims(), layers.len());
        for (index, layer) in layers.iter().enumerate() {
            match (index, layer.scalar_type) {
                (HIT_GRADIENT, ScalarType::U8) => {
                    finished.encode(&mut writer, layer, index, move |g| encode(g) as u8)?
                }
                (HIT_GRADIENT, _) => finished.encode(&mut writer, layer, index, encode)?,
                (_, scalar_type) => {
                    with_scalar_type!(scalar_type, T => finished.copy::<T>(&mut writer, layer, index)?);
                }
            }
        }
        writer.write_histograms(summary.tally.histograms(&self.axes()))?;
        Ok(writer.finish(self.description(summary, voxels_sha256))?)
    }

    fn value_layer(&self) -> Layer {
        let source = &self.0.source;
        let mapping = Quantization::Linear { slope: source.slope, intercept: source.intercept };
        Layer::new(LayerKind::Value, source.scalar_type(), mapping)
    }

    fn distance_layer(&self) -> (Layer, impl Fn(f32) -> i16 + Copy + Sync + use<>) {
        let quantization = DistanceQuantization::new(self.d_max(), self.0.settings.precision);
        let world_from_working = self.0.scaling.smallest_spacing();
        let layer = Layer::new(LayerKind::Distance, ScalarType::I16, Quantization::Distance(quantization));
        let encode = move |distance: f32| match distance {
            MASKED => DistanceQuantization::MASKED,
            distance if distance.is_nan() => DistanceQuantization::NO_BOUNDARY,
            distance => quantization.encode((f64::from(distance) * world_from_working) as f32),
        };
        (layer, encode)
    }

    fn hit_gradient_layer(
        &self,
        range: Option<[f32; 2]>,
    ) -> Result<(Layer, impl Fn(f32) -> u16 + Copy + Sync + use<>)> {
        let scale = self.0.scaling.gradient_scale();
        let physical = to_physical(scale);
        let [low, high] = range.unwrap_or_default().map(physical);
        if high.is_infinite() {
            return Err(Error::Parameter(format!(
                "{}: the gradient magnitude at boundaries leaves the range of f32; scale the values or the spacing down",
                self.0.source.name
            )));
        }
        let quantization = HitGradientQuantization::new(low, high, self.0.settings.precision);
        let layer = Layer::new(LayerKind::HitGradient, ScalarType::U16, Quantization::HitGradient(quantization));
        Ok((layer, move |g: f32| if g.is_nan() { 0 } else { quantization.encode(physical(g)) }))
    }

    /// The layers of the derivatives, each with its numbers in working units and what one of those is in physical ones.
    fn derivative_layers<'d>(&self, derivatives: [&'d [f32]; 2]) -> Result<[(Layer, &'d [f32], f64); 2]> {
        let scales = [self.0.scaling.gradient_scale(), self.0.scaling.second_derivative_scale()];
        for ((layer, field), scale) in derivative_layers().iter().zip(derivatives).zip(scales) {
            let [low, high] = par_range_within(field, f32::MIN, f32::MAX).unwrap_or_default();
            if to_physical(scale)(low.abs().max(high.abs())).is_infinite() {
                return Err(Error::Parameter(format!(
                    "{}: `{}` leaves the range of f32; scale the values or the spacing down",
                    self.0.source.name,
                    layer.kind.name()
                )));
            }
        }
        let [first, second] = derivative_layers();
        Ok([(first, derivatives[0], scales[0]), (second, derivatives[1], scales[1])])
    }

    /// Counts voxels, before anything is quantised.
    fn tally(&self, value: &Scalars, [gradient, second_derivative]: [&[f32]; 2], roles: &Roles) -> Tally {
        Tally::new(
            &Quantities {
                value,
                gradient,
                second_derivative,
                hit_gradient: &roles.hit_gradient,
                hit_value: &roles.hit_value,
                distance: &roles.distance,
            },
            &self.axes(),
        )
    }

    fn description(&self, summary: &Summary, voxels_sha256: [u8; 32]) -> Description {
        let Recipe { source, scan, scaling, .. } = self.0;
        let ends = scan.range.map(|end| source.slope.mul_add(end, source.intercept));
        Description {
            made_by: MADE_BY.into(),
            source: Source { name: source.name.to_owned(), voxels_sha256 },
            parameters: self.parameters(),
            statistics: Statistics {
                value_range: [ends[0].min(ends[1]), ends[0].max(ends[1])],
                max_gradient: f64::from(summary.tally.largest_gradient()) * scaling.gradient_scale(),
                hits: summary.counts.hits,
                misses: summary.counts.misses,
                masked: summary.counts.masked,
            },
        }
    }

    /// What shaped the result; skipping, memory and threads do not.
    #[must_use]
    pub fn parameters(&self) -> Vec<Parameter> {
        let Recipe { source, settings, choice, noise, noisy_values, range_sigmas, scaling, .. } = self.0;
        let Settings { method, smoothing, kernel, reconstruction, climb, step, d_max, noise_floor, .. } = settings;
        let mut parameters = vec![
            ("method", method.to_string()),
            ("smooth", smoothing.placement.to_string()),
            ("derivative", kernel.to_string()),
            ("reconstruction", reconstruction.to_string()),
            ("root", settings.root_finder().name().to_owned()),
            ("climb", climb.to_string()),
            ("step", format!("{step} L_min")),
            ("dmax", format!("{d_max} L_min")),
            ("noise", format!("{:.6e} (estimated)", f64::from(*noise) * scaling.value_scale())),
            ("noise-floor", format!("{noise_floor} times the gradient noise")),
        ];
        if !noisy_values.is_empty() {
            let noisy: Vec<_> = noisy_values.iter().map(ToString::to_string).collect();
            parameters.push(("gradient noise", noisy.join(", ")));
        }
        if !source.read_with.is_empty() {
            parameters.push(("read with", source.read_with.to_owned()));
        }
        if smoothing.placement != crate::settings::Smoothing::None {
            parameters.push(("spatial-sigma", format!("{} L_min", smoothing.spatial_sigma)));
            parameters.push(("radius", format!("{} voxels", smoothing.radius)));
        }
        if settings.operator == EdgeOperator::Plus {
            parameters.push(("edge", "plus".into()));
        }
        if let Some(blur) = choice.as_ref().and_then(|choice| choice.blur) {
            parameters.push(("blur", format!("{blur:.3} L_min (estimated)")));
        }
        for sigma in &range_sigmas.shares {
            parameters.push(("range-sigma", format!("{:.6} of the range of {}", sigma.share, sigma.field)));
        }
        if let Some(sigma) = range_sigmas.shares.first() {
            parameters.push(("bilateral", format!("{} range weights", sigma.weights)));
        }
        parameters.into_iter().map(|(name, value)| Parameter { name: name.into(), value }).collect()
    }
}

fn only_bricks<T>(packed: Vec<PackedLayerBrick<T>>) -> Vec<PackedBrick> {
    packed.into_iter().map(|packed| packed.brick).collect()
}

fn with_masks<T>(packed: Vec<PackedLayerBrick<T>>) -> (Vec<PackedBrick>, Vec<PackedMask>) {
    packed.into_iter().filter_map(|packed| Some((packed.brick, packed.mask?))).unzip()
}

fn normal_layer() -> Layer {
    Layer::new(LayerKind::Normal, ScalarType::U16, Quantization::Octahedral)
}

fn derivative_layers() -> [Layer; 2] {
    [LayerKind::GradientMagnitude, LayerKind::SecondDerivative].map(float_layer)
}

/// Gradient magnitude at the hit in an unfinished file.
fn working_layer() -> Layer {
    float_layer(LayerKind::HitGradient)
}

fn float_layer(kind: LayerKind) -> Layer {
    Layer::new(kind, ScalarType::F32, Quantization::Linear { slope: 1.0, intercept: 0.0 })
}

fn to_physical(scale: f64) -> impl Fn(f32) -> f32 + Copy + Sync {
    move |working| (f64::from(working) * scale) as f32
}

fn hit_gradient_range(roles: &Roles) -> Option<[f32; 2]> {
    par_range_within(&roles.hit_gradient, f32::NEG_INFINITY, f32::INFINITY)
}
