//! The readers of volume files, from outside: round trips, placement, broken files, and real volumes made by others.

mod broken;
mod no_panic;
mod placement;
mod real_data;
mod round_trip;
mod samples;
