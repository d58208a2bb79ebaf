// Opacity and colour by role: the twins of classify/opacity.rs, emphasis_table.rs and opacity_correction.rs.

const VALUE_BINS: u32 = 1024u;
const GRADIENT_BINS: u32 = 512u;
const INTERVALS: f32 = 1024.0;

// The bin of an interpolated value in 0..=65535 and a stored gradient magnitude, which is not 0.
fn role_bin(value: f32, stored_gradient: u32) -> vec2<u32> {
    let value_bin = min(u32(value * (f32(VALUE_BINS) / 65536.0)), VALUE_BINS - 1u);
    return vec2<u32>(value_bin, (stored_gradient - 1u) * GRADIENT_BINS / 65535u);
}

// Colour and opacity of a bin.
fn opacity_by_role(bin: vec2<u32>) -> vec4<f32> {
    return vec4<f32>(textureLoad(opacity_table, bin, 0)) / 65535.0;
}

// Opacity by signed distance to the boundary, of an emphasis.
fn opacity_by_distance(emphasis: u32, distance: f32) -> f32 {
    let row = 2u * emphasis + select(0u, 1u, distance < 0.0);
    let place = min(abs(distance) * textureLoad(emphasis_table, vec2<u32>(0u, row), 0).x, INTERVALS);
    let interval = u32(place);
    let start = textureLoad(emphasis_table, vec2<u32>(interval + 1u, row), 0).x;
    let end = textureLoad(emphasis_table, vec2<u32>(interval + 2u, row), 0).x;
    return start + (place - f32(interval)) * (end - start);
}

// Opacity of one step, from that of a path of L_min.
fn correct_opacity(opacity: f32, step: f32) -> f32 {
    return 1.0 - pow(max(1.0 - opacity, 0.0), step);
}
