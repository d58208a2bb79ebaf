//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use voxrole_pack::{HistogramKind, Precision, ScalarType};
use voxrole_preprocess::byte_size::byte_size;
use voxrole_preprocess::differentiation::Kernel;
use voxrole_preprocess::export::ExportFormat;
use voxrole_preprocess::fields::Field;
use voxrole_preprocess::phantom::{NoiseKind, Phantom, Quantization};
use voxrole_preprocess::raw_args::{RawArgs, parse_triple};
use voxrole_preprocess::reconstruction::Reconstruction;

use super::bench::BenchArgs;

/// Prepares volumes overnight: where each voxel stands relative to the nearest boundary along its own gradient.
#[derive(Debug, Parser)]
#[command(name = "voxrole", version, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compute the voxel roles of volumes and pack each into a file.
    #[command(allow_negative_numbers = true)]
    Prepare(PrepareArgs),
    /// Say what a packed file holds.
    Info(InfoArgs),
    /// Read a packed file whole and check every byte.
    Verify(FileArgs),
    /// Write fields of a packed file in other programs' formats.
    Export(ExportArgs),
    /// Draw a histogram of a packed file, or write it as a table.
    Histogram(HistogramArgs),
    /// Draw one slice of a packed file.
    Slice(SliceArgs),
    /// Make a volume by formula, whose boundaries are known exactly.
    Phantom(PhantomArgs),
    /// Measure how good and how fast the methods are.
    Bench(BenchArgs),
}

/// A packed file.
#[derive(Debug, Args)]
pub struct FileArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
}

