// Rays that count: the twin of what reference/rays.rs counts. Only where COUNTS is set.

struct Counted {
    @location(0) color: vec4<f32>,
    // Places at which the volume was sampled, or cells that were read, and those along the whole ray.
    @location(1) samples: vec2<u32>,
}

@fragment
fn fragment_count(@builtin(position) position: vec4<f32>) -> Counted {
    let opaque = opaque_pixel(position.xy);
    let ray = pixel_ray(position.xy);
    let stretch = whole_stretch(ray, first_sample(vec2<u32>(position.xy)), opaque);
    let light = march(ray, stretch, NO_PROGRESS).light;
    var all = u32(max((stretch.end - stretch.begin) / stretch.step + (1.0 - stretch.first), 0.0));
    if stretch.whole < NOWHERE {
        // As they are taken: the last one may be cut short.
        let last = max(stretch.begin, stretch.begin + (stretch.whole + stretch.first - 0.5) * stretch.step);
        all = u32(stretch.whole) + u32(stretch.end > last);
    }
    if goes_by_cells() {
        all = count_of_cells(ray, inverse_direction(ray), stretch.begin, stretch.end);
    }
    return Counted(over_background(light, opaque), vec2<u32>(taken, all));
}
