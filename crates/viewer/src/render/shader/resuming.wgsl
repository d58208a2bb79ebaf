// Rays that wait for bricks: a strip of the picture's rows, drawn in several passes.

// What the pass before left of every pixel of the strip. The bits of numbers, because not every device draws into
// textures of floats.
@group(1) @binding(0) var light_before: texture_2d<u32>;
// How far the ray has come, and the brick that is waited for.
@group(1) @binding(1) var progress_before: texture_2d<u32>;

struct StoredProgress {
    @location(0) light: vec4<u32>,
    @location(1) progress: vec2<u32>,
}

fn progress_at(place: vec2<i32>) -> Progress {
    let progress = textureLoad(progress_before, place, 0);
    return Progress(bitcast<vec4<f32>>(textureLoad(light_before, place, 0)), bitcast<f32>(progress.x), progress.y);
}

@fragment
fn fragment_resume(@builtin(position) position: vec4<f32>) -> StoredProgress {
    var progress = progress_at(vec2<i32>(position.xy));
    if progress.wanted != 0u {
        let pixel = position.xy + vec2<f32>(0.0, f32(frame.first_row));
        let ray = pixel_ray(pixel);
        progress = march(ray, whole_stretch(ray, first_sample(vec2<u32>(pixel)), opaque_pixel(pixel)), progress);
    }
    let light = bitcast<vec4<u32>>(progress.light);
    return StoredProgress(light, vec2<u32>(bitcast<u32>(progress.count), progress.wanted));
}

@fragment
fn fragment_finish(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let place = vec2<i32>(position.xy) - vec2<i32>(0, frame.first_row);
    return over_background(progress_at(place).light, opaque_pixel(position.xy));
}