/// `prepare`.
#[derive(Debug, Args)]
pub struct PrepareArgs {
    /// Volumes: NRRD, MetaImage, NIfTI-1, VTI, TIFF, folders of Zarr or of TIFF slices, or headerless with --dims and --dtype,
    /// which then hold for all.
    #[arg(value_name = "VOLUME", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Packed file to write; with several volumes a folder, made if there is none, for files named after them: a.nrrd and
    /// b.nii.gz become a.vxr and b.vxr. A folder that exists will do for one volume too.
    #[arg(short, long, value_name = "OUT.vxr|FOLDER")]
    pub output: PathBuf,
    /// Rule set that the other defaults come from.
    #[arg(long, value_enum, default_value = "auto")]
    pub method: MethodArg,
    /// What differentiates the value: central2, central4, bspline3, bspline5, gaussian:SIGMA [default: central2 for paper
    /// and fast, bspline5 for accurate].
    #[arg(long, value_name = "KERNEL")]
    pub derivative: Option<Kernel>,
    /// What lies between the voxels at a boundary: linear, cubic or quintic interpolation of g and f'', or exact, the
    /// derivatives of the value's own spline [default: linear for paper and fast, exact for accurate].
    #[arg(long, value_name = "KIND")]
    pub reconstruction: Option<Reconstruction>,
    /// What refines a boundary's place [default: bisection where f'' is trilinear, else chandrupatla].
    #[arg(long, value_enum)]
    pub root: Option<RootArg>,
    /// What is zero on an edge: f'' along the gradient, or PLUS, which keeps to curved surfaces.
    #[arg(long, value_enum, default_value = "second-derivative")]
    pub edge: EdgeArg,
    /// Where to smooth [default: bilateral-derivatives for paper, none for fast and accurate].
    #[arg(long, value_enum)]
    pub smooth: Option<SmoothArg>,
    /// Spatial σ of the smoothing in multiples of the smallest spacing [default: 1, Gaussian 1.5].
    #[arg(long, value_name = "F")]
    pub spatial_sigma: Option<f64>,
    /// Range σ of a bilateral filter as a share of the filtered field's range [default: 0.4 for the value, three
    /// times their estimated noise for derivatives].
    #[arg(long, value_name = "F")]
    pub range_sigma: Option<f64>,
    /// How a bilateral filter computes its range weights [default: fast].
    #[arg(long, value_enum)]
    pub bilateral: Option<BilateralArg>,
    /// Neighbours on each side that a filter looks at, in voxels [default: 2, Gaussian 5; more where σ is
    /// larger].
    #[arg(long, value_name = "N")]
    pub radius: Option<usize>,
    /// What stops a ray: a fall of its own gradient magnitude (literal), or only a rise along the other ray (release)
    /// [default: literal for paper, release for the others].
    #[arg(long, value_enum)]
    pub climb: Option<ClimbArg>,
    /// Distance between samples along a ray, in multiples of the smallest spacing.
    #[arg(long, value_name = "F", default_value_t = 0.2)]
    pub step: f64,
    /// Length of a ray in multiples of the smallest spacing.
    #[arg(long, value_name = "F", default_value_t = 15.0)]
    pub dmax: f64,
    /// Gradients up to this multiple of the estimated gradient noise, which may depend on the value, are no boundary [default: 0 for
    /// paper, 4 for the others].
    #[arg(long, value_name = "F")]
    pub noise_floor: Option<f64>,
    /// Store gradient magnitude and second derivative too.
    #[arg(long, value_enum)]
    pub keep: Option<KeepArg>,
    /// Bits of a stored distance and of a gradient magnitude at a hit, 8 to 16: 16 err by 0.0002 voxels, 8 by 0.06.
    #[arg(long, value_name = "BITS", default_value = "16", value_parser = parse_precision)]
    pub precision: Precision,
    /// Levels of detail, each with every second voxel of the one before; 1 for the volume alone [default: until no axis has
    /// more than 64 voxels].
    #[arg(long, value_name = "N")]
    pub levels: Option<u32>,
    /// Take every sample along rays, also where no boundary can be; the file is the same.
    #[arg(long)]
    pub no_skip: bool,
    /// Threads to use [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Volumes to prepare at a time, on the same threads; the seconds of one may then include work on others.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub jobs: u16,
    /// Memory to use at most, such as 900MiB or 8GiB, divided among the jobs; a volume that does not fit is prepared block
    /// by block [default: half of the machine's].
    #[arg(long, value_name = "SIZE", value_parser = byte_size)]
    pub memory: Option<u64>,
    /// Leave out volumes whose packed file is there already, whatever its settings: to go on with several volumes where a
    /// command was interrupted.
    #[arg(long)]
    pub skip_existing: bool,
    /// Write seconds and counts of the run as JSON: an object, or with several volumes an array of one object each, which
    /// is {"input", "error"} where a volume failed, {"input", "skipped"} where it was left out, and {"input", "interrupted"}
    /// where the command ended before; in place of the last two a report that is replaced keeps what it has of a packed file
    /// that is there. It is written anew after each volume.
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// How to tell on standard error how far it is [default: bar on a terminal, else lines].
    #[arg(long, value_enum)]
    pub progress: Option<ProgressArg>,
    /// Layout of a headerless input.
    #[command(flatten)]
    pub raw: RawArgs,
}

/// `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
    /// What to write, one or several with commas between them. Values keep their own type of number where they have neither
    /// slope nor intercept; the others are 32-bit floats in physical units, NaN without a boundary in distance, hit-gradient
    /// and normal. Roles are 8-bit integers: 0 no boundary, 1 on it, 2 high-value side, 3 low-value side, -1 masked.
    #[arg(
        long,
        value_enum,
        value_name = "FIELD,...",
        value_delimiter = ',',
        required_unless_present = "all",
        conflicts_with = "all"
    )]
    pub field: Vec<FieldArg>,
    /// Write every field that the file has.
    #[arg(long)]
    pub all: bool,
    /// File to write: .nrrd, .nii.gz, .nii, .vti, .tif, .npy or .ome.zarr (a folder, replaced if it is an earlier export).
    /// With several fields, or where there is such a folder, a folder for files named after their fields.
    #[arg(short, long, value_name = "OUT|FOLDER")]
    pub output: PathBuf,
    /// Format [default: by the output's name].
    #[arg(long, value_enum)]
    pub format: Option<FormatArg>,
    /// Level to write: 0 is the volume, each next one has every second voxel along each axis. OME-Zarr holds this one and all
    /// coarser ones.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub level: usize,
    /// Pack NRRD by gzip and VTI by zlib.
    #[arg(long)]
    pub compress: bool,
}

