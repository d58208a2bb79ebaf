// Slices, blended back to front by the device: the twin of slicing.rs and reference/steps.rs.

// How far outside of what is drawn a slice still counts for a ray, in slabs, and at most NEAR.
const SLACK: f32 = 0.03125;
// Slices nearer than this to an eye within the volume are not seen.
const NEAR: f32 = 0.01;

// What all slices before have sent to the viewer.
@group(1) @binding(0) var slice_light: texture_2d<f32>;

struct SliceVertex {
    @builtin(position) position: vec4<f32>,
    // The slab from this number to the next one is what the slice stands for.
    @location(0) @interpolate(flat) number: f32,
}

@vertex
fn slice_vertex(@location(0) position: vec4<f32>, @location(1) number: f32) -> SliceVertex {
    return SliceVertex(position, number);
}

// What of a ray a slice stands for.
struct Piece {
    start: f32,
    end: f32,
    is_first: bool,
    is_drawn: bool,
}

fn piece_of_slab(ray: Ray, interval: Interval, number: f32) -> Piece {
    let along = dot(frame.slicing.xyz, ray.direction);
    // Counted in the ray's direction.
    let sense = select(1.0, -1.0, along < 0.0);
    let origin = sense * (dot(frame.slicing.xyz, ray.origin) - frame.slicing.w);
    let per_length = abs(along);
    let slack = min(SLACK, NEAR * per_length);
    // A ray that starts within the volume sees no slice that its eye lies in.
    let before = select(-NEAR * length(frame.slicing.xyz), slack, interval.entry > 0.0);
    let first = ceil(origin + interval.entry * per_length - 0.5 - before);
    let last = floor(origin + interval.exit * per_length - 0.5 + slack);
    let slab = sense * (number + 0.5) - 0.5;
    let start = select((slab - origin) / per_length, interval.entry, slab == first);
    let end = select((slab + 1.0 - origin) / per_length, interval.exit, slab == last);
    return Piece(start, end, slab == first, slab >= first && slab <= last && interval.exit > interval.entry);
}

@fragment
fn slice_fragment(slice: SliceVertex) -> @location(0) vec4<f32> {
    let ray = pixel_ray(slice.position.xy);
    var interval = drawn_interval(ray, inverse_direction(ray));
    interval.exit = min(interval.exit, opaque_pixel(slice.position.xy).along);
    let piece = piece_of_slab(ray, interval, slice.number);
    if !piece.is_drawn {
        discard;
    }
    // One sample, which stands for all of it, or from cell to cell.
    let step = piece.end - piece.start;
    let stretch =
        Stretch(piece.start, piece.end, step, 0.5, NOWHERE, interval.entry, interval.cut, piece.is_first);
    let light = march(ray, stretch, NO_PROGRESS).light;
    if light.a <= 0.0 {
        discard;
    }
    return light;
}

@fragment
fn slices_over_background(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return over_background(textureLoad(slice_light, vec2<i32>(position.xy), 0), opaque_pixel(position.xy));
}
