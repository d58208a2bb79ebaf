// Opacity, colour and normal between voxels: the twin of reference/by_role.rs; reference/sampling.rs explains the rule.

// How far a sample stands for its ray to either side; 0 where its place counts for all of that. Set by whoever samples.
var<private> half_step: f32;

struct RoleSample {
    opacity: f32,
    color: vec3<f32>,
    // Unit vector, or 0 where there is none.
    normal: vec3<f32>,
}

// Eight voxels; the digits count along x, y, z.
struct Cell {
    base: vec3<i32>,
    is_active: bool,
    t000: vec4<u32>,
    t100: vec4<u32>,
    t010: vec4<u32>,
    t110: vec4<u32>,
    t001: vec4<u32>,
    t101: vec4<u32>,
    t011: vec4<u32>,
    t111: vec4<u32>,
}

// Sums over a cell's voxels, weighted by opacity.
struct RoleSum {
    opacity: f32,
    color: vec3<f32>,
    normal: vec3<f32>,
}

fn signed_distance_bits(texel: vec4<u32>) -> i32 {
    return bitcast<i32>(texel.y << 16u) >> 16u;
}

fn has_hit(texel: vec4<u32>) -> bool {
    return signed_distance_bits(texel) >= -32766 && texel.z != 0u;
}

fn stored_distance(texel: vec4<u32>) -> f32 {
    return f32(signed_distance_bits(texel)) * frame.distance_scale;
}

// Whether a voxel can be drawn somewhere in its cell: its plane's distance changes there by the diagonal at most.
fn is_within_reach(texel: vec4<u32>) -> bool {
    return has_hit(texel) && abs(stored_distance(texel)) < frame.reach;
}

// The unit vector of a texel's octahedral normal, or 0 for none.
fn decode_normal(texel: vec4<u32>) -> vec3<f32> {
    let stored = texel.w;
    if HAS_COMPRESSED_NORMALS {
        // The twin of compressed_normals.rs.
        let turned = unpack2x16snorm(stored);
        let flat = 0.5 * vec2<f32>(turned.x + turned.y, turned.x - turned.y);
        let height = 1.0 - abs(flat.x) - abs(flat.y);
        let on_half = vec3<f32>(flat, select(height, -height, (texel.z & 1u) == 1u));
        return on_half / sqrt(dot(on_half, on_half));
    }
    if stored == 0x8080u {
        return vec3<f32>(0.0);
    }
    let bytes = vec2<i32>(bitcast<i32>(stored << 24u) >> 24u, bitcast<i32>(stored << 16u) >> 24u);
    let square = vec2<f32>(bytes) / 127.0;
    let z = 1.0 - abs(square.x) - abs(square.y);
    let folded = (1.0 - abs(square.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), square >= vec2<f32>(0.0));
    let vector = vec3<f32>(select(folded, square, z >= 0.0), z);
    return vector / sqrt(dot(vector, vector));
}

// Where a cell's brick lies in the texture, and 1, or 0 where it is not there.
fn page_of(base: vec3<i32>) -> vec4<i32> {
    return vec4<i32>(textureLoad(pages, base / BRICK, 0));
}

// From a voxel's index to its place in the texture, for the voxels of a cell.
fn offset_of(base: vec3<i32>) -> vec3<i32> {
    if !HAS_BRICKS {
        return vec3<i32>(0);
    }
    return page_of(base).xyz - base / BRICK * BRICK;
}

fn voxel(index: vec3<i32>, offset: vec3<i32>) -> vec4<u32> {
    let place = min(index, frame.last_voxel) + offset;
    let texel = textureLoad(volume, place, 0);
    if HAS_COMPRESSED_NORMALS {
        let gradient = textureLoad(gradients, place, 0).x;
        return vec4<u32>(texel.xy, gradient, pack2x16snorm(textureLoad(normals, place, 0).xy));
    }
    return texel;
}

fn load_cell(base: vec3<i32>) -> Cell {
    var cell: Cell;
    cell.base = base;
    let offset = offset_of(base);
    cell.t000 = voxel(base, offset);
    cell.t100 = voxel(base + vec3<i32>(1, 0, 0), offset);
    cell.t010 = voxel(base + vec3<i32>(0, 1, 0), offset);
    cell.t110 = voxel(base + vec3<i32>(1, 1, 0), offset);
    cell.t001 = voxel(base + vec3<i32>(0, 0, 1), offset);
    cell.t101 = voxel(base + vec3<i32>(1, 0, 1), offset);
    cell.t011 = voxel(base + vec3<i32>(0, 1, 1), offset);
    cell.t111 = voxel(base + vec3<i32>(1, 1, 1), offset);
    cell.is_active = is_within_reach(cell.t000) || is_within_reach(cell.t100)
        || is_within_reach(cell.t010) || is_within_reach(cell.t110)
        || is_within_reach(cell.t001) || is_within_reach(cell.t101)
        || is_within_reach(cell.t011) || is_within_reach(cell.t111);
    return cell;
}