/// `histogram`.
#[derive(Debug, Args)]
pub struct HistogramArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
    /// Value against gradient magnitude (v-g), against second derivative (v-f2), against gradient magnitude at the hit
    /// (v-hit), both at the hit (hit-hit), or signed distance.
    #[arg(long, value_enum)]
    pub kind: HistogramArg,
    /// Picture (.png), table (.csv) or array of counts (.npy) to write; beside an array out.npy the edges of its bins are
    /// written, out_value_edges.npy and so on.
    #[arg(short, long, value_name = "OUT.png|OUT.csv|OUT.npy")]
    pub output: PathBuf,
}

/// `slice`.
#[derive(Debug, Args)]
pub struct SliceArgs {
    /// Packed file (.vxr).
    pub file: PathBuf,
    /// What to draw.
    #[arg(long, value_enum)]
    pub field: FieldArg,
    /// Axis at right angles to the slice.
    #[arg(long, value_enum)]
    pub axis: AxisArg,
    /// Which slice, from 0.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub index: u32,
    /// Picture to write.
    #[arg(short, long, value_name = "OUT.png")]
    pub output: PathBuf,
}

/// `phantom`.
#[derive(Debug, Args)]
pub struct PhantomArgs {
    /// Which phantom.
    #[arg(value_parser = parse_phantom, required_unless_present = "list")]
    pub name: Option<Phantom>,
    /// Voxels along x, y, z.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<u32>, required_unless_present = "list")]
    pub dims: Option<[u32; 3]>,
    /// Distance between voxels along x, y, z.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<f64>, default_value = "1,1,1")]
    pub spacing: Triple,
    /// Blur of the boundaries (σ) in multiples of the smallest spacing [default: 1.5].
    #[arg(long, value_name = "F")]
    pub blur: Option<f64>,
    /// Thickness of each slab of slab-pair in multiples of the smallest spacing [default: 4].
    #[arg(long, value_name = "F")]
    pub thickness: Option<f64>,
    /// Rotation of the grid against the scene about the world's x, then y, then z axis, in degrees; the middle stays.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<f64>, default_value = "0,0,0", allow_hyphen_values = true)]
    pub rotation: Triple,
    /// Shift of the scene along x, y, z in multiples of the smallest spacing.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<f64>, default_value = "0,0,0", allow_hyphen_values = true)]
    pub offset: Triple,
    /// Noise (σ) as a share of the largest step.
    #[arg(long, value_name = "F", default_value_t = 0.0)]
    pub noise: f64,
    /// gaussian, or rician as of magnetic resonance: the magnitude of a complex value with noise in both parts.
    #[arg(long, value_name = "KIND", default_value = "gaussian", value_parser = parse_noise_kind)]
    pub noise_kind: NoiseKind,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// What values of f32 and f64, noise included, are multiplied by.
    #[arg(long, value_name = "F", default_value_t = 1.0, allow_hyphen_values = true)]
    pub value_scale: f64,
    /// What is added to them after that.
    #[arg(long, value_name = "F", default_value_t = 0.0, allow_hyphen_values = true)]
    pub value_offset: f64,
    /// Type of number: u8, i8, u12 (0 to 4095 in a u16), u16, i16, u32, i32, f32, f64.
    #[arg(long, value_name = "TYPE", default_value = "f32", value_parser = parse_phantom_type)]
    pub dtype: PhantomType,
    /// NRRD file to write.
    #[arg(short, long, value_name = "OUT.nrrd", required_unless_present = "list")]
    pub output: Option<PathBuf>,
    /// NRRD file to write the exact signed distance to, that to the sharp surface which was blurred.
    #[arg(long, value_name = "OUT.nrrd")]
    pub truth: Option<PathBuf>,
    /// NRRD file to write the signed distance along the gradient to the formula's own zero crossing of f'' to.
    #[arg(long, value_name = "OUT.nrrd")]
    pub crossing: Option<PathBuf>,
    /// List the phantoms.
    #[arg(long)]
    pub list: bool,
}

/// A type of number, and what stands for what in it if that is not the type's own.
#[derive(Clone, Copy, Debug)]
pub struct PhantomType {
    /// What is stored.
    pub scalar_type: ScalarType,
    /// The integers that are used.
    pub quantization: Option<Quantization>,
}

/// Three numbers; clap would take a bare array for a list.
pub type Triple = [f64; 3];

