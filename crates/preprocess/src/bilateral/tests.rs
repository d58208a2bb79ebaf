//! The filter against its naive twin, and what it promises.

use ndarray::s;
use proptest::prelude::*;

use super::*;
use crate::naive_mean::{SPACING, check_against_naive, fields, naive_mean};

fn filtered(field: &Field, settings: BilateralSettings) -> Field {
    Bilateral::new(dims_of(field), SPACING, settings).filter(field, [0; 3]).values
}

/// Brute force in f64 with the exponential itself.
fn naive(field: &Field, settings: BilateralSettings) -> Vec<f64> {
    let [by_distance, by_value] =
        [settings.spatial_sigma, settings.range_sigma].map(|sigma| -0.5 / f64::from(sigma).powi(2));
    naive_mean(field, settings.radius, |squared, difference| {
        (by_distance * squared + by_value * difference * difference).exp()
    })
}

/// The largest and the mean deviation, as shares of a field's range.
fn deviation(found: &Field, expected: &[f64], range: f64) -> [f64; 2] {
    let deviations: Vec<f64> = (found.iter().zip(expected))
        .filter(|(found, _)| !found.is_nan())
        .map(|(&found, expected)| (f64::from(found) - expected).abs() / range)
        .collect();
    let largest = deviations.iter().copied().fold(0.0, f64::max);
    [largest, deviations.iter().sum::<f64>() / deviations.len().max(1) as f64]
}

fn settings(spatial_sigma: f32, range_sigma: f32, radius: usize) -> BilateralSettings {
    BilateralSettings { spatial_sigma, range_sigma, radius, weights: RangeWeights::Fast }
}

