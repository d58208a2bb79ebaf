//! The whole run: from a volume to a packed file.

use std::path::Path;

use sha2::{Digest, Sha256};
use voxrole_pack::ScalarType;
use voxrole_pack::unfinished::{Claim, Head, Unfinished};

use crate::automatic::Choice;
use crate::block_plan::{BlockPlan, Cost, MOST_AT_ONCE};
use crate::io::VolumeFile;
use crate::packing::{MADE_BY, Packing};
use crate::progress::Progress;
use crate::recipe::{Block, Recipe, Spare};
use crate::region::Region;
use crate::report::{Counts, FieldSigma, Report, Stopwatch};
use crate::roles::Roles;
use crate::scan::Scan;
use crate::settings::{Automatic, Settings};
use crate::source::Source;
use crate::summary::Summary;
use crate::working_field::{Scaling, WorkingField};
use crate::{Error, Grid, Result, reach};

/// Computes the voxel roles of `grid` and writes them to `path`, which appears only when complete.
///
/// Runs on the current rayon thread pool. The file's bytes depend on the grid and the settings alone, not on the number
/// of threads nor on [`Settings::skip`].
///
/// # Errors
/// As [`prepare_source`].
///
/// ```
/// use voxrole_pack::{GridGeometry, Scalars};
/// use voxrole_preprocess::settings::{Method, Settings};
/// use voxrole_preprocess::{Grid, prepare, progress::Silent};
///
/// let geometry = GridGeometry::axis_aligned([8, 8, 8], [1.0; 3]);
/// let values = (0..512).map(|voxel| if voxel % 8 < 4 { 10 } else { 200 }).collect();
/// let grid = Grid::new("step", geometry, Scalars::U8(values))?;
/// let folder = std::env::temp_dir().join(format!("voxrole-doc-{}", std::process::id()));
/// std::fs::create_dir_all(&folder)?;
/// let report = prepare(&grid, &Settings::new(Method::Fast), &folder.join("step.vxr"), &Silent)?;
/// assert_eq!(report.counts.hits, 128); // the two voxels on either side of the step have a gradient
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn prepare(grid: &Grid, settings: &Settings, path: &Path, progress: &dyn Progress) -> Result<Report> {
    prepare_source(Source::from(grid), settings, u64::MAX, path, progress)
}