/// `--method`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MethodArg {
    /// Chooses smoothing, kernel and reconstruction by the volume's noise and blur; the report says what and why.
    Auto,
    /// The quintic spline through the values and its own derivatives: for data without noise and with edges blurred by
    /// 0.8 voxels and more.
    Accurate,
    /// Central differences and linear interpolation, no smoothing.
    Fast,
    /// The paper's: central differences, a bilateral filter on g and f'', the literal climbing rule.
    Paper,
}

/// `--smooth`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SmoothArg {
    /// Nowhere.
    None,
    /// Bilateral filter on gradient magnitude and second derivative.
    BilateralDerivatives,
    /// Bilateral filter on the value.
    BilateralValue,
    /// Gaussian on the value.
    GaussianValue,
}

/// `--bilateral`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BilateralArg {
    /// By polynomials: the filtered field is off by at most 0.1 % of its range, 0.01 % with the default spatial σ.
    Fast,
    /// By the exponential, neighbour by neighbour; slower.
    Exact,
}

/// `--climb`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ClimbArg {
    /// A fall of the ray's own gradient magnitude.
    Literal,
    /// Only a rise along the other ray.
    Release,
}

/// `--root`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RootArg {
    /// Halves the bracket.
    Bisection,
    /// Inverse quadratics where they fit, else halves: on splines a third of the evaluations.
    Chandrupatla,
    /// Solves trilinear f'' in closed form; chandrupatla where it is not trilinear.
    Cubic,
}

/// `--edge`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum EdgeArg {
    /// f'' along the gradient.
    SecondDerivative,
    /// Half of f'' and the Laplacian: on curved edges no bias by the blur.
    Plus,
}

/// `--progress`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ProgressArg {
    /// A bar for each volume in work, with an estimate of the time left.
    Bar,
    /// A line for each stage.
    Lines,
    /// One JSON object a line. "event" is begin (of a "stage" of so many "steps"), step ("done" of "steps", at most two a
    /// second and the last), done ("seconds", "output", "bytes"), skipped ("output"), note, warning or error ("message"),
    /// each with "input"; and with several volumes a last summary ("succeeded", "skipped", "failed").
    Json,
}

fn parse_precision(text: &str) -> Result<Precision, String> {
    text.parse().ok().and_then(Precision::new).ok_or_else(|| "give a number of bits from 8 to 16".into())
}

/// `--keep`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum KeepArg {
    /// Gradient magnitude and second derivative.
    Derivatives,
}

/// `export --field`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum FieldArg {
    /// Physical value; in a slice grey.
    Value,
    /// Signed distance; in a slice the paper's flipped image, white at the boundary.
    Distance,
    /// Gradient magnitude at the hit; in a slice from violet to yellow.
    HitGradient,
    /// Unit gradient direction along the world's axes; in a slice its parts along x, y, z as red, green, blue.
    Normal,
    /// Role as a number; in a slice white on a boundary, red on its low-value side, blue on the other.
    Role,
    /// Gradient magnitude at the voxel; in a slice from violet to yellow.
    GradientMagnitude,
    /// Second derivative along the gradient; in a slice red where negative, blue where positive.
    SecondDerivative,
}

impl From<FieldArg> for Field {
    fn from(field: FieldArg) -> Self {
        match field {
            FieldArg::Value => Self::Value,
            FieldArg::Distance => Self::Distance,
            FieldArg::HitGradient => Self::HitGradient,
            FieldArg::Normal => Self::Normal,
            FieldArg::Role => Self::Role,
            FieldArg::GradientMagnitude => Self::GradientMagnitude,
            FieldArg::SecondDerivative => Self::SecondDerivative,
        }
    }
}

/// `export --format`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum FormatArg {
    /// For teem, ITK, 3D Slicer and ParaView.
    Nrrd,
    /// NIfTI-1, packed.
    Nifti,
    /// VTK's image data, for ParaView.
    Vti,
    /// A stack for ImageJ and Fiji.
    Tiff,
    /// An array for numpy.
    Npy,
    /// A folder of chunks in several levels, for napari and whatever streams.
    OmeZarr,
}