/// A blurred edge, 0.8 high, under noise of 0.1.
fn noisy_ball(dims: [usize; 3]) -> Field {
    let middle = dims.map(|dim| dim as f32 / 2.0);
    Field::from_shape_fn((dims[2], dims[1], dims[0]), |(k, j, i)| {
        let squared: f32 = [(i, middle[0]), (j, middle[1]), (k, middle[2])]
            .map(|(index, middle)| ((index as f32 - middle) / middle).powi(2))
            .iter()
            .sum();
        let noise = ((k * 40 + j) * 40 + i).wrapping_mul(2_654_435_761) as u32 as f32 / u32::MAX as f32 - 0.5;
        0.5 + 0.4 * (middle[0] * (0.7 - squared.sqrt())).tanh() + 0.1 * noise
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn exact_weights_equal_the_naive_twin(field in fields(), range_sigma in 0.01_f32..2.0, radius in 1_usize..4) {
        let settings = BilateralSettings { weights: RangeWeights::Exact, ..settings(1.3, range_sigma, radius) };
        check_against_naive(&filtered(&field, settings), &naive(&field, settings))?;
    }

    #[test]
    fn fast_weights_keep_to_their_bound(
        field in fields(),
        // Few different values: the worst that can be.
        levels in prop::option::of(1_u8..4),
        spatial_sigma in 0.5_f32..4.0,
        range_sigma in -6.0_f32..6.0,
        radius in 1_usize..5,
    ) {
        let settings = settings(spatial_sigma, range_sigma.exp2(), radius);
        let field = levels.map_or(field.clone(), |levels| field.mapv(|value| (value * f32::from(levels)).round()));
        let known = || field.iter().copied().filter(|value| !value.is_nan());
        let range = known().fold(f32::NAN, f32::max) - known().fold(f32::NAN, f32::min);
        let filter = Bilateral::new(dims_of(&field), SPACING, settings);
        prop_assert_eq!(filter.range_weights(), RangeWeights::Fast);
        let found = filter.filter(&field, [0; 3]).values;
        let [largest, _] = deviation(&found, &naive(&field, settings), f64::from(range).max(0.01));
        prop_assert!(largest <= filter.deviation_bound() + 1e-6, "{} {}", largest, filter.deviation_bound());
        prop_assert!(filter.deviation_bound() <= LARGEST_DEVIATION);
        prop_assert!(found.iter().zip(&field).all(|(found, value)| found.is_nan() == value.is_nan()));
    }

    #[test]
    fn exact_weights_give_the_bits_of_plain_loops(field in fields(), range_sigma in 0.01_f32..2.0, radius in 1_usize..4) {
        let settings = BilateralSettings { weights: RangeWeights::Exact, ..settings(1.3, range_sigma, radius) };
        let found = filtered(&field, settings);
        let expected = plainly(&field, settings);
        prop_assert!(found.iter().zip(&expected).all(|(found, expected)| found.to_bits() == expected.to_bits()
            || found.is_nan() && expected.is_nan()));
    }
}

/// Exact weights in plain loops over the voxels and their neighbours, in f32.
fn plainly(field: &Field, settings: BilateralSettings) -> Field {
    let falloff = 0.5 / (settings.range_sigma * settings.range_sigma);
    let offsets = neighbourhood(dims_of(field).map(|dim| settings.radius.min(dim - 1)));
    Field::from_shape_fn(field.dim(), |(k, j, i)| {
        let center = field[[k, j, i]];
        let (mut sum, mut total) = (0.0, 0.0);
        for &offset in &offsets {
            let [x, y, z] = [(i, 0), (j, 1), (k, 2)].map(|(index, axis)| index.wrapping_add_signed(offset[axis]));
            let Some(other) = field.get([z, y, x]).filter(|other| !other.is_nan()) else { continue };
            let difference = other - center;
            let spatial = spatial_weight(&offset, SPACING, settings.spatial_sigma);
            let weight = spatial * range_weight::exp_of_negative(difference * difference * falloff);
            sum += weight * difference;
            total += weight;
        }
        center + sum / total
    })
}

/// A volume with noise that grows along x, patches without any, and holes.
fn patchy(dims: [usize; 3]) -> Field {
    let mut field = noisy_ball(dims);
    for ((k, j, i), value) in field.indexed_iter_mut() {
        if (i / 37 + j / 19 + k / 11) % 3 == 0 {
            *value = 0.3;
        } else {
            *value *= (i as f32 * 0.04).exp2();
        }
        if (i * 7 + j * 5 + k * 3) % 997 == 0 {
            *value = f32::NAN;
        }
    }
    field
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn parts_give_the_bits_of_the_whole(
        dims in (1_usize..150, 1_usize..70, 1_usize..40),
        corners in prop::array::uniform6(0.0_f32..1.0),
        range_sigma in -4.0_f32..4.0,
        radius in 1_usize..4,
        exact: bool,
    ) {
        let dims: [usize; 3] = dims.into();
        let weights = if exact { RangeWeights::Exact } else { RangeWeights::Fast };
        let settings = BilateralSettings { weights, ..settings(1.0, range_sigma.exp2(), radius) };
        let field = patchy(dims);
        let whole = filtered(&field, settings);

        let part = [0, 1, 2].map(|axis| {
            let [low, high] = [0, 1].map(|end| (corners[2 * axis + end] * dims[axis] as f32) as usize);
            low.min(high)..low.max(high) + 1
        });
        let halo = reach(radius);
        let padded = [0, 1, 2].map(|axis| {
            part[axis].start.saturating_sub(halo[axis])..(part[axis].end + halo[axis]).min(dims[axis])
        });
        let cut = |field: &Field, [x, y, z]: [Range<usize>; 3]| field.slice(s![z, y, x]).to_owned();
        let origin = [0, 1, 2].map(|axis| padded[axis].start);
        let inside = [0, 1, 2].map(|axis| part[axis].start - origin[axis]..part[axis].end - origin[axis]);
        let sub_volume = cut(&field, padded);
        let filter = Bilateral::new(dims_of(&sub_volume), SPACING, settings);
        let found = cut(&filter.filter(&sub_volume, origin).values, inside);
        let expected = cut(&whole, part);
        prop_assert!(found.iter().zip(&expected).all(|(found, expected)| found.to_bits() == expected.to_bits()));
    }
}

#[test]
fn means_lie_between_what_they_are_means_of() {
    // As gradient magnitudes do, many values lie at the lower end, which is 0.
    let field = noisy_ball([70, 40, 37]).mapv(|value| (value - 0.9).max(0.0));
    for range_sigma in [0.001, 0.01, 0.1, 1.0] {
        let highest = field.iter().copied().fold(0.0, f32::max);
        let values = filtered(&field, settings(1.0, range_sigma, 2));
        assert!(values.iter().all(|value| (0.0..=highest).contains(value)), "σr = {range_sigma}");
    }
}

#[test]
fn boxes_are_cut_where_the_volume_is() {
    assert_eq!(cuts(0, 20, 8), [0..8, 8..16, 16..20]);
    assert_eq!(cuts(13, 12, 8), [0..3, 3..11, 11..12]);
    assert_eq!(cuts(6, 4, 8), [0..2, 2..4]);
}

#[test]
fn boxes_of_one_value_are_not_filtered() {
    let mut field = Field::from_elem((BOX[2] * 4, BOX[1] * 2, BOX[0] * 2), 0.1);
    field[[20, 0, 0]] = 1.0;
    let filter = |radius| Bilateral::new(dims_of(&field), SPACING, settings(1.0, 0.3, radius)).filter(&field, [0; 3]);
    assert_eq!(filter(2).boxes_filtered, 1.0 / 16.0);
    assert_eq!(filter(5).boxes_filtered, 3.0 / 16.0);
}

#[test]
fn threads_do_not_matter() {
    let field = noisy_ball([70, 20, 37]);
    let filter = Bilateral::new(dims_of(&field), SPACING, settings(1.0, 0.1, 2));
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| filter.filter(&field, [0; 3]).values)
    });
    assert_eq!(one, three);
}

