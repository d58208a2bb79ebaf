//! What the fuzz targets do with damaged bytes: everything that a program does with a file, within a stated memory.

use std::cell::LazyCell;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use voxrole_pack::directory::Table;
use voxrole_pack::unfinished::{Claim, Unfinished, path_of};
use voxrole_pack::{LayerKind, Limits, Reader, with_scalar_type};
use voxrole_preprocess::io::{ReadOptions, open_volume};

/// Volumes of more voxels are opened but not read: memory in proportion to what a header asks for is no fault.
const MOST_VOXELS: usize = 1 << 18;

/// What the headers among the seeds point to.
const DATA_FILES: [&str; 5] = ["data.bin", "a.raw", "a.zraw", "a.img", "a.bin"];

/// A folder in memory, if the system has one.
fn folder() -> TempDir {
    let memory = Path::new("/dev/shm");
    let made = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    made.expect("a folder for the fuzzer's files")
}

fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).expect("a file for the fuzzer");
}

/// Reads a volume, and again with the options that choose among several numbers.
fn open(path: &Path) {
    let plain = ReadOptions::default();
    for options in [&plain, &ReadOptions { component: Some(1), time: Some(1), ..plain.clone() }] {
        let Ok(volume) = open_volume(path, options) else { continue };
        let voxels = volume.dims().iter().try_fold(1_usize, |product, &dim| product.checked_mul(dim));
        if voxels.is_some_and(|voxels| voxels <= MOST_VOXELS) {
            let _ = volume.load();
        }
    }
}

/// Reads a volume file of a name that the target's format has, beside the data files that headers may name.
pub fn read(name: &str, bytes: &[u8]) {
    thread_local!(static FOLDER: LazyCell<TempDir> = LazyCell::new(|| {
        let folder = folder();
        let numbers: Vec<u8> = (0..240).collect();
        DATA_FILES.iter().for_each(|name| write(&folder.path().join(name), &numbers));
        folder
    }));
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        write(&path, bytes);
        open(&path);
    });
}

/// Replaces one file of a Zarr store, which the first byte chooses, and reads the store.
pub fn read_zarr(bytes: &[u8]) {
    thread_local!(static STORES: LazyCell<(TempDir, Vec<[PathBuf; 2]>)> = LazyCell::new(|| {
        let folder = folder();
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/preprocess/tests/readers/data/zarr"), folder.path());
        let mut files = Vec::new();
        for store in sorted(folder.path()) {
            list(&store, &mut |file| files.push([store.clone(), file]));
        }
        (folder, files)
    }));
    let Some((&first, bytes)) = bytes.split_first() else { return };
    STORES.with(|stores| {
        let (_, files) = &**stores;
        let [store, file] = &files[usize::from(first) % files.len()];
        let good = fs::read(file).expect("copied");
        write(file, bytes);
        open(store);
        write(file, &good);
    });
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// Visits the files in a folder and below.
fn list(folder: &Path, visit: &mut impl FnMut(PathBuf)) {
    for path in sorted(folder) {
        if path.is_dir() { list(&path, visit) } else { visit(path) }
    }
}

fn copy(from: &Path, to: &Path) {
    list(from, &mut |file| {
        let target = to.join(file.strip_prefix(from).expect("below it"));
        fs::create_dir_all(target.parent().expect("a folder")).expect("made");
        fs::copy(&file, &target).expect("copied");
    });
}

/// Opens, verifies and reads a packed file.
pub fn read_packed(bytes: &[u8]) {
    thread_local!(static FOLDER: LazyCell<TempDir> = LazyCell::new(folder));
    let limits = Limits { max_voxels: MOST_VOXELS as u64, max_layer_bytes: 1 << 22, max_histogram_bins: 1 << 18 };
    let path = FOLDER.with(|folder| folder.path().join("a.vxr"));
    write(&path, bytes);
    let Ok(reader) = Reader::open_with(&path, &limits) else { return };
    let _ = reader.verify();
    for level in 0..reader.levels() {
        let _ = reader.geometry(level);
        let _ = reader.read_value_level(level);
        let _ = reader.read_distance(level);
        let _ = reader.read_hit_gradient(level);
        for layer in &reader.header().layers {
            let _ = with_scalar_type!(layer.scalar_type, T => reader.read_level::<T>(layer.kind, level).map(drop));
        }
    }
    let _ = reader.brick_entry(LayerKind::Value, 0, 0);
    let _ = reader.directory().order().tables().map(|table| table == Table::Mask).collect::<Vec<_>>();
    for histogram in &reader.header().histograms {
        let _ = reader.read_histogram(histogram.kind);
    }
    let _ = (reader.distance_quantization(), reader.hit_gradient_quantization());
}

/// Goes on with an interrupted run.
pub fn resume(bytes: &[u8]) {
    thread_local!(static FOLDER: LazyCell<TempDir> = LazyCell::new(folder));
    let output = FOLDER.with(|folder| folder.path().join("a.vxr"));
    write(&path_of(&output), bytes);
    let Ok(mut claim) = Claim::new(&output) else { return };
    let Some(head) = claim.head() else { return };
    let Ok(unfinished) = Unfinished::resume(claim, &head) else { return };
    for block in (0..64).filter(|&block| unfinished.has(block)) {
        let _ = unfinished.numbers(block);
        for (layer, brick) in (0..4).flat_map(|layer| (0..4).map(move |brick| (layer, brick))) {
            let _ = unfinished.brick(block, layer, brick);
        }
    }
    unfinished.finish();
}
