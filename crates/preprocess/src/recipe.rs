//! What is the same for every block of a volume, and the way of one block through all stages.

use std::borrow::Cow;
use std::mem::take;

use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::{ScalarType, Scalars};

use crate::automatic::{Choice, LEAST_BLUR, choose};
use crate::blur::Edges;
use crate::boundary::{GRADIENT_FLOOR, GradientFloor, Tracer};
use crate::bspline::{Coefficients, Degree, Evaluator};
use crate::differentiation::{Gradient, GradientSource, Kernel, differentiate, differentiate_into, spline_through};
use crate::directional_derivative::Derivatives;
use crate::gaussian::{gaussian, radius_of};
use crate::noise::{noise_sigma, noise_sigma_of_slabs, smoothed_noise_sigma};
use crate::noise_gain::{GradientNoise, NoiseGain};
use crate::padded_field::PaddedField;
use crate::progress::Progress;
use crate::reconstruction::{Reconstruction, Smooth};
use crate::region::Region;
use crate::report::{Counts, Stopwatch};
use crate::roles::{FAINT, Roles};
use crate::sampler::Sampler;
use crate::scan::Scan;
use crate::settings::{Automatic, Settings, Smoothing};
use crate::smoothing::{Extent, RangeSigmas, sigma_on_noise, smooth_derivatives, smooth_value};
use crate::source::Source;
use crate::value_noise::{NoisyValues, ValueNoise};
use crate::working_field::{Scaling, WorkingField, voxels};
use crate::zero_crossing::CellDistances;
use crate::{Result, reach};

/// Voxels by which smoothing and kernel are chosen.
const CHOICE_VOXELS: usize = 1 << 22;
/// No more of the boundaries than this share are faint where the noise is estimated well: 2 to 4 % of brains', a third of an engine's in
/// whose metal it is stronger than in the air around.
const MOST_FAINT: f64 = 0.1;
/// Nor more of the voxels, of which noise alone gives one in a thousand a boundary.
const MOST_FAINT_VOXELS: f64 = 0.01;
/// Voxels by which it is judged what smoothing left of the noise, and what range its derivatives have.
const NOISE_VOXELS: usize = 1 << 20;
/// Voxels of the slabs in which noise is estimated: as read and as working numbers few enough for runs with 64 MiB.
const SLAB_VOXELS: usize = 3 << 20;

/// Everything that the roles of a volume depend on beside its voxels nearby.
pub struct Recipe<'a> {
    /// The volume.
    pub source: Source<'a>,
    /// What all of it was seen for.
    pub scan: Scan,
    /// The settings, with what was chosen by the data.
    pub settings: Settings,
    /// What was found in the data and chosen by it.
    pub choice: Option<Choice>,
    /// Estimated noise of the input, in working units.
    pub noise: f32,
    /// σr of the bilaterally filtered fields.
    pub range_sigmas: RangeSigmas,
    /// From stored numbers to working ones.
    pub scaling: Scaling,
    /// Values whose noise is stronger than that.
    pub noisy_values: Vec<NoisyValues>,
    floor: GradientFloor,
    /// The field of the whole volume, until a block takes it.
    whole: Option<WorkingField>,
    spare: Spare,
}

/// Memory of the block before, for the next one: the system takes longer to make room than all stages but the rays take. What
/// few settings need, as smoothing does, is not in it.
#[derive(Default)]
pub struct Spare {
    values: Vec<f32>,
    derivatives: [Vec<f32>; 2],
    /// Of what gives the gradient.
    source: Vec<f32>,
    cells: Vec<u8>,
    roles: Roles,
}

/// One block on its way.
pub struct Block<'a> {
    /// Its voxels.
    pub interior: Region,
    /// Those and what around them they depend on.
    pub padded: Region,
    /// Stored numbers of the padded block.
    pub scalars: Cow<'a, Scalars>,
    /// The value field that was differentiated, of the padded block.
    pub field: WorkingField,
    /// Its derivatives, smoothed where the settings say so.
    pub derivatives: Derivatives,
    /// Roles of the interior alone.
    pub roles: Roles,
    /// What there was to do.
    pub counts: Counts,
    /// Edges on the way, where a spline is to be checked against their blur.
    pub edges: Option<Edges>,
    /// Memory that is needed no longer.
    pub spare: Spare,
}

