//! From blocks in working units to a packed file in physical ones.

use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use voxrole_pack::brick::BrickGrid;
use voxrole_pack::header::{Parameter, Source, Statistics};
use voxrole_pack::layer::Quantization;
use voxrole_pack::scalar::par_range_within;
use voxrole_pack::unfinished::Unfinished;
use voxrole_pack::writer::{BrickPacker, Description, PackedBrick, pack_bricks};
use voxrole_pack::{
    DistanceQuantization, HistogramAxis, HitGradientQuantization, Layer, LayerKind, ScalarType, Writer, with_scalars,
};

use crate::block_plan::BlockPlan;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::joint_histogram::{Axes, Binning, DISTANCE_BINS, Quantities, Tally, value_axis};
use crate::recipe::{Block, Recipe};
use crate::region::Region;
use crate::roles::MASKED;
use crate::scan;
use crate::settings::Settings;
use crate::source::cropped;
use crate::summary::Summary;
use crate::working_field::voxels;
use crate::{Error, Result};

/// Name and version of the program, as written into every file.
pub const MADE_BY: &str = concat!("voxrole ", env!("CARGO_PKG_VERSION"));

/// Bricks that are packed at once: bounds the memory in flight whatever the number of threads.
const BRICKS_IN_FLIGHT: usize = 64;

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
        let hit_gradient = hit_gradient_range(&block);
        // What only one thread can do, hashing and handing bytes to the system, goes on beside the rest.
        let ((writer, tally), voxels_sha256) = rayon::join(
            || rayon::join(|| self.write_layers(path, &block, hit_gradient), || self.tally(&block)),
            || {
                let mut hasher = Sha256::new();
                scan::hash(&block.scalars, &mut hasher);
                hasher.finalize().into()
            },
        );
        let mut writer = writer?;
        let Block { scalars, field, derivatives, roles, counts, edges, .. } = block;
        let summary = Summary { counts, hit_gradient, tally, edges };
        writer.write_histograms(summary.tally.histograms(&self.axes()))?;
        let description = self.description(&summary, voxels_sha256);
        // Memory is given back while the disk is waited for.
        let (file_bytes, _) = rayon::join(
            || writer.finish(description),
            || rayon::join(|| drop((scalars, field, derivatives)), || drop(roles)),
        );
        Ok((file_bytes?, summary))
    }

    fn write_layers(&self, path: &Path, block: &Block<'_>, hit_gradient: Option<[f32; 2]>) -> Result<Writer> {
        let Block { derivatives, roles, .. } = block;
        let mut writer = Writer::create(path, self.0.source.geometry.clone())?;
        with_scalars!(&*block.scalars, values => writer.write_layer(self.value_layer(), values)?);
        let (layer, encode) = self.distance_layer();
        writer.write_encoded_layer(layer, &roles.distance, encode)?;
        let (layer, encode) = self.hit_gradient_layer(hit_gradient)?;
        writer.write_encoded_layer(layer, &roles.hit_gradient, encode)?;
        writer.write_layer(NORMAL_LAYER, &roles.normal)?;
        if self.0.settings.keep_derivatives {
            for (layer, field, scale) in self.derivative_layers(derivatives)? {
                writer.write_encoded_layer(layer, field, to_physical(scale))?;
            }
        }
        Ok(writer)
    }

    /// Packs one block of several: its bricks, layer by layer, and what is to be said of its voxels.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn pack(&self, block: Block<'_>) -> Result<(Vec<Vec<PackedBrick>>, Summary)> {
        let dims = block.interior.dims();
        let inner = block.interior.within(&block.padded);
        let padded = block.padded.dims();
        let scalars = cropped(&block.scalars, padded, &inner);
        let mut layers =
            vec![with_scalars!(&*scalars, values => pack_bricks(&self.value_layer(), dims, values, |value| value)?)];
        let (layer, encode) = self.distance_layer();
        layers.push(pack_bricks(&layer, dims, &block.roles.distance, encode)?);
        layers.push(pack_bricks(&WORKING_LAYER, dims, &block.roles.hit_gradient, |g| g)?);
        layers.push(pack_bricks(&NORMAL_LAYER, dims, &block.roles.normal, |normal| normal)?);
        if self.0.settings.keep_derivatives {
            for (layer, field, scale) in self.derivative_layers(&block.derivatives)? {
                layers.push(pack_bricks(&layer, dims, &inner.crop(field, padded), to_physical(scale))?);
            }
        }
        let (hit_gradient, tally) = (hit_gradient_range(&block), self.tally(&block));
        Ok((layers, Summary { counts: block.counts, hit_gradient, tally, edges: block.edges }))
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
        let mut writer = Writer::create(path, self.0.source.geometry.clone())?;
        let grid = BrickGrid::new(self.0.source.dims());
        let (hit_gradient_layer, encode) = self.hit_gradient_layer(summary.hit_gradient)?;
        let mut layers = vec![self.value_layer(), self.distance_layer().0, hit_gradient_layer.clone(), NORMAL_LAYER];
        if self.0.settings.keep_derivatives {
            layers.extend(DERIVATIVE_LAYERS);
        }
        let brick = |layer: usize, index: usize| {
            let (block, brick) = plan.locate(index);
            unfinished.brick(block, layer, brick)
        };
        let packer = BrickPacker::default();
        let encoded = |index: usize| {
            let working: Vec<f32> = brick(HIT_GRADIENT, index)?.unpack(grid.voxel_count(index))?;
            packer.pack(&hit_gradient_layer, &working, encode)
        };
        for (index, layer) in layers.into_iter().enumerate() {
            if index == HIT_GRADIENT {
                let groups = (0..grid.len()).step_by(BRICKS_IN_FLIGHT);
                let bricks = groups.flat_map(|first| {
                    let group = first..(first + BRICKS_IN_FLIGHT).min(grid.len());
                    group.into_par_iter().with_max_len(1).map(encoded).collect::<Vec<_>>()
                });
                writer.write_packed_layer(layer, bricks)?;
            } else {
                writer.write_packed_layer(layer, (0..grid.len()).map(|place| brick(index, place)))?;
            }
        }
        writer.write_histograms(summary.tally.histograms(&self.axes()))?;
        Ok(writer.finish(self.description(summary, voxels_sha256))?)
    }

    fn value_layer(&self) -> Layer {
        let source = &self.0.source;
        Layer {
            kind: LayerKind::Value,
            scalar_type: source.scalar_type(),
            quantization: Quantization::Linear { slope: source.slope, intercept: source.intercept },
        }
    }

    fn distance_layer(&self) -> (Layer, impl Fn(f32) -> i16 + Copy + Sync + use<>) {
        let quantization = DistanceQuantization { d_max: self.d_max() };
        let world_from_working = self.0.scaling.smallest_spacing();
        let layer = Layer {
            kind: LayerKind::Distance,
            scalar_type: ScalarType::I16,
            quantization: Quantization::Distance(quantization),
        };
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
        let quantization = HitGradientQuantization { low, high };
        let layer = Layer {
            kind: LayerKind::HitGradient,
            scalar_type: ScalarType::U16,
            quantization: Quantization::HitGradient(quantization),
        };
        Ok((layer, move |g: f32| if g.is_nan() { 0 } else { quantization.encode(physical(g)) }))
    }

    /// The layers of the derivatives, each with its numbers in working units and what one of those is in physical ones.
    fn derivative_layers<'d>(&self, derivatives: &'d Derivatives) -> Result<[(Layer, &'d [f32], f64); 2]> {
        let Derivatives { gradient_magnitude, second_derivative } = derivatives;
        let scales = [self.0.scaling.gradient_scale(), self.0.scaling.second_derivative_scale()];
        for ((layer, [low, high]), scale) in DERIVATIVE_LAYERS.iter().zip(derivatives.ranges()).zip(scales) {
            if to_physical(scale)(low.abs().max(high.abs())).is_infinite() {
                return Err(Error::Parameter(format!(
                    "{}: `{}` leaves the range of f32; scale the values or the spacing down",
                    self.0.source.name,
                    layer.kind.name()
                )));
            }
        }
        let [first, second] = DERIVATIVE_LAYERS;
        Ok([(first, voxels(gradient_magnitude), scales[0]), (second, voxels(second_derivative), scales[1])])
    }

    /// Counts a block's voxels, before anything is quantised.
    fn tally(&self, block: &Block<'_>) -> Tally {
        let Block { interior, padded, roles, derivatives, .. } = block;
        let (inner, padded): (Region, _) = (interior.within(padded), padded.dims());
        Tally::new(
            &Quantities {
                value: &cropped(&block.scalars, padded, &inner),
                gradient: &inner.crop(voxels(&derivatives.gradient_magnitude), padded),
                second_derivative: &inner.crop(voxels(&derivatives.second_derivative), padded),
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
        let Recipe { settings, choice, noise, range_sigmas, scaling, .. } = self.0;
        let Settings { method, smoothing, kernel, reconstruction, climb, step, d_max, noise_floor, .. } = settings;
        let mut parameters = vec![
            ("method", method.to_string()),
            ("smooth", smoothing.placement.to_string()),
            ("derivative", kernel.to_string()),
            ("reconstruction", reconstruction.to_string()),
            ("root", settings.root_finder.name().to_owned()),
            ("climb", climb.to_string()),
            ("step", format!("{step} L_min")),
            ("dmax", format!("{d_max} L_min")),
            ("noise", format!("{:.6e} (estimated)", f64::from(*noise) * scaling.value_scale())),
            ("noise-floor", format!("{noise_floor} times the gradient noise")),
        ];
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

const NORMAL_LAYER: Layer =
    Layer { kind: LayerKind::Normal, scalar_type: ScalarType::U16, quantization: Quantization::Octahedral };

const DERIVATIVE_LAYERS: [Layer; 2] =
    [float_layer(LayerKind::GradientMagnitude), float_layer(LayerKind::SecondDerivative)];

/// Gradient magnitude at the hit in an unfinished file.
const WORKING_LAYER: Layer = float_layer(LayerKind::HitGradient);

const fn float_layer(kind: LayerKind) -> Layer {
    let quantization = Quantization::Linear { slope: 1.0, intercept: 0.0 };
    Layer { kind, scalar_type: ScalarType::F32, quantization }
}

fn to_physical(scale: f64) -> impl Fn(f32) -> f32 + Copy + Sync {
    move |working| (f64::from(working) * scale) as f32
}

fn hit_gradient_range(block: &Block<'_>) -> Option<[f32; 2]> {
    par_range_within(&block.roles.hit_gradient, f32::NEG_INFINITY, f32::INFINITY)
}
