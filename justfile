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

# A window whose device is lost; opens windows, as under `xvfb-run`.
test-window:
    VOXROLE_REQUIRE_WINDOW=1 cargo test -p voxrole-viewer --test lost_device

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

# The pictures of docs/rendering.md and README, into a folder.
pictures REAL_DATA OUT:
    cargo build --release --no-default-features --bins
    tests/pictures.sh target/release {{REAL_DATA}} {{OUT}}

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

# Every field in every export format, read back by other software, which is installed in a folder of its own.
peers-exports:
    python3 -m venv target/peers
    target/peers/bin/pip install --quiet numpy pynrrd SimpleITK nibabel tifffile vtk zarr ome-zarr ome-zarr-models
    cargo build --release -p voxrole-preprocess --bin voxrole
    target/peers/bin/python tests/peers/exports.py target/release/voxrole

# Pictures of volumes beside VTK's CPU ray caster (VTK from PyPI), by turns, with both pictures in a folder.
peers-vtk OUT +VOLUMES:
    python3 -m venv target/peers
    target/peers/bin/pip install --quiet vtk
    cargo build --release --no-default-features --bins
    target/peers/bin/python tests/peers/vtk_render.py target/release/voxrole-view target/release/voxrole {{OUT}} {{VOLUMES}}

# What is packed, read by a second reader that was written from crates/pack/SPEC.md alone (numpy, zstandard and pynrrd).
peers-second-reader:
    cargo build --release --bin voxrole
    python3 tests/peers/second_reader.py target/release/voxrole

# Sizes and speeds of codecs and of the stages before them, on packed files (numpy, zstandard and lz4).
peers-codecs +FILES:
    python3 tests/peers/codecs.py {{FILES}}

# Damaged files for each reader, for so many seconds each (a nightly compiler, and cargo-fuzz: `cargo install cargo-fuzz`).
fuzz SECONDS *TARGETS:
    tests/fuzz/run.sh {{SECONDS}} {{TARGETS}}

# Every change of a single byte of a packed file: `voxrole verify` must notice each of them; takes minutes.
single-byte-changes:
    cargo test --release -p voxrole-pack --test packed_file -- --ignored --nocapture every_value

# Whole runs at 128³ to 1024³: time and peak memory, with a plot, into a folder (matplotlib; 5 GiB of disk).
bench OUT:
    cargo build --release --no-default-features --bin voxrole
    python3 tests/scaling.py target/release/voxrole {{OUT}}

# Times of the kernels, each beside a copy of as many bytes.
bench-kernels:
    cargo bench --no-default-features -p voxrole-preprocess --bench kernels

# What a knob of the viewer costs before the next picture.
bench-tables:
    cargo bench --no-default-features -p voxrole-viewer --bench tables

# Whole runs, derivatives and the bilateral filter beside teem and ITK, as ratios; installs both into a folder of its own.
bench-peers:
    command -v teem-vprobe || apt-get install -y teem-apps
    python3 -m venv target/peers
    target/peers/bin/pip install --quiet SimpleITK numpy pynrrd
    cargo build --release --no-default-features --bin voxrole
    target/peers/bin/python tests/peers/speed.py target/release/voxrole
    target/peers/bin/python tests/peers/bilateral.py target/release/voxrole

# Kills a run at 20 random moments and goes on with it each time; the file must be that of an undisturbed run.
kill-and-resume:
    cargo build --release --no-default-features --bin voxrole
    target/release/voxrole phantom three-balls --dims 512,512,512 --dtype u16 -o target/three-balls-512.nrrd
    python3 tests/kill_and_resume.py target/release/voxrole target/three-balls-512.nrrd --method fast --smooth none