impl From<FormatArg> for ExportFormat {
    fn from(format: FormatArg) -> Self {
        match format {
            FormatArg::Nrrd => Self::Nrrd,
            FormatArg::Nifti => Self::Nifti,
            FormatArg::Vti => Self::Vti,
            FormatArg::Tiff => Self::Tiff,
            FormatArg::Npy => Self::Npy,
            FormatArg::OmeZarr => Self::OmeZarr,
        }
    }
}

/// `slice --axis`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum AxisArg {
    /// y to the right, z upwards.
    X,
    /// x to the right, z upwards.
    Y,
    /// x to the right, y downwards.
    Z,
}

/// `histogram --kind`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum HistogramArg {
    /// Value, gradient magnitude.
    #[value(name = "v-g")]
    VG,
    /// Value, second derivative.
    #[value(name = "v-f2")]
    VF2,
    /// Value, gradient magnitude at the hit.
    VHit,
    /// Value at the hit, gradient magnitude at the hit.
    HitHit,
    /// Signed distance.
    Distance,
}

impl From<HistogramArg> for HistogramKind {
    fn from(kind: HistogramArg) -> Self {
        match kind {
            HistogramArg::VG => Self::ValueGradient,
            HistogramArg::VF2 => Self::ValueSecondDerivative,
            HistogramArg::VHit => Self::ValueHitGradient,
            HistogramArg::HitHit => Self::HitValueHitGradient,
            HistogramArg::Distance => Self::Distance,
        }
    }
}

fn parse_phantom(name: &str) -> Result<Phantom, String> {
    Phantom::from_name(name).ok_or_else(|| format!("one of {}", Phantom::ALL.map(Phantom::name).join(", ")))
}

fn parse_noise_kind(name: &str) -> Result<NoiseKind, String> {
    NoiseKind::from_name(name).ok_or_else(|| format!("one of {}", NoiseKind::ALL.map(NoiseKind::name).join(", ")))
}

fn parse_phantom_type(name: &str) -> Result<PhantomType, String> {
    if name == "u12" {
        return Ok(PhantomType { scalar_type: ScalarType::U16, quantization: Some(Quantization::U12) });
    }
    let scalar_type = ScalarType::from_name(name)
        .ok_or_else(|| format!("one of u12, {}", ScalarType::ALL.map(ScalarType::name).join(", ")))?;
    Ok(PhantomType { scalar_type, quantization: None })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_description_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn names_of_the_contract_are_understood() {
        for line in [
            "voxrole prepare in.nrrd -o out.vxr --method paper --smooth bilateral-derivatives --spatial-sigma 1 \
             --range-sigma 0.1 --bilateral exact --radius 2 --climb literal --step 0.2 --dmax 15 --keep derivatives \
             --no-skip --threads 2 --report r.json",
            "voxrole prepare a.nrrd b.nii.gz c.mha -o folder --jobs 2 --memory 4GiB --progress json",
            "voxrole prepare in.raw -o out.vxr --dims 2,3,4 --dtype u16be --spacing 1,1,2 --skip-bytes 8",
            "voxrole histogram f.vxr --kind v-g -o o.png",
            "voxrole histogram f.vxr --kind v-f2 -o o.png",
            "voxrole histogram f.vxr --kind v-hit -o o.csv",
            "voxrole histogram f.vxr --kind hit-hit -o o.png",
            "voxrole slice f.vxr --field second-derivative --axis x --index 3 -o o.png",
            "voxrole export f.vxr --field hit-gradient -o o.nrrd",
            "voxrole export f.vxr --field value,distance --format nifti --level 1 -o folder",
            "voxrole export f.vxr --all --format ome-zarr -o folder",
            "voxrole phantom ball --dims 8,8,8 --blur 1 --noise 0 --seed 3 --dtype u8 --spacing 1,1,1 -o o.nrrd",
            "voxrole phantom slab-pair --dims 64,64,64 --thickness 2 --rotation 10,-20,30 --offset -0.5,0,0.25 \
             --noise 0.01 --noise-kind rician --dtype u12 -o o.nrrd --truth t.nrrd --crossing c.nrrd",
            "voxrole phantom box --dims 8,8,8 --value-scale -1e30 --value-offset -1e6 --dtype f64 -o o.nrrd",
            "voxrole phantom --list",
        ] {
            Cli::try_parse_from(line.split_whitespace()).expect(line);
        }
    }
}