// Adds one voxel; `fraction` is the place in the cell, `corner` the voxel's.
fn add_voxel(
    sum: ptr<function, RoleSum>,
    texel: vec4<u32>,
    weight: f32,
    value: f32,
    fraction: vec3<f32>,
    corner: vec3<f32>,
    direction: vec3<f32>,
) {
    if weight == 0.0 || !has_hit(texel) {
        return;
    }
    let bin = role_bin(value, texel.z);
    let by_role = opacity_by_role(bin);
    if by_role.a == 0.0 {
        return;
    }
    let normal = decode_normal(texel);
    let distance = stored_distance(texel) + dot(normal, (fraction - corner) * frame.spacing);
    let half = select(0.0, max(abs(dot(normal, direction)) * half_step, 0.5 * SHORTEST), half_step > 0.0);
    let share = weight * opacity_of_step(bin, by_role.a, distance, half);
    (*sum).opacity += share;
    (*sum).color += share * by_role.rgb;
    (*sum).normal += share * normal;
}

fn sample_cell(cell: Cell, fraction: vec3<f32>, direction: vec3<f32>) -> RoleSample {
    let high = fraction;
    let low = 1.0 - fraction;
    let w000 = low.x * low.y * low.z;
    let w100 = high.x * low.y * low.z;
    let w010 = low.x * high.y * low.z;
    let w110 = high.x * high.y * low.z;
    let w001 = low.x * low.y * high.z;
    let w101 = high.x * low.y * high.z;
    let w011 = low.x * high.y * high.z;
    let w111 = high.x * high.y * high.z;
    let value = w000 * f32(cell.t000.x) + w100 * f32(cell.t100.x) + w010 * f32(cell.t010.x)
        + w110 * f32(cell.t110.x) + w001 * f32(cell.t001.x) + w101 * f32(cell.t101.x)
        + w011 * f32(cell.t011.x) + w111 * f32(cell.t111.x);
    var sum = RoleSum(0.0, vec3<f32>(0.0), vec3<f32>(0.0));
    add_voxel(&sum, cell.t000, w000, value, fraction, vec3<f32>(0.0, 0.0, 0.0), direction);
    add_voxel(&sum, cell.t100, w100, value, fraction, vec3<f32>(1.0, 0.0, 0.0), direction);
    add_voxel(&sum, cell.t010, w010, value, fraction, vec3<f32>(0.0, 1.0, 0.0), direction);
    add_voxel(&sum, cell.t110, w110, value, fraction, vec3<f32>(1.0, 1.0, 0.0), direction);
    add_voxel(&sum, cell.t001, w001, value, fraction, vec3<f32>(0.0, 0.0, 1.0), direction);
    add_voxel(&sum, cell.t101, w101, value, fraction, vec3<f32>(1.0, 0.0, 1.0), direction);
    add_voxel(&sum, cell.t011, w011, value, fraction, vec3<f32>(0.0, 1.0, 1.0), direction);
    add_voxel(&sum, cell.t111, w111, value, fraction, vec3<f32>(1.0, 1.0, 1.0), direction);
    if sum.opacity <= 0.0 {
        return RoleSample(0.0, vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let normal = sum.normal / sum.opacity;
    let squared = dot(normal, normal);
    // Opposite normals cancel.
    let unit = select(vec3<f32>(0.0), normal / sqrt(max(squared, 1e-8)), squared > 1e-8);
    return RoleSample(min(sum.opacity, 1.0), sum.color / sum.opacity, unit);
}

// A cell, by its lowest voxel, and where in it.
struct Place {
    base: vec3<i32>,
    fraction: vec3<f32>,
}

fn place_at(position: vec3<f32>) -> Place {
    let last = vec3<f32>(frame.last_voxel);
    let index = clamp(position * frame.inverse_spacing, vec3<f32>(0.0), last);
    let base = min(floor(index), max(last - 1.0, vec3<f32>(0.0)));
    return Place(vec3<i32>(base), index - base);
}

// The sample at a place, for a step along a unit vector; `cell` is the last sample's and is replaced where the place lies in another.
fn sample_role(place: Place, direction: vec3<f32>, cell: ptr<function, Cell>) -> RoleSample {
    if any(place.base != (*cell).base) {
        *cell = load_cell(place.base);
    }
    if !(*cell).is_active {
        return RoleSample(0.0, vec3<f32>(0.0), vec3<f32>(0.0));
    }
    return sample_cell(*cell, place.fraction, direction);
}
