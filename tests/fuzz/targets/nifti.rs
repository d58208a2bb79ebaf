#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| voxrole_fuzz::read("a.nii", bytes));