/// As [`prepare_source`] for a volume file, which is read as a whole only where it fits into `memory` bytes together with
/// everything else.
///
/// # Errors
/// As [`prepare_source`] and [`VolumeFile::load`].
pub fn prepare_file(
    file: VolumeFile,
    settings: &Settings,
    memory: u64,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Report> {
    let mut watch = Stopwatch::new();
    progress.begin("reading", 1);
    let voxels: usize = file.dims().iter().product();
    let number = file.scalar_type().size_in_bytes() as u64;
    let fits = fits_at_once(voxels, file.scalar_type(), settings, memory.saturating_sub(voxels as u64 * number));
    let (grid, stored);
    let source = if fits {
        grid = file.load()?;
        Source::from(&grid)
    } else {
        stored =
            file.stored(path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
        Source::from(&stored)
    };
    progress.step();
    watch.lap("reading");
    run(source, settings, memory, path, progress, watch)
}

/// Whether a volume is one block that fits into memory.
fn fits_at_once(voxels: usize, scalar_type: ScalarType, settings: &Settings, memory: u64) -> bool {
    voxels <= MOST_AT_ONCE && Cost::new(settings, scalar_type, true).bytes(voxels, voxels) <= memory
}

/// As [`prepare`] for a volume in memory or in a file, in blocks where the volume is large or does not fit into `memory`
/// bytes.
///
/// Finished blocks are kept in a file beside `path`, with `.unfinished` behind its name, until the run is done; a run that
/// was stopped goes on from there when it is started again. The file's bytes do not depend on blocks either.
///
/// # Errors
/// [`Error::Parameter`] for settings or a volume that cannot be used, too little memory, or an output that another run is
/// writing; [`Error::Io`] when reading fails; [`Error::Pack`] when memory runs out or writing fails.
pub fn prepare_source(
    source: Source<'_>,
    settings: &Settings,
    memory: u64,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Report> {
    run(source, settings, memory, path, progress, Stopwatch::new())
}

fn run(
    source: Source<'_>,
    settings: &Settings,
    memory: u64,
    path: &Path,
    progress: &dyn Progress,
    mut watch: Stopwatch,
) -> Result<Report> {
    settings.validate()?;
    let mut claim = Claim::new(path)?;
    let dims = source.dims();
    let voxels: usize = dims.iter().product();
    let memory = memory.saturating_sub(source.resident_bytes());
    // What is kept is gone on with, or is another run's and not to be lost.
    let kept = claim.head();
    let at_once = kept.is_none() && fits_at_once(voxels, source.scalar_type(), settings, memory);
    if !at_once {
        // Refused before hours of reading, as far as it is known by now what a block takes.
        let least = settings.cheapest();
        let reach = reach::reach(&least, Scaling::new(&source, [0.0, 1.0]).spacing(), false);
        let cost = Cost::new(&least, source.scalar_type(), false);
        BlockPlan::new(dims, reach, cost, memory).map_err(|least| too_little(memory, "at least ", least))?;
    }
    progress.begin("looking at the volume", 1);
    let known = source.identity().zip(kept.as_ref()).filter(|(input, kept)| kept.input == *input);
    let Findings { scan, noise } = match known.and_then(|(_, kept)| Findings::new(&kept.findings, dims)) {
        Some(findings) => findings,
        None => Findings { scan: Scan::new(&source, !at_once)?, noise: None },
    };
    watch.lap("first look");
    let mut recipe = Recipe::new(source, scan, noise, settings, at_once, &mut watch)?;
    progress.step();
    let outcome = if at_once {
        progress.begin("roles", dims[2] as u64);
        let block = recipe.prepare(Region::whole(dims), progress, &mut watch)?;
        progress.begin("packing", 1);
        let (file_bytes, summary) = Packing(&recipe).write(block, path)?;
        claim.release();
        Outcome { file_bytes, summary, blocks: 1, blocks_before: 0 }
    } else {
        in_blocks(&mut recipe, claim, kept, memory, path, progress, &mut watch)?
    };
    progress.step();
    watch.lap("packing");
    let [low, high] = recipe.scan.range.map(|end| recipe.scaling.working(end));
    Ok(Report {
        input: source.name.to_owned(),
        dims: source.geometry.dims,
        blocks: outcome.blocks,
        blocks_before: outcome.blocks_before,
        threads: rayon::current_num_threads(),
        seconds: watch.total(),
        stages: watch.into_stages(),
        noise_share: f64::from(recipe.noise / (high - low).abs().max(f32::MIN_POSITIVE)),
        noise_by_value: recipe.noisy_values.clone(),
        range_sigma: recipe.range_sigmas.shares.clone(),
        warning: recipe
            .under_sampling(outcome.summary.edges.as_ref())
            .or_else(|| nothing_found(&outcome.summary.counts, low != high, settings.noise_floor > 0.0))
            .or_else(|| recipe.noise_left(&outcome.summary.counts)),
        choice: recipe.choice,
        counts: outcome.summary.counts,
        file_bytes: outcome.file_bytes,
    })
}

/// A warning where a volume that is not the same everywhere has no boundary at all.
fn nothing_found(counts: &Counts, varies: bool, has_noise_floor: bool) -> Option<String> {
    let why = if has_noise_floor {
        "the volume's own steps may have been taken for noise, as those of a mask of 0 and 1 are: give --noise-floor 0"
    } else {
        "nowhere within --dmax does a gradient have its largest magnitude"
    };
    (counts.hits == 0 && varies && counts.masked < counts.voxels).then(|| format!("no voxel has a boundary: {why}"))
}

/// What is found out by reading the whole volume, and kept for the next run if this one is stopped.
struct Findings {
    scan: Scan,
    noise: Option<f32>,
}

impl Findings {
    fn new(numbers: &[u64], dims: [usize; 3]) -> Option<Self> {
        let (noise, scan) = numbers.split_first()?;
        let scan = Scan::from_numbers(scan, dims).filter(|scan| scan.voxels_sha256.is_some())?;
        Some(Self { scan, noise: Some(f32::from_bits(*noise as u32)) })
    }

    fn to_numbers(&self) -> Vec<u64> {
        let noise = u64::from(self.noise.unwrap_or_default().to_bits());
        std::iter::once(noise).chain(self.scan.to_numbers()).collect()
    }
}

/// What came of a run.
struct Outcome {
    file_bytes: u64,
    summary: Summary,
    blocks: usize,
    blocks_before: usize,
}

/// Prepares one block after another, those that an earlier run finished left out, and puts the file together.
fn in_blocks(
    recipe: &mut Recipe<'_>,
    claim: Claim,
    kept: Option<Head>,
    memory: u64,
    path: &Path,
    progress: &dyn Progress,
    watch: &mut Stopwatch,
) -> Result<Outcome> {
    let voxels_sha256 = recipe.scan.voxels_sha256.expect("blocks are only made with the hash");
    let (dims, reach) = (recipe.source.dims(), recipe.reach());
    // Nothing is left to the data any more.
    let settings = Settings { automatic: Automatic::default(), ..recipe.settings };
    let cost = Cost::new(&settings, recipe.source.scalar_type(), recipe.scan.has_bad);
    let task = task(recipe, voxels_sha256);
    // Half of the machine's memory is not the same after every start of the machine: an earlier run's blocks will do.
    let again = kept.filter(|kept| kept.task == task);
    let plan = match again.and_then(|kept| BlockPlan::again(kept.block, dims, reach, cost, memory)) {
        Some(plan) => plan,
        None => BlockPlan::new(dims, reach, cost, memory).map_err(|least| too_little(memory, "", least))?,
    };
    let findings = Findings { scan: recipe.scan.clone(), noise: Some(recipe.noise) }.to_numbers();
    let input = recipe.source.identity().unwrap_or_default();
    let mut unfinished = Unfinished::resume(claim, &Head { task, input, block: plan.block(), findings })?;
    let blocks_before = unfinished.len();
    if blocks_before > 0 {
        let total = plan.len();
        progress
            .note(&format!("{blocks_before} of {total} blocks were finished by an earlier run; going on from there"));
    }
    let slices = |block: usize| plan.region(block).dims()[2] as u64;
    progress.begin("roles", (0..plan.len()).map(slices).sum());
    recipe.make_room((0..plan.len()).map(|index| plan.region(index)))?;
    for index in 0..plan.len() {
        if unfinished.has(index) {
            (0..slices(index)).for_each(|_| progress.step());
            continue;
        }
        let block = recipe.prepare(plan.region(index), progress, watch)?;
        let (layers, summary, spare) = Packing(recipe).pack(block)?;
        recipe.reuse(spare);
        unfinished.append(index, &layers, &summary.to_numbers())?;
        watch.lap("packing");
    }
    // What is put together needs memory, too.
    recipe.reuse(Spare::default());
    progress.begin("putting the file together", 1);
    let packing = Packing(recipe);
    let axes = packing.axes();
    let mut total: Option<Summary> = None;
    for index in 0..plan.len() {
        let numbers = unfinished.numbers(index)?;
        let summary = Summary::from_numbers(&numbers, &axes, dims).ok_or_else(|| {
            Error::Parameter(format!("{}: an unfinished block is not what it should be; delete it", path.display()))
        })?;
        total = Some(match total {
            Some(total) => total.plus(summary),
            None => summary,
        });
    }
    let summary = total.ok_or_else(|| Error::Parameter("a volume without voxels".into()))?;
    let file_bytes = packing.assemble(&unfinished, &plan, &summary, voxels_sha256, path)?;
    unfinished.finish();
    Ok(Outcome { file_bytes, summary, blocks: plan.len(), blocks_before })
}

fn too_little(memory: u64, at: &str, least: u64) -> Error {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    Error::Parameter(format!(
        "--memory {:.1} MiB: the smallest block takes {at}{} MiB with these settings; give more than that, or prepare it with a shorter --dmax",
        mib(memory),
        mib(least).ceil()
    ))
}

/// A fingerprint of all that finished blocks depend on, but for how the volume is cut into them.
fn task(recipe: &Recipe<'_>, voxels_sha256: [u8; 32]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    hasher.update(MADE_BY);
    hasher.update(voxels_sha256);
    hasher.update(format!("{:?} {:?}", recipe.source.geometry, recipe.settings));
    hasher.update([recipe.source.slope, recipe.source.intercept].map(f64::to_le_bytes).concat());
    hasher.update(recipe.noise.to_le_bytes());
    for parameter in Packing(recipe).parameters() {
        hasher.update(format!("{}={}\n", parameter.name, parameter.value));
    }
    hasher.finalize().into()
}

/// The roles of a volume, not yet packed.
pub struct Prepared {
    /// The settings, with what was chosen by the data.
    pub settings: Settings,
    /// What was found in the data and chosen by it.
    pub choice: Option<Choice>,
    /// σr of the bilaterally filtered fields.
    pub range_sigma: Vec<FieldSigma>,
    /// Smallest and largest finite number of the input, as stored.
    pub stored_range: [f64; 2],
    /// The value field that was differentiated.
    pub field: WorkingField,
    /// The roles.
    pub roles: Roles,
}

/// Computes the roles without writing them.
///
/// # Errors
/// As [`prepare`], but for writing.
pub fn compute_roles(
    grid: &Grid,
    settings: &Settings,
    progress: &dyn Progress,
    watch: &mut Stopwatch,
) -> Result<(Prepared, Counts)> {
    settings.validate()?;
    let source = Source::from(grid);
    let scan = Scan::new(&source, false)?;
    let mut recipe = Recipe::new(source, scan, None, settings, true, watch)?;
    let Block { field, roles, counts, .. } = recipe.prepare(Region::whole(source.dims()), progress, watch)?;
    let Recipe { settings, choice, range_sigmas, scan, .. } = recipe;
    let prepared =
        Prepared { settings, choice, range_sigma: range_sigmas.shares, stored_range: scan.range, field, roles };
    Ok((prepared, counts))
}
