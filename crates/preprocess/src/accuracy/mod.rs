//! How accurate the methods are, and how fast: phantoms × methods, measured against exact truth.
//!
//! A [`Case`] is a phantom with a blur, a noise and a type of number; a [`Method`] is a named set of settings. [`measure()`]
//! computes the roles of one case by every method and compares them with the [`Truth`].

mod bench;
mod case;
mod figures;
mod method;
mod pareto;
mod plots;
mod suite;
mod table;
mod truth;

pub use bench::{Row, measure};
pub(crate) use bench::{chosen, own, roles_of, timed};
pub use case::{Case, Dtype};
pub use figures::{Figures, Found};
pub use method::{Method, methods};
pub use pareto::{members, pareto_front};
pub use plots::{Drawing, drawings};
pub use suite::{Extent, suite};
pub use table::{csv, text_table};
pub use truth::{Expected, Truth};
