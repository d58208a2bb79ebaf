//! The packed file that a window shows, apart from its voxels.

use std::path::{Path, PathBuf};

use voxrole_pack::{Header, Histogram, HistogramKind, Reader};

use crate::classify::propose_regions;
use crate::state::Region;
use crate::volume::VolumeDescription;

/// What the panels say and draw of a file.
#[derive(Clone, Debug)]
pub struct OpenedVolume {
    /// Where the file lies.
    pub path: PathBuf,
    /// What it says of itself.
    pub header: Header,
    /// What its texels mean.
    pub description: VolumeDescription,
    /// The voxels' own values against gradient magnitude at their hits.
    pub value_hit: Histogram,
    /// Values at the hits against gradient magnitude at the hits.
    pub hit_hit: Histogram,
    /// Signed distances.
    pub distance: Histogram,
    /// The regions of the first picture.
    pub proposed_regions: Vec<Region>,
}

impl OpenedVolume {
    /// Reads the histograms.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when a histogram is missing or damaged.
    pub fn read(path: &Path, reader: &Reader, description: &VolumeDescription) -> crate::Result<Self> {
        let hit_hit = reader.read_histogram(HistogramKind::HitValueHitGradient)?;
        Ok(Self {
            path: path.to_owned(),
            header: reader.header().clone(),
            description: description.clone(),
            value_hit: reader.read_histogram(HistogramKind::ValueHitGradient)?,
            proposed_regions: propose_regions(&hit_hit, description.smallest_spacing()),
            hit_hit,
            distance: reader.read_histogram(HistogramKind::Distance)?,
        })
    }

    /// The unit of gradient magnitudes in words, such as `per mm`; values have no unit that a file would name.
    #[must_use]
    pub fn gradient_unit(&self) -> String {
        let unit = &self.description.unit;
        if unit.is_empty() { "per unit length".to_owned() } else { format!("per {unit}") }
    }
}
