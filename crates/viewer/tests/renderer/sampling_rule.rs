//! The sampler against a naive twin that skips nothing, bit for bit.

use glam::Vec3;
use voxrole_pack::quantization::decode_normal;
use voxrole_viewer::VolumeTexels;
use voxrole_viewer::classify::{EmphasisTable, OpacityTable};
use voxrole_viewer::frame::Frame;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{BoundaryEmphasis, Camera, EmphasisKind};

use crate::phantom::{Phantom, SHELLS};

/// The rule as written, over all eight voxels.
fn naive_opacity(
    volume: &VolumeTexels,
    table: &OpacityTable,
    emphases: &EmphasisTable,
    frame: &Frame,
    index: Vec3,
) -> f32 {
    let dims = volume.description.dims;
    let last = Vec3::from_array(dims.map(|dim| (dim - 1) as f32));
    let index = (index * frame.spacing * frame.spacing.recip()).clamp(Vec3::ZERO, last);
    let base = index.floor().min((last - 1.0).max(Vec3::ZERO));
    let fraction = index - base;
    let corners = (0..8).map(|corner| {
        let offset = [corner & 1, corner >> 1 & 1, corner >> 2];
        let voxel: [usize; 3] =
            std::array::from_fn(|axis| (base[axis] as usize + offset[axis]).min(dims[axis] as usize - 1));
        let texel = volume.texels[(voxel[2] * dims[1] as usize + voxel[1]) * dims[0] as usize + voxel[0]];
        let offset = Vec3::from_array(offset.map(|offset| offset as f32));
        let along = |axis: usize| if offset[axis] == 1.0 { fraction[axis] } else { 1.0 - fraction[axis] };
        (texel, along(0) * along(1) * along(2), offset)
    });
    let value = corners.clone().fold(0.0, |sum, (texel, weight, _)| sum + weight * f32::from(texel[0]));
    let opacity = corners.fold(0.0, |sum, (texel, weight, offset)| {
        if !VolumeTexels::has_hit(texel) {
            return sum;
        }
        let normal = decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
        let distance =
            f32::from(texel[1] as i16) * frame.distance_scale + normal.dot((fraction - offset) * frame.spacing);
        let ([.., by_role], emphasis) = table.look_up(value, texel[2]);
        sum + weight * (by_role * emphases.look_up(emphasis, distance))
    });
    opacity.min(1.0)
}

#[test]
fn early_outs_change_nothing() {
    let mut phantom = Phantom::concentric_shells();
    phantom.geometry.spacing = [1.0, 1.0, 1.25];
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    state.transfer_function.regions[1].gradient[1] = 1.05 * SHELLS[1].gradient() as f32;
    state.transfer_function.regions[0].value = [150.0, 200.0];
    let mut random = 1_u64;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 40) as f32 / (1 << 24) as f32
    };
    for (kind, d_c) in [(EmphasisKind::Linear, 0.5), (EmphasisKind::Concave, 3.0), (EmphasisKind::Convex, 15.0)] {
        state.transfer_function.emphasis.high = BoundaryEmphasis { kind, a: 0.9, d_c, n: 3.0 };
        state.transfer_function.regions[1].emphasis = Some(BoundaryEmphasis::default().into());
        let marcher = RayMarcher::new(&volume, &state, [8, 8]).expect("a size");
        let emphases = EmphasisTable::new(&state.transfer_function);
        let frame = Frame::new(&state, &volume.description, &emphases, [8, 8]);
        let description = &volume.description;
        let table = OpacityTable::new(&state.transfer_function, description.value_range, description.hit_gradient);
        let mut lit = 0;
        for _ in 0..20_000 {
            // A little beyond the box too, and on voxels, where weights are 0.
            let mut index = Vec3::new(next(), next(), next()) * 65.0 - 1.0;
            index = if next() < 0.1 { index.round() } else { index };
            let opacity = marcher.opacity_at(index);
            let naive = naive_opacity(&volume, &table, &emphases, &frame, index);
            // A plane's distance is summed in another order: off by a few millionths of 15, times αd's steepest slope.
            assert!((opacity - naive).abs() < 1e-5, "{opacity} is not {naive} at {index}");
            lit += usize::from(opacity > 0.0);
        }
        assert!(lit > 200, "{kind:?}: only {lit} places were lit");
    }
}