/// A lone voxel among neighbours that all differ from it by the same amount: what is small and wrong adds up.
#[test]
fn the_worst_case_keeps_to_the_bound() {
    let mut worst: f64 = 0.0;
    for step in 1..600 {
        let settings = settings(1.0, 10.0 / step as f32, 3);
        let mut field = Field::zeros((3, 5, 7));
        field[[1, 2, 3]] = 1.0;
        let filter = Bilateral::new([7, 5, 3], SPACING, settings);
        let [largest, _] = deviation(&filter.filter(&field, [0; 3]).values, &naive(&field, settings), 1.0);
        assert!(largest <= filter.deviation_bound(), "{settings:?}: {largest}");
        worst = worst.max(largest / filter.deviation_bound());
    }
    assert!(worst > 0.2, "the bound is far from what happens: {worst}");
}

/// Acceptance of the fast weights: a ball's blurred edge under noise.
#[test]
fn deviations_on_a_noisy_ball() {
    let field = noisy_ball([72, 28, 32]);
    for range_sigma in [0.02, 0.1, 0.4] {
        let settings = settings(1.0, range_sigma, 3);
        let [largest, mean] = deviation(&filtered(&field, settings), &naive(&field, settings), 0.9);
        assert!(largest <= 1e-5 && mean <= 1e-6, "{range_sigma}: {largest} {mean}");
    }
}

#[test]
fn wide_filters_fall_back_to_exact_weights() {
    let of = |spatial_sigma, radius| Bilateral::new([64; 3], [1.0; 3], settings(spatial_sigma, 0.1, radius));
    assert_eq!(of(3.8, 10).range_weights(), RangeWeights::Fast);
    assert_eq!(of(4.2, 12).range_weights(), RangeWeights::Exact);
    assert_eq!(of(4.2, 12).deviation_bound(), 0.0);
    assert!(of(1.0, 3).deviation_bound() < 8.2e-5);
}

#[test]
fn an_edge_survives_where_a_gaussian_would_blur_it() {
    let field = Array3::from_shape_fn((1, 1, 16), |(_, _, i)| if i < 8 { 0.0 } else { 1.0 });
    for weights in [RangeWeights::Fast, RangeWeights::Exact] {
        let found = filtered(&field, BilateralSettings { weights, ..settings(1.0, 0.1, 2) });
        assert!(found.iter().zip(&field).all(|(found, &value)| (found - value).abs() < 1e-20), "{found}");
    }
}

#[test]
fn extreme_widths_and_values() {
    let mut field = Field::from_shape_fn((4, 4, 20), |(k, j, i)| ((k + j + i) % 5) as f32 * 1e6);
    field[[2, 2, 2]] = f32::INFINITY;
    field[[2, 2, 9]] = f32::NAN;
    for weights in [RangeWeights::Fast, RangeWeights::Exact] {
        let filter = |range_sigma| filtered(&field, BilateralSettings { weights, ..settings(1.0, range_sigma, 3) });
        for range_sigma in [0.0, f32::MIN_POSITIVE, 1e-20] {
            // The smallest exact weight is not 0.
            let unchanged = |(found, value): (&f32, &f32)| {
                if value.is_finite() { (found - value).abs() < 1e-28 } else { found.is_nan() }
            };
            assert!(filter(range_sigma).iter().zip(&field).all(unchanged), "{range_sigma}");
        }
        let [wide, wider] = [1e12, f32::INFINITY].map(filter);
        assert!(wide.iter().zip(&wider).all(|(wide, wider)| wide.to_bits() == wider.to_bits()));
        assert!(wide.iter().all(|value| value.is_nan() || (5e5..3.5e6).contains(value)), "{wide}");
    }
}

#[test]
fn ramps_and_flat_regions_stay_what_they_are() {
    let field = Field::from_shape_fn((7, 8, 30), |(_, j, i)| 0.25 * i as f32 - 0.5 * j as f32);
    // Too steep for moments.
    let found = filtered(&field, settings(1.0, 0.3, 2));
    for ((k, j, i), found) in found.indexed_iter() {
        if (2..5).contains(&k) && (2..6).contains(&j) && (2..28).contains(&i) {
            assert_eq!(*found, field[[k, j, i]]);
        }
    }
    let flat = Field::from_elem((3, 3, 3), 0.1);
    assert_eq!(filtered(&flat, settings(1.0, 0.7, 2)), flat);
}
