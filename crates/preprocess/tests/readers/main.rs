//! The readers of volume files, from outside: round trips, placement, broken files, and real volumes made by others.

mod bare_numbers;
mod broken;
mod choices;
mod command_line;
mod dicom;
mod dicom_samples;
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
