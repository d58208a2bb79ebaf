//! The readers of volume files, from outside: round trips, placement, broken files, and real volumes made by others.

mod broken;
mod no_panic;
mod peers;
mod placement;
mod real_data;
mod round_trip;
mod samples;
#[cfg(feature = "tiff")]
mod tiff;
mod vti;
#[cfg(feature = "zarr")]
mod zarr;
