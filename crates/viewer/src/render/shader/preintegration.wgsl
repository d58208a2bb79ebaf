// The opacity of a step along which the distance to the boundary changes evenly: the twin of classify/preintegration.rs.

const STRETCHES: f32 = 512.0;
const LEVELS: f32 = 64.0;
const SHORTEST: f32 = 0.015625;

// The integral of τ from 0 to a signed distance.
fn optical_depth(emphasis: u32, level: f32, distance: f32) -> f32 {
    let row = 2u * emphasis + select(0u, 1u, distance < 0.0);
    let scale = textureLoad(emphasis_table, vec2<u32>(0u, row), 0).x * (STRETCHES / INTERVALS);
    let place = min(abs(distance) * scale, STRETCHES);
    let stretch = u32(place);
    let lower = min(u32(level), u32(LEVELS) - 2u);
    let along = place - f32(stretch);
    let low_start = textureLoad(preintegration, vec3<u32>(stretch, lower, row), 0).x;
    let low_end = textureLoad(preintegration, vec3<u32>(stretch + 1u, lower, row), 0).x;
    let high_start = textureLoad(preintegration, vec3<u32>(stretch, lower + 1u, row), 0).x;
    let high_end = textureLoad(preintegration, vec3<u32>(stretch + 1u, lower + 1u, row), 0).x;
    let low = low_start + along * (low_end - low_start);
    let high = high_start + along * (high_end - high_start);
    let integral = low + (level - f32(lower)) * (high - low);
    return select(integral, -integral, distance < 0.0);
}

// The opacity for each L_min of a step around a signed distance that changes by `half` to either side; that is 0 where the
// distance counts for all of it.
fn opacity_of_step(bin: vec2<u32>, by_role: f32, distance: f32, half: f32) -> f32 {
    let emphasis = textureLoad(emphases, bin, 0).x;
    if half == 0.0 {
        return by_role * opacity_by_distance(emphasis, distance);
    }
    let level = (LEVELS - 1.0) * (1.0 - sqrt(max(1.0 - by_role, 0.0)));
    let depth = optical_depth(emphasis, level, distance + half) - optical_depth(emphasis, level, distance - half);
    return 1.0 - exp(-depth / (2.0 * half));
}
