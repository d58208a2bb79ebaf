//! The main job from end to end: a volume becomes a packed file, a report, histograms, slices and a picture.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use voxrole_pack::{HistogramKind, Reader};
use voxrole_preprocess::console::{print, tell};
use voxrole_preprocess::fields::Field;
use voxrole_preprocess::io::open_volume;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::plot::{HistogramLabels, SliceAxis, field_slice_png, histogram_png};
use voxrole_preprocess::progress::Progress;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_preprocess::usage::refuse_if;
use voxrole_preprocess::{Grid, prepare};

use crate::args::DemoArgs;
use crate::headless::{self, write};

/// Edge of the demo's own phantom, in voxels.
const PHANTOM_EDGE: u32 = 128;

/// Runs the main job on a file, or on a phantom where none is named, and says what it leaves where.
///
/// # Errors
/// When the input cannot be read or the output folder cannot be written to.
pub fn run(arguments: &DemoArgs) -> anyhow::Result<()> {
    let folder = &arguments.output;
    let typed = arguments.raw.read_options().typed();
    let is_phantom = arguments.input.is_none();
    refuse_if(is_phantom && !typed.is_empty(), format!("the demo's own phantom is not read: leave {typed} out"))?;
    ensure!(!folder.is_file(), "{}: is a file, and -o names a folder", folder.display());
    let grid = match &arguments.input {
        Some(path) => {
            let volume = open_volume(path, &arguments.raw.read_options())?;
            volume.notes().iter().for_each(|note| tell(format!("voxrole-view: {note}")));
            volume.load()?
        }
        None => phantom()?,
    };
    fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
    let [x, y, z] = grid.geometry.dims;
    print(&format!("{}: {x}x{y}x{z} voxels of {}\n", grid.name, grid.scalars.scalar_type().name()))?;

    let packed = folder.join("roles.vxr");
    let settings = Settings { keep_derivatives: true, ..Settings::new(Method::Auto) };
    let report = prepare(&grid, &settings, &packed, &Lines)?;
    let counts = &report.counts;
    let share = 100.0 * counts.hits as f64 / counts.voxels as f64;
    print(&format!("prepared in {:.1} s: {share:.1} % of the voxels have a boundary\n", report.seconds))?;
    report.warning.iter().for_each(|warning| tell(format!("voxrole-view: {warning}")));
    write(&folder.join("report.json"), &serde_json::to_vec_pretty(&report)?)?;
    drop(grid);

    let reader = Reader::open(&packed)?;
    reader.verify()?;
    histograms(&reader, folder)?;
    slices(&reader, folder)?;
    let picture = folder.join("picture.png");
    headless::first_picture(&reader, &picture)?;

    print(&format!("\nin {}:\n", folder.display()))?;
    for (file, what) in [
        ("roles.vxr", "the packed file; look at it with `voxrole-view`, `voxrole info`, `voxrole export`"),
        ("report.json", "seconds and counts"),
        ("histogram-hit-hit.png", "every boundary is a blob here; and four more histograms"),
        ("slice-distance.png", "distance to the boundary, white on it; and three more slices"),
        ("picture.png", "the boundaries, drawn without setting anything"),
    ] {
        print(&format!("  {file:<22} {what}\n"))?;
    }
    Ok(())
}

fn phantom() -> anyhow::Result<Grid> {
    let settings = PhantomSettings { dims: [PHANTOM_EDGE; 3], noise: 0.005, ..PhantomSettings::default() };
    Ok(Phantom::ThreeBalls.generate(&settings)?)
}

fn histograms(reader: &Reader, folder: &Path) -> anyhow::Result<()> {
    let header = reader.header();
    let labels = HistogramLabels { source: &header.source.name, length_unit: &header.geometry.unit };
    for kind in HistogramKind::ALL {
        let picture = histogram_png(&reader.read_histogram(kind)?, &labels)?;
        write(&folder.join(format!("histogram-{}.png", kind.name())), &picture)?;
    }
    Ok(())
}

fn slices(reader: &Reader, folder: &Path) -> anyhow::Result<()> {
    let middle = reader.header().geometry.dims[2] / 2;
    for field in [Field::Value, Field::Distance, Field::SecondDerivative, Field::HitGradient] {
        let picture = field_slice_png(reader, field, SliceAxis::Z, middle)?;
        write(&folder.join(format!("slice-{}.png", field.name())), &picture)?;
    }
    Ok(())
}

/// A line per stage.
struct Lines;

impl Progress for Lines {
    fn begin(&self, stage: &'static str, _: u64) {
        // That nobody reads it ends no work.
        let _ = print(&format!("  {stage} …\n"));
    }
    fn step(&self) {}
}
