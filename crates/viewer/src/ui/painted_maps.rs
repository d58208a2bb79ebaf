//! Painted regions as they lie over the histogram.

use egui::{Color32, ColorImage, Painter, Rect, TextureHandle, TextureOptions, pos2};

use crate::state::{PaintedMap, Region, Shape};

/// The textures of maps that are shown.
#[derive(Default)]
pub struct PaintedMaps {
    textures: Vec<(PaintedMap, TextureHandle)>,
}

impl PaintedMaps {
    /// Shows a map in a rectangle, in a colour where its weight is largest.
    pub fn paint(&mut self, painter: &Painter, map: &PaintedMap, rect: Rect, color: Color32) {
        let index = self.textures.iter().position(|(known, _)| known == map).unwrap_or_else(|| {
            // Between the middles of cells as the regions' table has it.
            let texture = painter.ctx().load_texture("painted region", image(map), TextureOptions::LINEAR);
            self.textures.push((map.clone(), texture));
            self.textures.len() - 1
        });
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        painter.image(self.textures[index].1.id(), rect, whole, color);
    }

    /// Forgets maps that no region has any more.
    pub fn retain(&mut self, regions: &[Region]) {
        let is_shown = |map: &PaintedMap| {
            regions.iter().any(|region| matches!(&region.shape, Shape::Painted(painted) if painted == map))
        };
        self.textures.retain(|(map, _)| is_shown(map));
    }
}

/// White, as opaque as the weights are; the largest gradient magnitude in the first row.
fn image(map: &PaintedMap) -> ColorImage {
    let size = map.size();
    let rows = map.weights().chunks_exact(size[0]).rev();
    ColorImage::new(size, rows.flatten().map(|&weight| Color32::from_white_alpha(weight)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_gradient_magnitude_is_on_top() {
        let mut map = PaintedMap::blank();
        map.stroke([0.0, 1.0], [0.0, 1.0], [0.1, 0.1], false);
        let image = image(&map);
        assert_eq!(image.pixels[0], Color32::WHITE);
        assert_eq!(image.pixels.last(), Some(&Color32::TRANSPARENT));
    }
}
