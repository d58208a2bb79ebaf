// Opacity and colour by role: the twins of classify/opacity.rs, boundary_emphasis.rs and opacity_correction.rs.

const LINEAR: u32 = 0u;
const CONVEX: u32 = 2u;
const VALUE_BINS: u32 = 1024u;
const GRADIENT_BINS: u32 = 512u;

// Colour and opacity of an interpolated value in 0..=65535 and a stored gradient magnitude, which is not 0.
fn opacity_by_role(value: f32, stored_gradient: u32) -> vec4<f32> {
    let value_bin = min(u32(value * (f32(VALUE_BINS) / 65536.0)), VALUE_BINS - 1u);
    let gradient_bin = (stored_gradient - 1u) * GRADIENT_BINS / 65535u;
    return vec4<f32>(textureLoad(opacity_table, vec2<u32>(value_bin, gradient_bin), 0)) / 65535.0;
}

// Opacity by distance to the boundary, eqs. (7) to (9); 0 from d_c on.
fn opacity_by_distance(distance: f32) -> f32 {
    if distance >= frame.emphasis_d_c {
        return 0.0;
    }
    let share = distance / frame.emphasis_d_c;
    // Without a branch on the kind: Mesa's lavapipe compiles the shader anew for every picture drawn by a shader whose
    // branches depend on uniforms alone.
    let is_convex = frame.emphasis_kind == CONVEX;
    let base = select(1.0 - share, share, is_convex);
    let power = select(pow(base, frame.emphasis_n), base, frame.emphasis_kind == LINEAR);
    return frame.emphasis_a * select(power, 1.0 - power, is_convex);
}

// Opacity of one step, from that of a path of L_min.
fn correct_opacity(opacity: f32) -> f32 {
    return 1.0 - pow(max(1.0 - opacity, 0.0), frame.step);
}