impl Spare {
    /// Room for the largest of several blocks, whose padded dimensions are given: what grew from block to block would leave holes.
    fn for_blocks(blocks: impl Iterator<Item = [usize; 3]>, kernel: Kernel) -> Result<Self> {
        let (mut voxels, mut padded) = (0, 0);
        for dims in blocks {
            voxels = voxels.max(dims.iter().product());
            padded = padded.max(PaddedField::memory_len(dims));
        }
        let what = "the fields of a block";
        Ok(Self {
            values: vec_with_capacity(voxels, what)?,
            derivatives: [vec_with_capacity(voxels, what)?, vec_with_capacity(voxels, what)?],
            source: vec_with_capacity(if kernel == Kernel::Central2 { 0 } else { padded }, what)?,
            cells: vec_with_capacity(voxels, what)?,
            roles: Roles::default(),
        })
    }
}

impl Block<'_> {
    /// All of its memory.
    #[must_use]
    pub fn into_spare(self) -> Spare {
        let Self { field, derivatives, roles, spare, .. } = self;
        let values = field.values.into_raw_vec_and_offset().0;
        Spare { values, derivatives: derivatives.into_memory(), roles, ..spare }
    }
}

impl<'a> Recipe<'a> {
    /// Looks at the volume and decides what is left to the data; `noise` is the volume's, where it is known. `at_once` says
    /// that the volume will be one block.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for settings or a volume that cannot be used; [`crate::Error::Io`] when reading fails,
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(
        source: Source<'a>,
        scan: Scan,
        noise: Option<f32>,
        settings: &Settings,
        at_once: bool,
        watch: &mut Stopwatch,
    ) -> Result<Self> {
        let mut settings = *settings;
        let scaling = Scaling::new(&source, scan.range);
        let dims = source.dims();
        let read = |region: &Region| scaling.field(&*source.read(region)?, region.dims());
        let whole = if at_once { Some(read(&Region::whole(dims))?) } else { None };
        watch.lap("conversion");
        let noise = match (noise, &whole) {
            (Some(noise), _) => noise,
            (None, Some(field)) => noise_sigma(field),
            (None, None) => noise_sigma_of_slabs(dims, SLAB_VOXELS / (dims[0] * dims[1]), read)?,
        };
        let noise = noise.max(quantisation_noise(&source, &scaling));
        watch.lap("noise estimate");
        let sample = |voxels: usize| -> Result<Vec<Cow<'_, WorkingField>>> {
            let regions = scan.sample(voxels);
            match &whole {
                Some(field) if regions == [Region::whole(dims)] => Ok(vec![Cow::Borrowed(field)]),
                _ => regions.iter().map(|region| read(region).map(Cow::Owned)).collect(),
            }
        };
        let choice = if settings.automatic == Automatic::default() {
            None
        } else {
            let fields = sample(CHOICE_VOXELS)?;
            let choice = choose(&fields.iter().map(AsRef::as_ref).collect::<Vec<_>>(), noise, &mut settings)?;
            watch.lap("choice of method");
            Some(choice)
        };

