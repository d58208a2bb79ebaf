// Light that is kept from places that lie among much that is drawn: the twin of reference/occlusion.rs.

// How far before a sample, towards the viewer, its light is looked up.
const TOWARDS_VIEWER: f32 = 10.0;
// How many macrocells beyond the volume light comes from everywhere.
const FADE: f32 = 3.0;

// How little light comes to every macrocell's middle, in shares of 255; one number where light comes everywhere.
@group(0) @binding(12) var occlusion_shares: texture_3d<u32>;

fn occlusion_share(macrocell: vec3<i32>) -> f32 {
    return f32(textureLoad(occlusion_shares, macrocell, 0).x);
}

fn between_shares(low: f32, high: f32, share: f32) -> f32 {
    return low + share * (high - low);
}

// The share of the light that is left so far along a ray: linear between macrocells' middles.
fn light_at(ray: Ray, along: f32) -> f32 {
    if frame.occlusion == 0.0 {
        return 1.0;
    }
    let last = vec3<i32>(textureDimensions(occlusion_shares)) - 1;
    let position = ray.origin + (along - TOWARDS_VIEWER) * ray.direction;
    let wanted = position * frame.inverse_spacing / f32(MACROCELL) - 0.5;
    let place = clamp(wanted, vec3<f32>(0.0), vec3<f32>(last));
    let beyond = abs(wanted - place);
    let left = 1.0 - max(max(beyond.x, beyond.y), beyond.z) / FADE;
    if left <= 0.0 {
        return 1.0;
    }
    let low = vec3<i32>(place);
    let high = min(low + 1, last);
    let fraction = place - vec3<f32>(low);
    var along_y: array<f32, 2>;
    for (var side = 0; side < 2; side++) {
        let z = select(low.z, high.z, side == 1);
        let near = between_shares(
            occlusion_share(vec3<i32>(low.x, low.y, z)),
            occlusion_share(vec3<i32>(high.x, low.y, z)),
            fraction.x,
        );
        let far = between_shares(
            occlusion_share(vec3<i32>(low.x, high.y, z)),
            occlusion_share(vec3<i32>(high.x, high.y, z)),
            fraction.x,
        );
        along_y[side] = between_shares(near, far, fraction.y);
    }
    return 1.0 - frame.occlusion * (left * between_shares(along_y[0], along_y[1], fraction.z) / 255.0);
}
