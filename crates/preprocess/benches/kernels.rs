//! Times of the kernels: `cargo bench -p voxrole-preprocess --bench kernels`.

use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rayon::prelude::*;
use voxrole_pack::layer::Quantization;
use voxrole_pack::{
    DistanceQuantization, GridGeometry, HistogramAxis, Layer, LayerKind, Precision, ScalarType, Scalars, Writer,
};
use voxrole_preprocess::Grid;
use voxrole_preprocess::bilateral::{Bilateral, BilateralSettings, RangeWeights};
use voxrole_preprocess::bspline::{Coefficients, Degree};
use voxrole_preprocess::central_difference::derivatives_into;
use voxrole_preprocess::directional_derivative::{Derivatives, EdgeOperator};
use voxrole_preprocess::joint_histogram::{Axes, Binning, Quantities, Tally};
use voxrole_preprocess::separable_derivative::{SeparableKernel, separable_derivatives_into};
use voxrole_preprocess::working_field::{Field, WorkingField};
use voxrole_preprocess::zero_crossing::CellDistances;

const EDGE: usize = 128;
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Edge of what no cache holds.
const LARGE: usize = 256;

/// What is packed of a ball with a blurred edge.
struct Ball {
    grid: Grid,
    gradient: Vec<f32>,
    second_derivative: Vec<f32>,
    /// NaN farther than four voxels from the edge.
    distance: Vec<f32>,
    hit_gradient: Vec<f32>,
    hit_value: Vec<f32>,
}

impl Ball {
    fn new() -> Self {
        let to_edge = |voxel: usize| {
            let squares =
                [voxel % EDGE, voxel / EDGE % EDGE, voxel / (EDGE * EDGE)].map(|index| (index as f32 - 63.5).powi(2));
            40.0 - squares.iter().sum::<f32>().sqrt()
        };
        let field = |of: &dyn Fn(f32) -> f32| -> Vec<f32> { (0..VOXELS).map(|voxel| of(to_edge(voxel))).collect() };
        let at_hit = |of: &dyn Fn(f32) -> f32| field(&|d| if d.abs() < 4.0 { of(d) } else { f32::NAN });
        let geometry = GridGeometry::axis_aligned([EDGE as u32; 3], [1.0; 3]);
        let values = Scalars::F32(field(&|d| 0.5 + 0.5 * d.tanh()));
        Self {
            grid: Grid::new("ball", geometry, values).expect("a grid"),
            gradient: field(&|d| 0.5 / d.cosh().powi(2)),
            second_derivative: field(&|d| -d.tanh() / d.cosh().powi(2)),
            distance: at_hit(&|d| d),
            hit_gradient: at_hit(&|_| 0.5),
            hit_value: at_hit(&|_| 0.5),
        }
    }

    fn quantities(&self) -> Quantities<'_> {
        Quantities {
            value: &self.grid.scalars,
            gradient: &self.gradient,
            second_derivative: &self.second_derivative,
            hit_gradient: &self.hit_gradient,
            hit_value: &self.hit_value,
            distance: &self.distance,
        }
    }

    fn axes() -> Axes {
        let binning = |low, high| Binning { slope: 1.0, intercept: 0.0, axis: HistogramAxis { low, high, bins: 256 } };
        Axes {
            value: binning(0.0, 1.0),
            hit_value: binning(0.0, 1.0),
            distance: binning(-15.0, 15.0),
            gradient_scale: 1.0,
            second_derivative_scale: 1.0,
        }
    }

    /// Writes two layers, but not the file's end: the disk is not waited for.
    fn write(&self, path: &Path) {
        let mut writer = Writer::create(path, self.grid.geometry.clone(), 1).expect("creates");
        let linear = Quantization::Linear { slope: 1.0, intercept: 0.0 };
        let Scalars::F32(values) = &self.grid.scalars else { unreachable!("made so") };
        writer.write_layer(Layer::new(LayerKind::Value, ScalarType::F32, linear), values).expect("writes");
        let quantization = DistanceQuantization::new(15.0, Precision::default());
        let distance = Layer::new(LayerKind::Distance, ScalarType::I16, Quantization::Distance(quantization));
        let encode = |d: f32| if d.is_nan() { DistanceQuantization::NO_BOUNDARY } else { quantization.encode(d) };
        writer.write_encoded_layer(distance, &self.distance, encode).expect("writes");
    }
}