        let volume = Extent { dims, spacing: scaling.spacing() };
        let value_range = scan.range.map(|end| scaling.working(end));
        let mut range_sigmas = RangeSigmas::of_value(&settings.smoothing, volume, value_range);
        let sigmas: Vec<f32> = sigma_on_noise(&settings.smoothing).into_iter().collect();
        let is_smooth = settings.smoothing.placement != Smoothing::None || settings.kernel.sigma().is_some();
        let is_noise_asked_for = settings.noise_floor > 0.0;
        let (mut left, mut value_noise) = (noise, ValueNoise::EVEN);
        if is_smooth || is_noise_asked_for {
            let mut fields: Vec<_> = sample(NOISE_VOXELS)?.into_iter().map(Cow::into_owned).collect();
            if is_smooth {
                left = try_smoothing(&settings, &mut fields, volume, noise, &mut range_sigmas)?;
                watch.lap("noise left");
            }
            if is_noise_asked_for {
                value_noise = ValueNoise::find(&mut fields, &settings, &sigmas, left, value_range)?;
                watch.lap("noise by value");
            }
        }
        let noisy_values =
            value_noise.noisy_values(|value| f64::from(value) * scaling.value_scale() + scaling.value_offset());
        let gradient_noise = GradientNoise::new(settings.kernel, &sigmas, scaling.spacing(), dims, left)?;
        let floor = GradientFloor::new(gradient_noise, value_noise, settings.noise_floor as f32);
        Ok(Self {
            source,
            scan,
            settings,
            choice,
            noise,
            range_sigmas,
            scaling,
            noisy_values,
            floor,
            whole,
            spare: Spare::default(),
        })
    }

    /// How many voxels away along each axis a voxel's role depends on the volume.
    #[must_use]
    pub fn reach(&self) -> [usize; 3] {
        reach::reach(&self.settings, self.scaling.spacing(), self.scan.has_bad)
    }

    /// Takes a block through all stages.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn prepare(&mut self, interior: Region, progress: &dyn Progress, watch: &mut Stopwatch) -> Result<Block<'a>> {
        let settings = self.settings;
        let padded = interior.grown(self.reach(), self.source.dims());
        let scalars = self.source.read(&padded)?;
        watch.lap("reading blocks");
        let mut field = match self.whole.take().filter(|field| field.dims() == padded.dims()) {
            Some(field) => field,
            None => self.scaling.field_in(take(&mut self.spare.values), &scalars, padded.dims())?,
        };
        watch.lap("conversion");
        smooth_value(&mut field, padded.start, &settings.smoothing, &mut self.range_sigmas);
        watch.lap("value smoothing");
        let mut derivatives = Derivatives::unset(take(&mut self.spare.derivatives), padded.dims());
        let memory = take(&mut self.spare.source);
        let source = differentiate_into(&mut field, settings.kernel, settings.operator, &mut derivatives, memory)?;
        watch.lap("derivatives");
        let (origin, sigmas) = (padded.start, &mut self.range_sigmas);
        smooth_derivatives(&mut derivatives, field.spacing, origin, &settings.smoothing, sigmas);
        watch.lap("derivative smoothing");
        let cells = CellDistances::new_in(take(&mut self.spare.cells), &derivatives.second_derivative);
        watch.lap("zero-crossing cells");
        let splines = DerivativeSplines::new(&derivatives, settings.reconstruction)?;
        watch.lap("reconstruction");

        let floor = self.floor.from_voxel(padded.start);
        let smooth = splines.smooth(&field, &source, &settings);
        let gradient = Gradient::new(&field, &source);
        let tracer = Tracer::new(&field, &derivatives, &cells, gradient, smooth, &floor, &settings);
        let roles = Roles::new_in(take(&mut self.spare.roles), &tracer, interior.within(&padded), progress)?;
        watch.lap("rays");
        let edges = self.edges(&tracer, &source, &field, &interior, padded.start);
        watch.lap("check of blur");
        let inner_cells = cells_of(&interior, self.source.dims());
        let counts = Counts {
            voxels: roles.distance.len() as u64,
            masked: roles.masked,
            flat: roles.work.flat,
            skipped: roles.work.skipped,
            traced: roles.work.traced,
            samples: roles.work.samples,
            evaluations: roles.work.evaluations,
            hits: roles.hits,
            faint: roles.faint,
            misses: roles.misses(),
            cells: inner_cells.voxel_count() as u64,
            mixed_cells: cells.mixed_count(&inner_cells.within(&padded)),
        };
        let spare = Spare { cells: cells.cells, source: source.into_memory(), ..Spare::default() };
        Ok(Block { interior, padded, scalars, field, derivatives, roles, counts, edges, spare })
    }

    /// Makes room for any of several blocks.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn make_room(&mut self, blocks: impl Iterator<Item = Region>) -> Result<()> {
        let (reach, dims) = (self.reach(), self.source.dims());
        self.spare = Spare::for_blocks(blocks.map(|block| block.grown(reach, dims).dims()), self.settings.kernel)?;
        Ok(())
    }

    /// Takes the memory of a block that is finished for the next one.
    pub fn reuse(&mut self, spare: Spare) {
        self.spare = spare;
    }

    /// A warning where many boundaries are hardly above the noise: edges are not, so it was taken to be weaker than it is.
    #[must_use]
    pub fn noise_left(&self, counts: &Counts) -> Option<String> {
        let is_noise = self.floor.least() > GRADIENT_FLOOR;
        let share = counts.faint as f64 / counts.hits.max(1) as f64;
        let is_much = share > MOST_FAINT && counts.faint as f64 > MOST_FAINT_VOXELS * counts.voxels as f64;
        (is_noise && is_much).then(|| {
            let deviations = self.settings.noise_floor;
            format!(
                "{:.0} % of the voxels with a boundary owe it to gradients less than twice the noise floor: part of the volume is noisier \
                 than most of it, and distances are speckled there; --noise-floor {} (now {deviations}) leaves such gradients out",
                100.0 * share,
                f64::from(FAINT) * deviations
            )
        })
    }

    /// Edges that tell whether a spline was fitted to what is too sharp for it; none where there is no spline.
    fn edges(
        &self,
        tracer: &Tracer<'_>,
        source: &GradientSource,
        field: &WorkingField,
        interior: &Region,
        origin: [usize; 3],
    ) -> Option<Edges> {
        let GradientSource::Spline(coefficients) = source else { return None };
        let spline = Evaluator::new(coefficients, field.spacing);
        let mut edges = Edges::among(&[self.source.dims()]);
        edges.look(tracer, &spline, interior, origin);
        Some(edges)
    }

    /// Says so where a spline is fitted to edges that are too sharp for it.
    #[must_use]
    pub fn under_sampling(&self, edges: Option<&Edges>) -> Option<String> {
        let blur = edges?.statistics()?.samples_across(self.scaling.spacing(), 0.0);
        (blur < LEAST_BLUR).then(|| {
            format!(
                "boundaries blurred by {blur:.2} samples are under-sampled for --derivative {}: it rings beside them and \
                 finds boundaries that are none; --method auto or fast do not",
                self.settings.kernel
            )
        })
    }
}

