// Light on a boundary, both sides alike: the twin of reference/shading.rs.

fn shade(color: vec3<f32>, normal: vec3<f32>, to_viewer: vec3<f32>) -> vec3<f32> {
    if all(normal == vec3<f32>(0.0)) {
        return color;
    }
    let diffuse = abs(dot(normal, frame.light));
    let half = frame.light + to_viewer;
    let length = sqrt(dot(half, half));
    // A light exactly opposite leaves no direction to be halved.
    let aligned = select(0.0, dot(normal, half / max(length, 1e-6)), length > 1e-6);
    let squared = aligned * aligned;
    let fourth = squared * squared;
    let lit = (frame.ambient + frame.diffuse * diffuse) * color + frame.specular * (fourth * fourth);
    return clamp(lit, vec3<f32>(0.0), vec3<f32>(1.0));
}
