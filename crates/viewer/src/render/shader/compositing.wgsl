// Front-to-back compositing along a ray: the twin of reference/mod.rs.

// Where in the first step of a pixel's ray the first sample lies: R2, a sequence whose neighbours differ much.
fn first_sample(pixel: vec2<u32>) -> f32 {
    let place = pixel.x * 3242174889u + pixel.y * 2447445414u;
    return select(0.5, f32(place >> 8u) / 16777216.0, frame.jitter != 0u);
}

// What lies this close behind a plane that cuts is lit as the plane is.
const FACE_DEPTH: f32 = 0.5;

// What the part of a step adds that lies before something opaque, on a face that was cut where `cut` is not 0.
fn cut_short(ray: Ray, start: f32, end: f32, cut: vec3<f32>, cell: ptr<function, Cell>) -> vec4<f32> {
    let length = end - start;
    if length <= 0.0 {
        return vec4<f32>(0.0);
    }
    half_step = select(0.0, 0.5 * length, frame.half_step > 0.0);
    let role = sample_role(place_at(ray.origin + (start + 0.5 * length) * ray.direction), ray.direction, cell);
    let opacity = 1.0 - pow(max(1.0 - role.opacity, 0.0), length);
    let is_on_cut = any(cut != vec3<f32>(0.0));
    let color = shade(role.color, select(role.normal, cut, is_on_cut), -ray.direction);
    return select(vec4<f32>(0.0), opacity * vec4<f32>(color, 1.0), role.opacity > 0.0);
}

// How many steps of a ray end within a length.
fn steps_before(length: f32, first: f32) -> f32 {
    return max(floor(length / frame.step - first + 0.5), 0.0);
}

// Light along a ray, with the first sample so far into the first step: colour premultiplied by opacity, and opacity. The ray ends at
// what is opaque.
fn march(ray: Ray, first: f32, opaque: Opaque) -> vec4<f32> {
    let inverse = inverse_direction(ray);
    let interval = drawn_interval(ray, inverse);
    var cell: Cell;
    cell.base = vec3<i32>(-1);
    var sum = vec4<f32>(0.0);
    var count = 0.0;
    half_step = frame.half_step;
    // How many steps end before what is opaque: the one that it cuts short counts for its share alone.
    let is_short = opaque.along < interval.exit;
    let steps = select(NOWHERE, steps_before(opaque.along - interval.entry, first), is_short);
    var along = interval.entry + first * frame.step;
    while along < interval.exit && count < steps && sum.a <= frame.termination_opacity {
        let place = place_at(ray.origin + along * ray.direction);
        let empty = i32(textureLoad(occupancy, place.base / MACROCELL, 0).x);
        if empty > 0 {
            // To the first sample beyond all that is known to be empty.
            let beyond = floor((leaves(ray, inverse, place.base, empty) - interval.entry) / frame.step);
            count = max(beyond, count + 1.0);
            along = interval.entry + (count + first) * frame.step;
            continue;
        }
        let role = sample_role(place, ray.direction, &cell);
        if role.opacity > 0.0 {
            let opacity = correct_opacity(role.opacity);
            // A face that was cut is lit as such, to a depth that does not depend on the step.
            let is_on_cut = (count == 0.0 || along - interval.entry <= FACE_DEPTH) && any(interval.cut != vec3<f32>(0.0));
            let color = shade(role.color, select(role.normal, interval.cut, is_on_cut), -ray.direction);
            sum += (1.0 - sum.a) * opacity * vec4<f32>(color, 1.0);
        }
        // Not a running sum, whose rounding errors would add up.
        count += 1.0;
        along = interval.entry + (count + first) * frame.step;
    }
    if is_short && sum.a <= frame.termination_opacity {
        let start = max(interval.entry, interval.entry + (steps + first - 0.5) * frame.step);
        let cut = select(vec3<f32>(0.0), interval.cut, start - interval.entry <= FACE_DEPTH);
        sum += (1.0 - sum.a) * cut_short(ray, start, opaque.along, cut, &cell);
    }
    return sum;
}

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let opaque = opaque_pixel(position.xy);
    let light = march(pixel_ray(position.xy), first_sample(vec2<u32>(position.xy)), opaque);
    let color = light.rgb + (1.0 - light.a) * select(frame.background, opaque.color, opaque.is_some);
    return vec4<f32>(clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)), 1.0);
}