/// Smooths the value of parts of a volume, to see what ranges its derivatives have, where those are filtered, and how much
/// noise was there judging by what is left of it.
fn try_smoothing(
    settings: &Settings,
    fields: &mut [WorkingField],
    volume: Extent,
    noise: f32,
    range_sigmas: &mut RangeSigmas,
) -> Result<f32> {
    let Settings { smoothing, kernel, operator, .. } = settings;
    let sigmas: Vec<f32> = sigma_on_noise(smoothing).into_iter().collect();
    if smoothing.placement == Smoothing::BilateralDerivatives {
        let gain = NoiseGain::new(*kernel, &sigmas, volume.spacing)?;
        let mut ranges = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
        for field in &*fields {
            let (derivatives, _) = differentiate(&mut field.clone(), *kernel, *operator)?;
            for (sum, [low, high]) in ranges.iter_mut().zip(derivatives.ranges()) {
                *sum = [sum[0].min(low), sum[1].max(high)];
            }
        }
        *range_sigmas = RangeSigmas::of_derivatives(smoothing, volume, ranges, noise, gain);
    }
    let smoothed: Vec<f32> = sigmas.into_iter().chain(kernel.sigma()).collect();
    if smoothed.is_empty() {
        return Ok(noise);
    }
    for field in &mut *fields {
        smooth_value(field, [0; 3], smoothing, &mut range_sigmas.clone());
    }
    // What noise is left is seen best where it is left.
    let left = |fields: &[&WorkingField]| noise.max(smoothed_noise_sigma(fields, &smoothed));
    let Some(sigma) = kernel.sigma() else { return Ok(left(&fields.iter().collect::<Vec<_>>())) };
    let by_kernel = |field: &WorkingField| WorkingField {
        values: gaussian(&field.values, field.spacing, sigma, radius_of(sigma, field.spacing)),
        ..*field
    };
    let fields: Vec<_> = fields.iter().map(by_kernel).collect();
    Ok(left(&fields.iter().collect::<Vec<_>>()))
}

/// The cells whose lowest corner is in a region.
fn cells_of(region: &Region, dims: [usize; 3]) -> Region {
    let behind = |axis: usize| region.end[axis].min(dims[axis].saturating_sub(1).max(1));
    Region { start: region.start, end: std::array::from_fn(|axis| behind(axis).max(region.start[axis])) }
}

/// Standard deviation of the rounding of values to whole numbers, in working units: a uniform distribution's. 0 for
/// floats.
fn quantisation_noise(source: &Source<'_>, scaling: &Scaling) -> f32 {
    match source.scalar_type() {
        ScalarType::F32 | ScalarType::F64 => 0.0,
        _ => (source.slope.abs() / scaling.value_scale() / 12.0_f64.sqrt()) as f32,
    }
}

/// Splines through the derivatives, where the reconstruction asks for them.
struct DerivativeSplines(Option<[Coefficients; 2]>);

impl DerivativeSplines {
    fn new(derivatives: &Derivatives, reconstruction: Reconstruction) -> Result<Self> {
        let degree = match reconstruction {
            Reconstruction::Linear | Reconstruction::Exact => return Ok(Self(None)),
            Reconstruction::Cubic => Degree::Cubic,
            Reconstruction::Quintic => Degree::Quintic,
        };
        Ok(Self(Some([
            spline_through(&derivatives.second_derivative, degree)?,
            spline_through(&derivatives.gradient_magnitude, degree)?,
        ])))
    }

    fn smooth<'a>(
        &'a self,
        field: &'a WorkingField,
        source: &'a GradientSource,
        settings: &Settings,
    ) -> Option<Smooth<'a>> {
        let evaluator = |coefficients| Evaluator::new(coefficients, field.spacing);
        match (&self.0, source) {
            (Some([second_derivative, gradient_magnitude]), _) => Some(Smooth::Fields {
                second_derivative: evaluator(second_derivative),
                gradient_magnitude: evaluator(gradient_magnitude),
                values: (Sampler::new(field.dims()), voxels(&field.values)),
            }),
            (None, GradientSource::Spline(value)) if settings.reconstruction == Reconstruction::Exact => {
                Some(Smooth::Exact { value: evaluator(value), operator: settings.operator })
            }
            _ => None,
        }
    }
}
