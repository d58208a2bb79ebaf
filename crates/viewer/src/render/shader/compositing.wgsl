// Front-to-back compositing along a ray: the twin of reference/rays.rs and reference/tile.rs.

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

// What was sampled, where rays count.
var<private> taken: u32;

const NO_PROGRESS: Progress = Progress(vec4<f32>(0.0), 0.0, 0u);

// What of a ray is drawn.
struct Stretch {
    begin: f32,
    end: f32,
    // Of samples at equal distances: their distance, how far into its step the first one lies, and how many steps end
    // before what is opaque, where the next one is cut short.
    step: f32,
    first: f32,
    whole: f32,
    // Where the ray enters what is drawn, and the normal of the plane that it enters through, 0 where that does not cut.
    entry: f32,
    cut: vec3<f32>,
    // Whether the first sample is lit as the face of a cut, however far it reaches.
    begins_at_face: bool,
}

// All of a ray up to what is opaque.
fn whole_stretch(ray: Ray, first: f32, opaque: Opaque) -> Stretch {
    let interval = drawn_interval(ray, inverse_direction(ray));
    // The step that something opaque cuts short counts for its share alone.
    let steps_before = max(floor((opaque.along - interval.entry) / frame.step - first + 0.5), 0.0);
    let whole = select(NOWHERE, steps_before, opaque.along < interval.exit);
    let end = min(interval.exit, opaque.along);
    return Stretch(interval.entry, end, frame.step, first, whole, interval.entry, interval.cut, true);
}

fn goes_by_cells() -> bool {
    return frame.classification == BY_ROLES && frame.half_step > 0.0;
}

// Light along a stretch of a ray that goes on from where it was: with samples at equal distances, or from cell to cell, what
// lies in each cut into equal pieces. Each turn of the loop takes one sample, whichever way, so that rays beside each other
// wait little for each other.
fn march(ray: Ray, stretch: Stretch, start: Progress) -> Progress {
    let inverse = inverse_direction(ray);
    let by_cells = goes_by_cells();
    var cell: Cell;
    cell.base = vec3<i32>(-1);
    var sum = start.light;
    var wanted = 0u;
    var count = start.count;
    // By cells: the one to be entered next; of the last one entered, its place, where it begins, and its pieces.
    var next = CellPlace(vec3<f32>(0.0), max(stretch.begin, start.count));
    if by_cells {
        next.cell = cell_at(ray, inverse, next.along);
    }
    var entered = next;
    var piece = 0.0;
    var pieces = 0.0;
    var length = 0.0;
    while sum.a <= frame.termination_opacity {
        var place: Place;
        var along: f32;
        var step: f32;
        if by_cells {
            if piece >= pieces {
                if !(next.along < stretch.end) {
                    break;
                }
                let base = vec3<i32>(next.cell);
                let empty = i32(textureLoad(occupancy, base / MACROCELL, 0).x);
                if empty > 0 {
                    next = leap(ray, inverse, next.cell, empty);
                    continue;
                }
                if HAS_BRICKS {
                    wanted = brick_if_missing(base);
                    if wanted != 0u {
                        break;
                    }
                }
                if COUNTS {
                    taken += 1u;
                }
                cell = load_cell(base);
                let exits = exits_of(ray, inverse, next.cell);
                let end = min(min(exits.x, min(exits.y, exits.z)), stretch.end);
                entered = next;
                next = CellPlace(next_cell(ray, next.cell, exits), end);
                piece = 0.0;
                pieces = select(0.0, ceil((end - entered.along) / (2.0 * frame.half_step)), cell.is_active);
                length = (end - entered.along) / max(pieces, 1.0);
                if pieces <= 0.0 {
                    continue;
                }
            }
            step = length;
            along = entered.along + (piece + 0.5) * length;
            place = Place(vec3<i32>(entered.cell), fraction_in(ray, entered.cell, along));
            piece += 1.0;
        } else {
            step = stretch.step;
            along = stretch.begin + (count + stretch.first) * step;
            if count > stretch.whole {
                break;
            } else if count == stretch.whole {
                let begin = max(stretch.begin, stretch.begin + (count + stretch.first - 0.5) * step);
                step = stretch.end - begin;
                along = begin + 0.5 * step;
                if !(step > 0.0) {
                    break;
                }
            } else if along >= stretch.end {
                break;
            }
            place = place_at(ray.origin + along * ray.direction);
            let empty = i32(textureLoad(occupancy, place.base / MACROCELL, 0).x);
            if empty > 0 {
                // To the first sample beyond all that is known to be empty.
                let beyond = floor((leaves(ray, inverse, place.base, empty) - stretch.begin) / stretch.step);
                count = max(beyond, count + 1.0);
                continue;
            }
        }
        half_step = min(frame.half_step, 0.5 * step);
        let position = ray.origin + along * ray.direction;
        if HAS_BRICKS && !by_cells && any(place.base != cell.base) {
            wanted = brick_wanted(position, place, ray.direction);
            if wanted != 0u {
                break;
            }
        }
        if COUNTS && !by_cells {
            taken += 1u;
        }
        let role = sample_at(position, place, ray.direction, &cell);
        if role.opacity > 0.0 {
            let is_first = !by_cells && count == 0.0 && stretch.begins_at_face;
            let face = select(clamp((stretch.entry + FACE_DEPTH - along) / step + 0.5, 0.0, 1.0), 1.0, is_first);
            sum += (1.0 - sum.a) * light_of_sample(role, ray, along, stretch.cut, face, step);
        }
        // Not a running sum, whose rounding errors would add up.
        count += 1.0;
    }
    return Progress(sum, select(count, next.along, by_cells), wanted);
}

// Display values of light over what is opaque, or over the background.
fn over_background(light: vec4<f32>, opaque: Opaque) -> vec4<f32> {
    let color = light.rgb + (1.0 - light.a) * select(frame.background, opaque.color, opaque.is_some);
    return vec4<f32>(clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)), 1.0);
}

@fragment
fn fragment_main(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let opaque = opaque_pixel(position.xy);
    let stretch = whole_stretch(pixel_ray(position.xy), first_sample(vec2<u32>(position.xy)), opaque);
    return over_background(march(pixel_ray(position.xy), stretch, NO_PROGRESS).light, opaque);
}
