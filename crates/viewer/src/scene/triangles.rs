//! Triangles with normals and colours.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A corner of triangles, in the frame's space: grid axes, lengths in multiples of `L_min`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Vertex {
    /// Where it lies.
    pub position: [f32; 3],
    /// Unit vector, whose sign does not matter; 0 for what is not lit.
    pub normal: [f32; 3],
    /// Red, green, blue as display values; 255 where planes cut it, 0 where nothing does.
    pub color: [u8; 4],
}

impl Vertex {
    /// A corner of a surface, which planes cut.
    #[must_use]
    pub fn of_surface(position: Vec3, normal: Vec3, color: [f32; 3]) -> Self {
        let [red, green, blue] = bytes(color);
        Self { position: position.into(), normal: normal.into(), color: [red, green, blue, 255] }
    }

    /// A corner of something that nothing cuts.
    #[must_use]
    pub fn uncut(position: Vec3, normal: Vec3, color: [f32; 3]) -> Self {
        let [red, green, blue] = bytes(color);
        Self { position: position.into(), normal: normal.into(), color: [red, green, blue, 0] }
    }

    /// Whether planes cut it.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.color[3] != 0
    }
}

/// Vertices, and which three make each triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// All corners.
    pub vertices: Vec<Vertex>,
    /// Three indices of corners for each triangle.
    pub indices: Vec<[u32; 3]>,
}

impl Triangles {
    /// Most triangles of all surfaces together: half a gigabyte.
    pub const MOST: usize = 16 << 20;

    /// Adds others behind these.
    pub fn append(&mut self, mut others: Self) {
        let offset = self.vertices.len() as u32;
        self.vertices.append(&mut others.vertices);
        self.indices.extend(others.indices.into_iter().map(|triangle| triangle.map(|index| index + offset)));
    }

    /// Adds a convex outline that lies in one plane, or nearly.
    pub fn push_polygon(&mut self, corners: &[Vertex]) {
        let offset = self.vertices.len() as u32;
        self.vertices.extend_from_slice(corners);
        self.indices.extend((2..corners.len() as u32).map(|last| [offset, offset + last - 1, offset + last]));
    }
}

fn bytes(color: [f32; 3]) -> [u8; 3] {
    color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8)
}
