// What was drawn of opaque geometry before the rays are cast: the twin of scene/rasterizer.rs's pixels.

// Lit colours; alpha is 0 where there is nothing.
@group(0) @binding(10) var opaque_color: texture_2d<f32>;
// Where along the pixel's ray it lies: the number's bits, because not every device draws into textures of floats.
@group(0) @binding(11) var opaque_along: texture_2d<u32>;

// Farther than anything.
const NOWHERE: f32 = 3e38;

struct Opaque {
    color: vec3<f32>,
    along: f32,
    is_some: bool,
}

fn opaque_pixel(position: vec2<f32>) -> Opaque {
    // A scene without geometry is one texel.
    let pixel = min(vec2<u32>(position), textureDimensions(opaque_along) - 1u);
    let color = textureLoad(opaque_color, pixel, 0);
    let along = bitcast<f32>(textureLoad(opaque_along, pixel, 0).x);
    return Opaque(color.rgb, select(NOWHERE, along, color.a > 0.5), color.a > 0.5);
}
