//! `voxrole bench pack`: how small a packed file is, and how fast it opens and unpacks.

use std::fmt::Write;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::Args;
use rayon::ThreadPoolBuilder;
use voxrole_pack::directory::Table;
use voxrole_pack::{LayerKind, Reader, with_scalar_type};

use super::info::stored_bytes;

/// `bench pack`.
#[derive(Debug, Args)]
pub struct PackArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
    /// How often each is measured; the fastest counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
}

/// One layer on one thread.
struct Unpacking {
    raw_bytes: u64,
    seconds: f64,
    copy_seconds: f64,
}

pub fn run(args: &PackArgs) -> anyhow::Result<()> {
    let named = || args.file.display().to_string();
    let opening = fastest(args.repeats, || first_brick(&args.file)).with_context(named)?;
    let reader = super::open(&args.file)?;
    let pool = ThreadPoolBuilder::new().num_threads(1).build().context("starting a thread")?;
    let voxels = reader.header().geometry.voxel_count() as f64;
    let mut text = format!("to the first brick: {:.2} ms\n", 1e3 * opening);
    writeln!(text, "layer               stored B/voxel   raw B/voxel   unpacked GB/s   copied GB/s   ratio")?;
    let mut total = Unpacking { raw_bytes: 0, seconds: 0.0, copy_seconds: 0.0 };
    for (index, layer) in reader.header().layers.iter().enumerate() {
        let unpacking = pool.install(|| unpacking(&reader, layer.kind, args.repeats)).with_context(named)?;
        let stored = stored_bytes(&reader, Table::Layer(index))? as f64 / voxels;
        line(&mut text, layer.kind.name(), stored, &unpacking, voxels)?;
        total.raw_bytes += unpacking.raw_bytes;
        total.seconds += unpacking.seconds;
        total.copy_seconds += unpacking.copy_seconds;
    }
    line(&mut text, "whole file", reader.file_bytes() as f64 / voxels, &total, voxels)?;
    super::print(&text)
}

fn line(text: &mut String, name: &str, stored: f64, unpacking: &Unpacking, voxels: f64) -> std::fmt::Result {
    let Unpacking { raw_bytes, seconds, copy_seconds } = *unpacking;
    let (raw, rate, copy_rate) =
        (raw_bytes as f64, raw_bytes as f64 / seconds / 1e9, raw_bytes as f64 / copy_seconds / 1e9);
    let ratio = copy_seconds / seconds;
    writeln!(text, "{name:<20}{stored:14.3}{:14.2}{rate:16.2}{copy_rate:14.2}{ratio:8.2}", raw / voxels)
}

/// Opens the file and unpacks one brick of its values.
fn first_brick(path: &Path) -> anyhow::Result<()> {
    let reader = Reader::open(path)?;
    let (_, layer) = reader.header().layer(LayerKind::Value)?;
    with_scalar_type!(layer.scalar_type, T => {
        black_box(reader.read_brick::<T>(LayerKind::Value, 0, 0)?);
    });
    Ok(())
}

/// Unpacks all bricks of a layer's finest level, one after another, and copies as many bytes from memory to memory.
fn unpacking(reader: &Reader, kind: LayerKind, repeats: u16) -> anyhow::Result<Unpacking> {
    let (_, layer) = reader.header().layer(kind)?;
    let grid = reader.grid(0)?;
    let raw_bytes = reader.header().geometry.voxel_count() * layer.scalar_type.size_in_bytes();
    let seconds = with_scalar_type!(layer.scalar_type, T => fastest(repeats, || {
        (0..grid.len()).try_for_each(|brick| {
            black_box(reader.read_brick::<T>(kind, 0, brick)?);
            Ok(())
        })
    }))?;
    let (from, mut to) = (vec![1_u8; raw_bytes], vec![0_u8; raw_bytes]);
    let copy_seconds = fastest(repeats, || {
        to.copy_from_slice(black_box(&from));
        black_box(&to);
        Ok(())
    })?;
    Ok(Unpacking { raw_bytes: raw_bytes as u64, seconds, copy_seconds })
}

fn fastest(repeats: u16, mut task: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<f64> {
    let mut best = f64::INFINITY;
    for _ in 0..repeats {
        let start = Instant::now();
        task()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
}
