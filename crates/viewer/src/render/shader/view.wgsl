// Rays: from a pixel to where its ray enters and leaves the box. Space: grid axes, lengths in multiples of L_min.

const MOST_PLANES: u32 = 10u;
// Cells along a side of a brick.
const BRICK: i32 = 32;
// Whether the volume is there brick by brick.
override HAS_BRICKS: bool = false;
// Whether rays count their samples.
override COUNTS: bool = false;
// Whether its normals and gradient magnitudes have textures of their own.
override HAS_COMPRESSED_NORMALS: bool = false;

struct Uniforms {
    origin: vec3<f32>,
    step: f32,
    origin_right: vec3<f32>,
    termination_opacity: f32,
    origin_up: vec3<f32>,
    distance_scale: f32,
    direction: vec3<f32>,
    reach: f32,
    direction_right: vec3<f32>,
    ambient: f32,
    direction_up: vec3<f32>,
    diffuse: f32,
    box_low: vec3<f32>,
    specular: f32,
    box_high: vec3<f32>,
    half_step: f32,
    spacing: vec3<f32>,
    // What decides on colour and opacity: see value.wgsl.
    classification: u32,
    inverse_spacing: vec3<f32>,
    // How much of what `occlusion_shares` says counts.
    occlusion: f32,
    light: vec3<f32>,
    padding_after_light: f32,
    background: vec3<f32>,
    padding_after_background: f32,
    last_voxel: vec3<i32>,
    first_row: i32,
    image_size: vec2<f32>,
    plane_count: u32,
    jitter: u32,
    // Those that cut: unit normal, and the largest product with it that is drawn.
    planes: array<vec4<f32>, MOST_PLANES>,
    // Numbers of slices: their growth along each axis, and that of the origin, negated.
    slicing: vec4<f32>,
}

struct Ray {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

@group(0) @binding(0) var<uniform> frame: Uniforms;
// Value, distance, gradient magnitude at the hit and normal, as stored: of the whole volume, or of some of its bricks.
@group(0) @binding(1) var volume: texture_3d<u32>;
// Where normals are compressed, `volume` has value and distance alone. Gradient magnitudes, whose lowest bit says that the
// normal's z is negative:
@group(0) @binding(13) var gradients: texture_3d<u32>;
// and places on the half octahedron.
@group(0) @binding(14) var normals: texture_3d<f32>;
// For every brick where its first voxel lies in `volume`, and 1, or 0 where it is not there.
@group(0) @binding(7) var pages: texture_3d<u32>;
// Colour and opacity by value (x) and gradient magnitude at the hit (y), in shares of 65535.
@group(0) @binding(2) var opacity_table: texture_2d<u32>;
// Which αd goes with each of its entries.
@group(0) @binding(4) var emphases: texture_2d<u32>;
// αd by distance; two rows an emphasis: that of the high-value side first.
@group(0) @binding(5) var emphasis_table: texture_2d<f32>;
// Integrals of the optical depth by distance (x), for levels of αu (y) and rows of the table above (z).
@group(0) @binding(6) var preintegration: texture_3d<f32>;
// How many macrocells each is away from one in which something can be drawn.
@group(0) @binding(3) var occupancy: texture_3d<u32>;

// One triangle that covers the picture.
@vertex
fn vertex_main(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u));
    return vec4<f32>(corner * 4.0 - 1.0, 0.0, 1.0);
}

// The ray through a pixel; `pixel` counts from the top left, the first pixel's middle at (0.5, 0.5).
fn pixel_ray(pixel: vec2<f32>) -> Ray {
    let right = pixel.x / frame.image_size.x * 2.0 - 1.0;
    let up = 1.0 - pixel.y / frame.image_size.y * 2.0;
    let origin = frame.origin + right * frame.origin_right + up * frame.origin_up;
    let direction = frame.direction + right * frame.direction_right + up * frame.direction_up;
    return Ray(origin, direction / sqrt(dot(direction, direction)));
}

fn nonzero(component: f32) -> f32 {
    // A component of exactly 0 would make 0 times infinity. All others keep their sign, by which rays go forwards or backwards.
    return select(component, select(1e-20, -1e-20, component < 0.0), abs(component) < 1e-20);
}

// By how much a ray's parameter grows per unit along each axis; finite.
fn inverse_direction(ray: Ray) -> vec3<f32> {
    let direction = ray.direction;
    return 1.0 / vec3<f32>(nonzero(direction.x), nonzero(direction.y), nonzero(direction.z));
}

// Entry and exit along a ray, not before its origin; the entry lies behind the exit where the ray misses.
fn intersect_box(ray: Ray, inverse: vec3<f32>) -> vec2<f32> {
    let to_low = (frame.box_low - ray.origin) * inverse;
    let to_high = (frame.box_high - ray.origin) * inverse;
    let near = min(to_low, to_high);
    let far = max(to_low, to_high);
    return vec2<f32>(max(max(near.x, near.y), max(near.z, 0.0)), min(min(far.x, far.y), far.z));
}

// The part of a ray that is drawn, and the normal of the plane that it enters through, 0 where that is not one that cuts.
struct Interval {
    entry: f32,
    exit: f32,
    cut: vec3<f32>,
}

// The part of a ray inside the box that no plane cuts away.
fn drawn_interval(ray: Ray, inverse: vec3<f32>) -> Interval {
    let inside = intersect_box(ray, inverse);
    var interval = Interval(inside.x, inside.y, vec3<f32>(0.0));
    for (var index = 0u; index < frame.plane_count; index++) {
        let plane = frame.planes[index];
        let along = dot(plane.xyz, ray.direction);
        let room = plane.w - dot(plane.xyz, ray.origin);
        // A ray along the plane lies on one side of it as a whole.
        let is_parallel = abs(along) < 1e-20;
        let meets = room / select(along, 1.0, is_parallel);
        if is_parallel {
            if room < 0.0 {
                interval.exit = -1.0;
            }
        } else if along > 0.0 {
            interval.exit = min(interval.exit, meets);
        } else if meets > interval.entry {
            interval.entry = meets;
            interval.cut = plane.xyz;
        }
    }
    return interval;
}
