// Empty space: the twin of classify/macrocells.rs and reference/rays.rs.

// Cells along a side of a macrocell.
const MACROCELL: i32 = 4;
// How far off rounding can put a sample, as a share of the lengths that it is worked out from.
const ROUNDING: f32 = 4e-6;

// A parameter up to which every sample lies in a macrocell closer than `empty` to that of a cell, rounding included.
fn leaves(ray: Ray, inverse: vec3<f32>, cell: vec3<i32>, empty: i32) -> f32 {
    let is_forward = ray.direction >= vec3<f32>(0.0);
    let macrocell = cell / MACROCELL;
    let corner = select(macrocell + 1 - empty, macrocell + empty, is_forward);
    let extent = frame.box_high - frame.box_low;
    let farthest = max(max(abs(ray.origin.x), abs(ray.origin.y)), abs(ray.origin.z));
    let slack = vec3<f32>(ROUNDING * (farthest + sqrt(dot(extent, extent))));
    let plane = vec3<f32>(corner * MACROCELL) * frame.spacing + select(slack, -slack, is_forward);
    let along = (plane - ray.origin) * inverse;
    return min(along.x, min(along.y, along.z));
}
