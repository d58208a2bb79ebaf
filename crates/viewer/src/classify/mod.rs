//! The rules of classification: which opacity and colour a voxel's role gives. No GPU here; the shaders follow these.

pub mod blobs;
pub mod boundary_emphasis;
mod box_blur;
pub mod emphasis_table;
pub mod lookup_tables;
pub mod macrocells;
pub mod occlusion;
pub mod opacity;
pub mod opacity_correction;
mod packed_macrocells;
pub mod preintegration;
pub mod region_proposal;
pub mod value_table;

pub use boundary_emphasis::opacity_by_distance;
pub use emphasis_table::EmphasisTable;
pub use lookup_tables::LookupTables;
pub use macrocells::{MacrocellRanges, Occupancy};
pub use occlusion::{Drawn, MacrocellSamples, Occlusion};
pub use opacity::OpacityTable;
pub use opacity_correction::correct_opacity;
pub use preintegration::{PreintegrationCells, PreintegrationTable};
pub use region_proposal::propose_regions;
pub use value_table::ValueTable;