fn packing(criterion: &mut Criterion) {
    let ball = Ball::new();
    let folder = tempfile::tempdir().expect("a folder");
    let mut group = criterion.benchmark_group("packing");
    group.throughput(Throughput::Elements(VOXELS as u64)).sample_size(20);
    group.bench_function("value range", |bencher| bencher.iter(|| ball.grid.scalars.finite_range()));
    group.bench_function("sha256", |bencher| bencher.iter(|| ball.grid.voxels_sha256()));
    group.bench_function("histograms", |bencher| bencher.iter(|| Tally::new(&ball.quantities(), &Ball::axes())));
    group.bench_function("writer", |bencher| bencher.iter(|| ball.write(&folder.path().join("ball.vxr"))));
    group.finish();
}

const FIELD_EDGE: usize = 64;

/// A ball's blurred edge under noise, in 0 to 1.
fn noisy_ball() -> Field {
    let center = FIELD_EDGE as f32 / 2.0;
    Field::from_shape_fn((FIELD_EDGE, FIELD_EDGE, FIELD_EDGE), |(k, j, i)| {
        let distance = [i, j, k].map(|index| (index as f32 - center).powi(2)).iter().sum::<f32>().sqrt();
        let hash = ((k * FIELD_EDGE + j) * FIELD_EDGE + i).wrapping_mul(2_654_435_761) as u32;
        0.5 + 0.4 * (0.6 * center - distance).tanh() + 0.1 * (hash as f32 / u32::MAX as f32 - 0.5)
    })
}

fn bilateral(criterion: &mut Criterion) {
    let field = noisy_ball();
    let mut group = criterion.benchmark_group("bilateral");
    group.throughput(Throughput::Elements(field.len() as u64)).sample_size(20);
    for radius in [2, 3] {
        for weights in [RangeWeights::Fast, RangeWeights::Exact] {
            let settings = BilateralSettings { spatial_sigma: 1.0, range_sigma: 0.4, radius, weights };
            let filter = Bilateral::new([FIELD_EDGE; 3], [1.0; 3], settings);
            group.bench_function(BenchmarkId::new(weights.to_string(), radius), |bencher| {
                bencher.iter(|| filter.filter(&field, [0; 3]));
            });
        }
    }
    group.finish();
}

/// Each kernel beside a copy of as many bytes as it reads and writes at least.
fn derivatives(criterion: &mut Criterion) {
    let mut field = WorkingField::new(&Ball::new().grid).expect("finite numbers");
    // With noise, so that there is something to compute everywhere.
    field.values = Field::from_shape_fn((LARGE, LARGE, LARGE), |(k, j, i)| {
        let hash = ((k * LARGE + j) * LARGE + i).wrapping_mul(2_654_435_761) as u32;
        let noise = 0.01 * (hash as f32 / u32::MAX as f32 - 0.5);
        0.9 * field.values[[k * EDGE / LARGE, j * EDGE / LARGE, i * EDGE / LARGE]] + noise
    });
    let voxels = field.values.len();
    let mut group = criterion.benchmark_group("derivatives");
    group.throughput(Throughput::Elements(voxels as u64)).sample_size(20);
    // A value is read, a gradient magnitude and a second derivative are written: 12 bytes, of which a copy reads half.
    let from = vec![1.0_f32; voxels * 3 / 2];
    let mut to = vec![0.0_f32; voxels * 3 / 2];
    group.bench_function("copy of the same bytes", |bencher| {
        bencher.iter(|| {
            to.par_chunks_mut(1 << 16).zip(from.par_chunks(1 << 16)).for_each(|(to, from)| to.copy_from_slice(from));
        });
    });
    let mut derivatives = Derivatives::zeros([LARGE; 3]);
    group.bench_function("central2", |bencher| {
        bencher.iter(|| derivatives_into(&field, EdgeOperator::SecondDerivative, &mut derivatives));
    });
    let coefficients = Coefficients::new(&field.values, Degree::Quintic).expect("fits");
    let kernel = SeparableKernel::spline(Degree::Quintic);
    group.bench_function("bspline5 on coefficients", |bencher| {
        bencher.iter(|| {
            let operator = EdgeOperator::SecondDerivative;
            separable_derivatives_into(&coefficients.field, [1.0; 3], &kernel, operator, &mut derivatives);
        });
    });
    group.bench_function("prefilter of bspline5", |bencher| {
        bencher.iter(|| Coefficients::new(&field.values, Degree::Quintic).expect("fits"));
    });
    group.bench_function("zero-crossing cells", |bencher| {
        bencher.iter(|| CellDistances::new(&derivatives.second_derivative));
    });
    group.finish();
}

criterion_group!(kernels, derivatives, packing, bilateral);
criterion_main!(kernels);
