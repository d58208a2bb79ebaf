//! Opens what the user named.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use voxrole_pack::prologue::MAGIC;
use voxrole_pack::quantization::NO_NORMAL;
use voxrole_pack::{DistanceQuantization, HitGradientQuantization, Precision, Reader, ScalarType};
use voxrole_preprocess::Grid;
use voxrole_preprocess::atomic_folder::ScratchFolder;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::io::{ReadOptions, open_volume, read_volume};
use voxrole_preprocess::prepare::prepare_file;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};

use crate::volume::{VolumeDescription, VolumeTexels};

/// A packed file to read from.
pub struct Opened {
    /// Its reader.
    pub reader: Arc<Reader>,
    /// The folder of a file that was prepared only for this; removed with it.
    _prepared: Option<ScratchFolder>,
}

impl From<Reader> for Opened {
    fn from(reader: Reader) -> Self {
        Arc::new(reader).into()
    }
}

impl From<Arc<Reader>> for Opened {
    fn from(reader: Arc<Reader>) -> Self {
        Self { reader, _prepared: None }
    }
}

/// Opens a packed file, whatever its name ends in. A volume that has not been prepared is prepared first, with default
/// settings and within so many bytes of memory, into a temporary file.
///
/// # Errors
/// When it cannot be read, is damaged, or is not a volume; the message names it.
pub fn open_or_prepare(path: &Path, options: &ReadOptions, memory: u64) -> anyhow::Result<Opened> {
    let named = || path.display().to_string();
    if is_packed(path)? {
        let typed = options.typed();
        ensure!(typed.is_empty(), "{}: what is packed is read as it is: leave {typed} out", named());
        return Ok(Reader::open(path).with_context(named)?.into());
    }
    let volume = open_volume(path, options)?;
    let folder = ScratchFolder::create().context("making a temporary folder")?;
    let packed = folder.path().join("prepared.vxr");
    let file = path.display();
    tell(format!("voxrole-view: preparing {file}; `voxrole prepare {file} -o OUT.vxr` keeps the result"));
    volume.notes().iter().for_each(|note| tell(format!("voxrole-view: {file}: {note}")));
    let report = prepare_file(volume, &Settings::new(Method::Auto), memory, &packed, &Silent).with_context(named)?;
    report.warning.iter().for_each(|warning| tell(format!("voxrole-view: {file}: {warning}")));
    Ok(Opened { reader: Arc::new(Reader::open(&packed).with_context(named)?), _prepared: Some(folder) })
}

fn is_packed(path: &Path) -> anyhow::Result<bool> {
    if path.is_dir() {
        return Ok(false);
    }
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start));
    read.with_context(|| path.display().to_string())?;
    Ok(start == MAGIC)
}

/// Reads a volume whose voxels have two numbers, intensity and opacity for a path of `L_min`: shares of the largest
/// integer of their type, or numbers from 0 to 1.
///
/// # Errors
/// When it cannot be read or its voxels do not have two such numbers; the message names it.
pub fn read_stored(path: &Path, options: &ReadOptions) -> anyhow::Result<VolumeTexels> {
    let named = || path.display().to_string();
    ensure!(
        options.component.is_none(),
        "{}: intensity and opacity are components 0 and 1: leave --component out",
        named()
    );
    ensure!(
        !is_packed(path)?,
        "{}: a packed volume has no stored opacities: draw the file of intensities and opacities itself",
        named()
    );
    let read = |component| read_volume(path, &ReadOptions { component: Some(component), ..options.clone() });
    let expected = "stored opacities need a volume of two numbers per voxel, intensity and opacity";
    let (intensity, opacity) = (read(0).context(expected)?, read(1).context(expected)?);
    ensure!(read(2).is_err(), "{}: expected two numbers per voxel, intensity and opacity, found more", named());
    let [intensities, opacities] = [&intensity, &opacity].map(|grid| shares(grid).with_context(named));
    let description = VolumeDescription::new(
        &intensity.geometry,
        intensity.geometry.smallest_spacing() as f32,
        [0.0, 1.0],
        HitGradientQuantization::new(0.0, 1.0, Precision::default()),
    );
    // Opacity in the place of the value, by which empty space is found, and intensity in that of the gradient magnitude.
    let texels = intensities?.into_iter().zip(opacities?);
    let texels =
        texels.map(|(intensity, opacity)| [opacity, DistanceQuantization::MASKED as u16, intensity, NO_NORMAL]);
    Ok(VolumeTexels { description, texels: texels.collect() })
}

/// Numbers as shares of 65535.
fn shares(grid: &Grid) -> anyhow::Result<Vec<u16>> {
    let full = match grid.scalars.scalar_type() {
        ScalarType::U8 => 255.0,
        ScalarType::U16 => 65535.0,
        ScalarType::F32 | ScalarType::F64 => 1.0,
        other => bail!("expected numbers of u8, u16, f32 or f64, found {other:?}"),
    };
    let share = |index| {
        let number = grid.physical(index) / full;
        ensure!((0.0..=1.0).contains(&number), "expected numbers from 0 to {full}, found {}", number * full);
        Ok((number * 65535.0).round() as u16)
    };
    (0..grid.scalars.len()).map(share).collect()
}
