// Colour and opacity by value, or as stored: the twin of classify/value_table.rs and reference/by_value.rs.

const BY_ROLES: u32 = 0u;
const STORED: u32 = 1u;
const BY_VALUE: u32 = 2u;
const BY_VALUE_IN_ORDER: u32 = 3u;
const PARTS: f32 = 1024.0;
const SIDE: f32 = 256.0;
const NARROW: f32 = 2.0;

// Row 0: colour and opacity by value; row 1: integrals of both.
@group(0) @binding(8) var value_table: texture_2d<f32>;
// Colour times opacity and opacity, by the values at a step's back (x) and front (y).
@group(0) @binding(9) var front_to_back: texture_2d<f32>;

struct Interpolated {
    value: f32,
    third: f32,
    normal: vec3<f32>,
}

fn interpolate(place: Place) -> Interpolated {
    let offset = offset_of(place.base);
    var sum = Interpolated(0.0, 0.0, vec3<f32>(0.0));
    for (var corner = 0; corner < 8; corner++) {
        let side = vec3<i32>(corner & 1, (corner >> 1u) & 1, corner >> 2u);
        let texel = voxel(place.base + side, offset);
        let weights = select(1.0 - place.fraction, place.fraction, side == vec3<i32>(1));
        let weight = weights.x * weights.y * weights.z;
        sum.value += weight * f32(texel.x);
        sum.third += weight * f32(texel.z);
        if has_hit(texel) {
            sum.normal += weight * decode_normal(texel);
        }
    }
    return sum;
}

fn between(row: i32, place: f32) -> vec4<f32> {
    let lower = min(i32(place), i32(PARTS));
    let low = textureLoad(value_table, vec2<i32>(lower, row), 0);
    return low + (place - f32(lower)) * (textureLoad(value_table, vec2<i32>(lower + 1, row), 0) - low);
}

fn in_row(row: i32, back: f32) -> vec4<f32> {
    let lower = min(i32(back), i32(SIDE) - 2);
    let low = textureLoad(front_to_back, vec2<i32>(lower, row), 0);
    return low + (back - f32(lower)) * (textureLoad(front_to_back, vec2<i32>(lower + 1, row), 0) - low);
}

// Colour and opacity for a path of L_min along which the value goes from one to another.
fn look_up(front_value: f32, back_value: f32) -> vec4<f32> {
    let front = front_value * (PARTS / 65535.0);
    let back = back_value * (PARTS / 65535.0);
    let parts = back - front;
    if abs(parts) < NARROW {
        return between(0, 0.5 * (front + back));
    }
    if frame.classification == BY_VALUE_IN_ORDER {
        let place = vec2<f32>(front, back) * ((SIDE - 1.0) / PARTS);
        let row = min(i32(place.x), i32(SIDE) - 2);
        let near = in_row(row, place.y);
        let light = near + (place.x - f32(row)) * (in_row(row + 1, place.y) - near);
        return vec4<f32>(light.rgb / max(light.a, 1e-30), light.a);
    }
    let difference = between(1, back) - between(1, front);
    if difference.a == 0.0 {
        return vec4<f32>(0.0);
    }
    return vec4<f32>(difference.rgb / difference.a, 1.0 - exp(-difference.a / parts));
}

fn sample_value(position: vec3<f32>, direction: vec3<f32>) -> RoleSample {
    let middle = interpolate(place_at(position));
    if frame.classification == STORED {
        return RoleSample(middle.value / 65535.0, vec3<f32>(middle.third / 65535.0), vec3<f32>(0.0));
    }
    var front = middle.value;
    var back = middle.value;
    if half_step > 0.0 {
        front = interpolate(place_at(position - half_step * direction)).value;
        back = interpolate(place_at(position + half_step * direction)).value;
    }
    let light = look_up(front, back);
    let squared = dot(middle.normal, middle.normal);
    // Opposite normals cancel.
    let unit = select(vec3<f32>(0.0), middle.normal / sqrt(max(squared, 1e-8)), squared > 1e-8);
    return RoleSample(light.a, light.rgb, unit);
}

// The sample at a position whose place is known, whatever decides on its colour and opacity.
fn sample_at(position: vec3<f32>, place: Place, direction: vec3<f32>, cell: ptr<function, Cell>) -> RoleSample {
    if frame.classification == BY_ROLES {
        return sample_role(place, direction, cell);
    }
    return sample_value(position, direction);
}

// 1 more than the number of the brick that a sample needs and that is not there, or 0.
fn brick_wanted(position: vec3<f32>, place: Place, direction: vec3<f32>) -> u32 {
    var wanted = brick_if_missing(place.base);
    if frame.classification >= BY_VALUE && wanted == 0u {
        wanted = brick_if_missing(place_at(position - half_step * direction).base);
        if wanted == 0u {
            wanted = brick_if_missing(place_at(position + half_step * direction).base);
        }
    }
    return wanted;
}

fn brick_if_missing(base: vec3<i32>) -> u32 {
    if page_of(base).w != 0 {
        return 0u;
    }
    let grid = vec3<i32>(textureDimensions(pages));
    let brick = base / BRICK;
    return u32((brick.z * grid.y + brick.y) * grid.x + brick.x) + 1u;
}
