// Triangles into colour and place along the pixel's ray: the twin of scene/rasterizer.rs. A module of its own, after
// view and shading.

// What is closer to the eye is not drawn.
const NEAREST: f32 = 0.01;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // Alpha is 0 where planes do not cut.
    @location(2) color: vec4<f32>,
}

@vertex
fn geometry_vertex(
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec4<f32>,
) -> Corner {
    let from_eye = position - frame.origin;
    let is_perspective = any(frame.direction_right != vec3<f32>(0.0));
    let right = select(frame.origin_right, frame.direction_right, is_perspective);
    let up = select(frame.origin_up, frame.direction_up, is_perspective);
    let place = vec2<f32>(dot(from_eye, right) / dot(right, right), dot(from_eye, up) / dot(up, up));
    // Depth is written by the fragment; here z only keeps what is in front of the eye.
    let clip = select(
        vec4<f32>(place, 0.5, 1.0),
        vec4<f32>(place, NEAREST, dot(from_eye, frame.direction)),
        is_perspective,
    );
    return Corner(clip, position, normal, color);
}

struct Fragment {
    @location(0) color: vec4<f32>,
    @location(1) along: u32,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn geometry_fragment(corner: Corner) -> Fragment {
    let ray = pixel_ray(corner.clip.xy);
    let along = dot(corner.position - ray.origin, ray.direction);
    if along <= 0.0 {
        discard;
    }
    if corner.color.a > 0.5 {
        for (var index = 0u; index < frame.plane_count; index++) {
            if dot(frame.planes[index].xyz, corner.position) > frame.planes[index].w {
                discard;
            }
        }
    }
    let squared = dot(corner.normal, corner.normal);
    let normal = select(vec3<f32>(0.0), corner.normal / sqrt(max(squared, 1e-30)), squared > 1e-30);
    let color = shade(corner.color.rgb, normal, -ray.direction);
    // As many digits far away as close by.
    return Fragment(vec4<f32>(color, 1.0), bitcast<u32>(along), 1.0 / (1.0 + along));
}
