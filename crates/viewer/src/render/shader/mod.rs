//! The shaders: chunks that each build on the ones before, concatenated when the program is built.

/// The whole module: vertex entry points `vertex_main` and, for slices, `slice_vertex`; fragment entry points
/// `fragment_main` for rays through a volume that is there as a whole, `fragment_count` for the same with their samples counted, `fragment_resume` and `fragment_finish` for one
/// that comes brick by brick, `slice_fragment` for slices and `slices_over_background` for what they come to.
pub const SOURCE: &str = concat!(
    include_str!("view.wgsl"),
    include_str!("classification.wgsl"),
    include_str!("preintegration.wgsl"),
    include_str!("sampling.wgsl"),
    include_str!("value.wgsl"),
    include_str!("shading.wgsl"),
    include_str!("leaping.wgsl"),
    include_str!("occlusion.wgsl"),
    include_str!("opaque.wgsl"),
    include_str!("cells.wgsl"),
    include_str!("compositing.wgsl"),
    include_str!("resuming.wgsl"),
    include_str!("slicing.wgsl"),
    include_str!("counting.wgsl"),
);

/// The module that draws triangles: vertex entry point `geometry_vertex`, fragment entry point `geometry_fragment`.
pub const GEOMETRY_SOURCE: &str =
    concat!(include_str!("view.wgsl"), include_str!("shading.wgsl"), include_str!("geometry.wgsl"));

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;
    use crate::classify::emphasis_table::INTERVALS;
    use crate::classify::macrocells::MACROCELL;
    use crate::classify::occlusion::{FADE, TOWARDS_VIEWER};
    use crate::classify::opacity::{GRADIENT_BINS, VALUE_BINS};
    use crate::classify::preintegration::{LEVELS, SHORTEST, STRETCHES};
    use crate::classify::value_table::{NARROW, PARTS, SIDE};
    use crate::frame::MOST_PLANES;
    use crate::reference::FACE_DEPTH;
    use crate::render::brick_atlas::BRICK;
    use crate::scene::projection;
    use crate::slicing::{NEAR, SLACK};

    const CHUNKS: [(&str, &str); 14] = [
        ("view", include_str!("view.wgsl")),
        ("classification", include_str!("classification.wgsl")),
        ("preintegration", include_str!("preintegration.wgsl")),
        ("sampling", include_str!("sampling.wgsl")),
        ("value", include_str!("value.wgsl")),
        ("shading", include_str!("shading.wgsl")),
        ("leaping", include_str!("leaping.wgsl")),
        ("occlusion", include_str!("occlusion.wgsl")),
        ("opaque", include_str!("opaque.wgsl")),
        ("cells", include_str!("cells.wgsl")),
        ("compositing", include_str!("compositing.wgsl")),
        ("resuming", include_str!("resuming.wgsl")),
        ("slicing", include_str!("slicing.wgsl")),
        ("counting", include_str!("counting.wgsl")),
    ];

    #[test]
    fn every_chunk_is_valid_after_the_ones_before() {
        let mut source = String::new();
        for (name, chunk) in CHUNKS {
            source.push_str(chunk);
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{name}.wgsl: {}", error.emit_to_string(&source)));
            // No capability beyond what every WebGPU device has.
            Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|error| panic!("{name}.wgsl: {}", error.emit_to_string(&source)));
        }
        assert_eq!(source, SOURCE);
    }

    #[test]
    fn geometry_is_valid() {
        let module = naga::front::wgsl::parse_str(GEOMETRY_SOURCE)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(GEOMETRY_SOURCE)));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(GEOMETRY_SOURCE)));
        assert!(GEOMETRY_SOURCE.contains(&format!("const NEAREST: f32 = {:?};", projection::NEAR)));
    }

    #[test]
    fn sizes_are_the_program_s() {
        assert!(SOURCE.contains(&format!("const STRETCHES: f32 = {STRETCHES}.0;")));
        assert!(SOURCE.contains(&format!("const LEVELS: f32 = {LEVELS}.0;")));
        assert!(SOURCE.contains(&format!("const SHORTEST: f32 = {SHORTEST};")));
        assert!(SOURCE.contains(&format!("const INTERVALS: f32 = {INTERVALS:?}.0;")));
        assert!(SOURCE.contains(&format!("const MOST_PLANES: u32 = {MOST_PLANES}u;")));
        assert!(SOURCE.contains(&format!("const FACE_DEPTH: f32 = {FACE_DEPTH:?};")));
        assert!(SOURCE.contains(&format!("const BRICK: i32 = {BRICK};")));
        assert!(SOURCE.contains(&format!("const NEAR: f32 = {NEAR:?};")));
        assert!(SOURCE.contains(&format!("const SLACK: f32 = {SLACK:?};")));
        assert!(SOURCE.contains(&format!("const PARTS: f32 = {PARTS}.0;")));
        assert!(SOURCE.contains(&format!("const SIDE: f32 = {SIDE}.0;")));
        assert!(SOURCE.contains(&format!("const NARROW: f32 = {NARROW:?};")));
        assert!(SOURCE.contains(&format!("const MACROCELL: i32 = {MACROCELL};")));
        assert!(SOURCE.contains(&format!("const TOWARDS_VIEWER: f32 = {TOWARDS_VIEWER:?};")));
        assert!(SOURCE.contains(&format!("const FADE: f32 = {FADE:?};")));
        assert!(SOURCE.contains(&format!("const VALUE_BINS: u32 = {VALUE_BINS}u;")));
        assert!(SOURCE.contains(&format!("const GRADIENT_BINS: u32 = {GRADIENT_BINS}u;")));
    }
}
