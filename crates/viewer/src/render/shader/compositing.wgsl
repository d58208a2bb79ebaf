// Front-to-back compositing along a ray: the twin of reference/mod.rs.

// Where in the first step of a pixel's ray the first sample lies: R2, a sequence whose neighbours differ much.
fn first_sample(pixel: vec2<u32>) -> f32 {
    let place = pixel.x * 3242174889u + pixel.y * 2447445414u;
    return select(0.5, f32(place >> 8u) / 16777216.0, frame.jitter != 0u);
}

// What lies this close behind a plane that cuts is lit as the plane is.
const FACE_DEPTH: f32 = 0.5;

// What a sample sends to the viewer: colour premultiplied by opacity, and opacity. `face` is the share of it that lies
// on the face of a cut with a normal that is not 0.
fn light_of_sample(role: RoleSample, ray: Ray, along: f32, cut: vec3<f32>, face: f32, step: f32) -> vec4<f32> {
    let own = light_at(ray, along) * role.color;
    let opacity = correct_opacity(role.opacity, step);
    // A face that was cut is lit as such, to a depth that does not depend on the step.
    let share = select(0.0, face, any(cut != vec3<f32>(0.0)));
    var color = shade(own, select(role.normal, cut, share == 1.0), -ray.direction);
    if share > 0.0 && share < 1.0 {
        color = mix(color, shade(own, cut, -ray.direction), share);
    }
    return opacity * vec4<f32>(color, 1.0);
}

// How far a ray has come.
struct Progress {
    // Colour premultiplied by opacity, and opacity.
    light: vec4<f32>,
    // How many steps lie behind, or where along the ray it goes on by cells.
    count: f32,
    // 1 more than the number of the brick that the ray waits for, or 0 at its end.
    wanted: u32,
}

// Light along a ray that goes on from where it was; it ends at what is opaque.
fn march(ray: Ray, first: f32, opaque: Opaque, start: Progress) -> Progress {
    if frame.classification == BY_ROLES && frame.half_step > 0.0 {
        return march_cells(ray, opaque, start);
    }
    return march_steps(ray, first, opaque, start);
}

// From cell to cell: what lies in each is cut into equal pieces.
fn march_cells(ray: Ray, opaque: Opaque, start: Progress) -> Progress {
    let inverse = inverse_direction(ray);
    let interval = drawn_interval(ray, inverse);
    let exit = min(interval.exit, opaque.along);
    var sum = start.light;
    var wanted = 0u;
    let begin = max(interval.entry, start.count);
    var place = CellPlace(cell_at(ray, inverse, begin), begin);
    while place.along < exit && sum.a <= frame.termination_opacity {
        let base = vec3<i32>(place.cell);
        let empty = i32(textureLoad(occupancy, base / MACROCELL, 0).x);
        if empty > 0 {
            place = leap(ray, inverse, place.cell, empty);
            continue;
        }
        if HAS_BRICKS {
            wanted = brick_if_missing(base);
            if wanted != 0u {
                break;
            }
        }
        let exits = exits_of(ray, inverse, place.cell);
        let end = min(min(exits.x, min(exits.y, exits.z)), exit);
        let cell = load_cell(base);
        if cell.is_active {
            let count = ceil((end - place.along) / (2.0 * frame.half_step));
            let step = (end - place.along) / count;
            half_step = 0.5 * step;
            for (var piece = 0.0; piece < count && sum.a <= frame.termination_opacity; piece += 1.0) {
                let along = place.along + (piece + 0.5) * step;
                let role = sample_cell(cell, fraction_in(ray, place.cell, along), ray.direction);
                if role.opacity > 0.0 {
                    let face = clamp((interval.entry + FACE_DEPTH - along) / step + 0.5, 0.0, 1.0);
                    sum += (1.0 - sum.a) * light_of_sample(role, ray, along, interval.cut, face, step);
                }
            }
        }
        place = CellPlace(next_cell(ray, place.cell, exits), end);
    }
    return Progress(sum, place.along, wanted);
}

// In equal steps, with the first sample so far into the first one.
fn march_steps(ray: Ray, first: f32, opaque: Opaque, start: Progress) -> Progress {
    let inverse = inverse_direction(ray);
    let interval = drawn_interval(ray, inverse);
    var cell: Cell;
    cell.base = vec3<i32>(-1);
    var sum = start.light;
    var count = start.count;
    var wanted = 0u;
    // How many steps end before what is opaque: the one that it cuts short counts for its share alone.
    let steps_before = max(floor((opaque.along - interval.entry) / frame.step - first + 0.5), 0.0);
    let whole = select(NOWHERE, steps_before, opaque.along < interval.exit);
    while count <= whole && sum.a <= frame.termination_opacity {
        var along = interval.entry + (count + first) * frame.step;
        var step = frame.step;
        half_step = frame.half_step;
        if count == whole {
            let begin = max(interval.entry, interval.entry + (whole + first - 0.5) * frame.step);
            step = opaque.along - begin;
            along = begin + 0.5 * step;
            half_step = min(half_step, 0.5 * step);
            if !(step > 0.0) {
                break;
            }
        } else if along >= interval.exit {
            break;
        }
        let position = ray.origin + along * ray.direction;
        let place = place_at(position);
        let empty = i32(textureLoad(occupancy, place.base / MACROCELL, 0).x);
        if empty > 0 {
            // To the first sample beyond all that is known to be empty.
            let beyond = floor((leaves(ray, inverse, place.base, empty) - interval.entry) / frame.step);
            count = max(beyond, count + 1.0);
            continue;
        }
        if HAS_BRICKS && any(place.base != cell.base) {
            wanted = brick_wanted(position, place, ray.direction);
            if wanted != 0u {
                break;
            }
        }
        let role = sample_at(position, place, ray.direction, &cell);
        if role.opacity > 0.0 {
            let face = select(0.0, 1.0, count == 0.0 || along - interval.entry <= FACE_DEPTH);
            sum += (1.0 - sum.a) * light_of_sample(role, ray, along, interval.cut, face, step);
        }
        // Not a running sum, whose rounding errors would add up.
        count += 1.0;
    }
    return Progress(sum, count, wanted);
}

// Display values of light over what is opaque, or over the background.
fn over_background(light: vec4<f32>, opaque: Opaque) -> vec4<f32> {
    let color = light.rgb + (1.0 - light.a) * select(frame.background, opaque.color, opaque.is_some);
    return vec4<f32>(clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)), 1.0);
}

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let opaque = opaque_pixel(position.xy);
    let start = Progress(vec4<f32>(0.0), 0.0, 0u);
    return over_background(march(pixel_ray(position.xy), first_sample(vec2<u32>(position.xy)), opaque, start).light, opaque);
}
