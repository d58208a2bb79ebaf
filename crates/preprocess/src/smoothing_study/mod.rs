//! How much smoothing improves the edge detector, and what it costs: placements of a filter × noise × phantoms.
//!
//! The paper's open question is how much a bilateral filter improves the edge detector over a Gaussian. A [`Study`] measures
//! the [`placements()`] on one scene under growing noise, by the figures of [`crate::accuracy`] and by the share of thin
//! layers' faces that is kept ([`faces_kept`]). Canny's detector, measured by others, can be drawn beside them
//! ([`CannyRow`]).

mod canny;
mod faces;
mod placement;
mod plots;
mod study;
mod suite;
mod table;

pub use canny::{CannyRow, parse_canny};
pub use faces::faces_kept;
pub use placement::{KERNELS, PLACEMENTS, placements};
pub use plots::study_drawings;
pub use study::{Study, StudyRow};
pub use suite::{Group, Scene, scenes};
pub use table::{study_csv, study_table};
