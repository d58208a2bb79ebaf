# What continuous integration runs.
check: format lint test docs deny

# Formatting.
format:
    cargo fmt --all --check

# Lints.
lint:
    cargo clippy --workspace --all-targets -- -D warnings

# All tests.
test:
    cargo test --workspace

# Documentation without warnings.
docs:
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --document-private-items

# Licences, sources and bans of dependencies; the advisories need the internet: `just advisories`.
deny:
    cargo deny --offline check bans licenses sources

# Known vulnerabilities of dependencies.
advisories:
    cargo deny check advisories

# The main job on a phantom, into the folder `out`.
demo:
    cargo run --release --no-default-features --bin voxrole-view -- demo

# Gradient magnitude and second derivative against teem's vprobe (Debian package teem-apps; numpy and pynrrd).
peers-teem REAL_DATA:
    cargo build --release --bin voxrole
    python3 tests/peers/teem_derivatives.py target/release/voxrole {{REAL_DATA}}

# Prepares, inspects and renders the real volumes into a folder; prints the table of docs/benchmarks.md.
real-data REAL_DATA OUT:
    cargo build --release --bins
    tests/real_data.sh target/release {{REAL_DATA}} {{OUT}}

# What phantoms' samples give at best, by Fourier interpolation (numpy and pynrrd).
peers-spectral:
    cargo build --release --bin voxrole
    python3 tests/peers/spectral_reference.py target/release/voxrole

# ITK's Canny (SimpleITK from PyPI; numpy and pynrrd) on the phantoms of the smoothing study, then the study beside it, into
# a folder.
peers-canny OUT:
    cargo build --release --bin voxrole
    mkdir -p {{OUT}}
    python3 tests/peers/canny.py target/release/voxrole {{OUT}}/canny.csv
    target/release/voxrole bench smoothing -o {{OUT}} --canny {{OUT}}/canny.csv

# The bilateral filter against ITK's (SimpleITK from PyPI; numpy and pynrrd) and brute force: times, ratios and deviations.
peers-bilateral:
    cargo build --release --bin voxrole
    python3 tests/peers/bilateral.py target/release/voxrole
