//! The command line.

use std::path::PathBuf;

use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use voxrole_preprocess::byte_size::byte_size;
use voxrole_preprocess::raw_args::RawArgs;

use crate::device_args::DeviceArgs;
use crate::frame::Frame;
use crate::reference::MAX_IMAGE_SIDE;
use crate::region_args::{TypedRegion, parse_region};
use crate::scene_args::SceneArgs;
use crate::state::color::parse_color;
use crate::state::{Camera, Classification, ClipPlane, Crop, Curve, Integration, Technique, TwoSidedEmphasis};

/// Shows the boundaries in a volume by its voxels' roles.
#[derive(Debug, Parser)]
#[command(name = "voxrole-view", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Cli {
    /// What to do; without a command, a window opens on FILE.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Packed file to open in a window; a volume that is not packed is prepared first.
    #[arg(required = true, value_name = "FILE")]
    pub file: Option<PathBuf>,
    /// Session to open the window with.
    #[arg(long, value_name = "FILE.toml")]
    pub session: Option<PathBuf>,
    /// What draws.
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Memory that the volume takes at most, such as 8GiB; the finest level of detail comes in parts where it takes more and a GPU
    /// draws, and is not shown where the CPU does; it also bounds preparing one that is not packed [default: half of the
    /// machine's].
    #[arg(long, value_name = "SIZE", value_parser = byte_size)]
    pub memory: Option<u64>,
    /// Layout of a headerless volume.
    #[command(flatten)]
    pub raw: RawArgs,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Draw one picture into a PNG file.
    Render(Box<RenderArgs>),
    /// Measure how far pictures are from one of many samples, and what they take: by step, with opacity integrated along it or not.
    Bench(Box<BenchArgs>),
    /// Do the main job from end to end, on a phantom or on a volume: packed file, report, histograms, slices, picture.
    Demo(DemoArgs),
}

/// What `demo` takes.
#[derive(Clone, Debug, Args)]
pub struct DemoArgs {
    /// Volume to prepare; without one, a phantom of three balls is made.
    #[arg(value_name = "VOLUME")]
    pub input: Option<PathBuf>,
    /// Folder for everything that is made.
    #[arg(short, long, value_name = "FOLDER", default_value = "voxrole-demo")]
    pub output: PathBuf,
    /// Layout of a headerless volume.
    #[command(flatten)]
    pub raw: RawArgs,
}

/// What `render` takes.
#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    /// Packed file; a volume that is not packed is prepared first.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// PNG file to write, or animated PNG of a turntable.
    #[arg(short, long, value_name = "OUT.png|OUT.apng")]
    pub output: PathBuf,
    /// Write all settings, proposed regions included, as a session.
    #[arg(long, value_name = "FILE.toml")]
    pub save_session: Option<PathBuf>,
    /// Turn once around the volume in so many pictures, named OUT-000.png and so on [default for an animation: 36].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub frames: Option<u32>,
    /// Pictures of an animation shown each second [default: 25].
    #[arg(long, value_name = "N", value_parser = parse_per_second)]
    pub fps: Option<f32>,
    /// Bits of a channel; 16 are drawn on the CPU.
    #[arg(long, value_enum, default_value = "8")]
    pub bits: Bits,
    /// Leave the background out: opacity becomes the picture's alpha. Drawn on the CPU.
    #[arg(long)]
    pub transparent: bool,
    /// Write how far from the camera half of the light is stopped, in world units along each pixel's ray, NaN where it is not,
    /// as numpy's array. Drawn on the CPU.
    #[arg(long, value_name = "OUT.npy")]
    pub depth: Option<PathBuf>,
    /// Where the volume is sampled: along rays, on slices across the viewing direction, or on stacks of slices across
    /// the nearest axis of the grid [default: rays].
    #[arg(long, value_enum, hide_possible_values = true, value_name = "rays|slices|stacks")]
    pub technique: Option<Technique>,
    /// Distance between samples along a ray, or between slices, in multiples of the smallest voxel spacing; where opacity
    /// is integrated by role, rays are cut at the borders of cells, and between into pieces of half of it at most [default:
    /// 0.5].
    #[arg(long, value_name = "F", value_parser = parse_step)]
    pub step: Option<f32>,
    /// What a sample says of the step that it stands for: its middle (post) or all of it (pre); with `--classify value`
    /// pre goes by a table of one axis, pre-2d by one for every front and back [default: pre].
    #[arg(long, value_enum, hide_possible_values = true, value_name = "post|pre|pre-2d")]
    pub integration: Option<Integration>,
    /// How much darker places are that lie among much else that is drawn, as creases and insides do, 0 to 1 [default: 0].
    #[arg(long, value_name = "F", value_parser = parse_share)]
    pub occlusion: Option<f32>,
    /// What draws.
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Begin rays at places of their own within the first step: what long steps miss shows as grain, not as rings. Only
    /// with `--integration post` or `--classify value|stored`: rays that are integrated by role miss nothing, and slices
    /// lie as they do.
    #[arg(long)]
    pub jitter: bool,
    /// Take every sample: leap over nothing, end no ray early. The picture is the same.
    #[arg(long)]
    pub no_skip: bool,
    /// Say how long drawing took and how many samples it needed, on a GPU along rays through a volume that it has all of; what
    /// the volume takes of a GPU; and of a volume that stays in its file, how many bricks were unpacked.
    #[arg(long)]
    pub stats: bool,
    /// What is drawn.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Layout of a headerless volume.
    #[command(flatten)]
    pub raw: RawArgs,
}

/// What is drawn, by `render` and `bench`.
#[derive(Clone, Debug, Args)]
pub struct ViewArgs {
    /// Session to start from, as the window or --save-session wrote it; options given here go before it.
    #[arg(long, value_name = "FILE.toml")]
    pub session: Option<PathBuf>,
    /// Width and height in pixels [default: 1024x1024, and 256x256 for bench].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<ImageSize>,
    /// Where to look from: degrees around z and above the xy plane, or front, back, left, right, top, bottom, iso; then
    /// a magnification, and a turn of the picture. 0,0 looks along +y with z up: at the face of a patient.
    #[arg(long, value_name = "AZIMUTH,ELEVATION[,ZOOM[,ROLL]]", allow_hyphen_values = true)]
    pub camera: Option<Camera>,
    /// Opacity by distance to the boundary: linear, concave or convex, the opacity on the boundary itself, the
    /// distance where it ends in multiples of the smallest voxel spacing, and the exponent; another one behind a slash is
    /// that of the side with lower values.
    #[arg(long, value_name = "KIND,a,dc,n[/KIND,a,dc,n]")]
    pub alpha: Option<TwoSidedEmphasis>,
    /// Draw the boundaries with these values and gradient magnitudes in this colour; may be given several times.
    /// Without any, regions are proposed from the histogram and printed in this form. Behind an @ stands the opacity by
    /// distance of this region alone, as for --alpha. In front may stand `ellipse,` or `triangle,`; `polygon,v:g,v:g,v:g,...,RRGGBB`
    /// names its corners, and `map:FILE.png,` a picture of weights, value to the right and gradient magnitude upwards: its
    /// opacities, or where all is opaque its grey levels, white the largest.
    #[arg(
        long = "region",
        value_name = "[SHAPE,]v0:v1,g0:g1,RRGGBB[,opacity[,softness]][@KIND,a,dc,n]",
        value_parser = parse_region,
        allow_hyphen_values = true
    )]
    pub regions: Vec<TypedRegion>,
    /// What decides: the voxels' roles, that is regions and curve at boundaries; the curve's value alone, everywhere,
    /// as in classical volume rendering; or intensity and opacity as a file of two numbers a voxel has them [default:
    /// roles].
    #[arg(long, value_enum, hide_possible_values = true, value_name = "roles|value|stored")]
    pub classify: Option<Classification>,
    /// Opacity and colour by value alone, whatever the gradient magnitude: control points with straight lines between them.
    #[arg(long, value_name = "v,RRGGBB,opacity;...", allow_hyphen_values = true)]
    pub curve: Option<Curve>,
    /// Draw these voxels alone; an end that is left out cuts nothing.
    #[arg(long, value_name = "x0:x1,y0:y1,z0:z1", allow_hyphen_values = true)]
    pub crop: Option<Crop>,
    /// Cut away what lies in front of a plane that faces a viewer at these angles; the offset is that from the volume's middle
    /// towards the viewer, in radii of the volume, 0 where none is given. Up to four times.
    #[arg(long = "clip", value_name = "AZIMUTH,ELEVATION[,OFFSET]", allow_hyphen_values = true)]
    pub planes: Vec<ClipPlane>,
    /// Leave out the planes that a session cuts with.
    #[arg(long, conflicts_with = "planes", requires = "session")]
    pub no_clip: bool,
    /// Level of detail to draw: 0 is the volume itself, each further one has every second voxel of the one before.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub level: usize,
    /// Memory that the volume takes at most, such as 8GiB; of a larger one parts are read when they are seen, by which a GPU
    /// draws it, also one that the CPU stands in for; it also bounds preparing one that is not packed [default: half of the
    /// machine's].
    #[arg(long, value_name = "SIZE", value_parser = byte_size)]
    pub memory: Option<u64>,
    /// Colour behind the volume [default: 000000].
    #[arg(long, value_name = "RRGGBB", value_parser = parse_background)]
    pub background: Option<Background>,
    /// What is drawn beside the volume.
    #[command(flatten)]
    pub scene: SceneArgs,
}

/// What `bench` takes.
#[derive(Clone, Debug, Args)]
pub struct BenchArgs {
    /// Packed file; a volume that is not packed is prepared first.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Folder for the table and the plots; made if there is none.
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    /// What is drawn; without a size, 256x256.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Layout of a headerless volume.
    #[command(flatten)]
    pub raw: RawArgs,
}

/// Bits of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Bits {
    /// What screens show.
    #[value(name = "8")]
    Eight,
    /// For further work on the picture.
    #[value(name = "16")]
    Sixteen,
}

/// Pixels to the right and down.
pub type ImageSize = [u32; 2];
/// A colour as display values.
pub type Background = [f32; 3];

/// The command line's description, for man pages and tests.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

fn parse_size(text: &str) -> Result<ImageSize, String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=MAX_IMAGE_SIDE).contains(side));
    let size = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    size.ok_or_else(|| format!("not WxH such as 800x600, each from 1 to {MAX_IMAGE_SIDE}"))
}

fn parse_step(text: &str) -> Result<f32, String> {
    let [low, high] = Frame::STEP_RANGE;
    text.parse().ok().filter(|step| (low..=high).contains(step)).ok_or_else(|| format!("not between {low} and {high}"))
}

fn parse_per_second(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|count| (1.0..=240.0).contains(count)).ok_or_else(|| "not between 1 and 240".to_owned())
}

fn parse_share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|share| (0.0..=1.0).contains(share)).ok_or_else(|| "not between 0 and 1".to_owned())
}

fn parse_background(text: &str) -> Result<Background, String> {
    parse_color(text).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn render(arguments: &[&str]) -> Result<RenderArgs, clap::Error> {
        let all = ["voxrole-view", "render", "a.vxr", "-o", "a.png"].iter().chain(arguments);
        Cli::try_parse_from(all).map(|cli| match cli.command {
            Some(Command::Render(render)) => *render,
            _ => panic!("the command was given"),
        })
    }

    #[test]
    fn the_description_is_sound() {
        command().debug_assert();
    }

    #[test]
    fn a_file_alone_opens_the_window() {
        let cli = Cli::try_parse_from(["voxrole-view", "a.vxr"]).expect("is understood");
        assert_eq!((cli.file, cli.command.is_none()), (Some("a.vxr".into()), true));
        assert!(Cli::try_parse_from(["voxrole-view"]).is_err());
    }

    #[test]
    fn what_draws_is_chosen_for_the_window_and_for_render() {
        let cli =
            Cli::try_parse_from(["voxrole-view", "a.vxr", "--gpu", "--gpu-memory", "1MiB"]).expect("is understood");
        assert_eq!(cli.device, DeviceArgs { gpu_memory: Some(1 << 20), normals: None, cpu: false, gpu: true });
        let device = render(&["--cpu"]).expect("is understood").device;
        assert_eq!([true, false].map(|gpu_is_cpu| device.wants_cpu(gpu_is_cpu)), [true; 2]);
        assert_eq!([true, false].map(|gpu_is_cpu| DeviceArgs::default().wants_cpu(gpu_is_cpu)), [true, false]);
        assert!(!cli.device.wants_cpu(true));
        assert!(render(&["--cpu", "--gpu"]).is_err() && render(&["--cpu", "--gpu-memory", "1MiB"]).is_err());
    }

    #[test]
    fn all_of_render_s_options_are_understood() {
        let render = render(&[
            "--size",
            "80x60",
            "--camera",
            "-30,10,2",
            "--alpha",
            "linear,0.1,15,1",
            "--region",
            "-1000:200,5:10,FF0000,0.2",
            "--region",
            "200:900,10:90,00FF00",
            "--step",
            "0.5",
            "--background",
            "ffffff",
            "--cpu",
        ])
        .expect("is understood");
        assert_eq!((render.view.size, render.step, render.device.cpu), (Some([80, 60]), Some(0.5), true));
        assert_eq!(render.view.background, Some([1.0; 3]));
        assert_eq!(render.view.camera.expect("a camera").azimuth, -30.0);
        assert_eq!(render.view.regions.len(), 2);
        assert_eq!(render.view.regions[0].read().expect("a region").value, [-1000.0, 200.0]);
    }

    #[test]
    fn a_session_s_planes_can_be_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cut.toml");
        std::fs::write(&path, "[clipping]\nplanes = [\"30,0,0.1\"]\n").expect("writes");
        let session = path.to_str().expect("Unicode");
        let planes = |options: &[&str]| {
            let arguments = render(&[&["--session", session], options].concat()).expect("is understood");
            crate::headless::typed_state(&arguments.view).expect("a session").clipping.planes.len()
        };
        assert_eq!([planes(&[]), planes(&["--no-clip"])], [1, 0]);
        assert!(
            render(&["--no-clip"]).is_err() && render(&["--session", session, "--no-clip", "--clip", "1,2"]).is_err()
        );
    }

    #[test]
    fn wrong_values_are_refused_with_the_reason() {
        for (wrong, reason) in [
            (["--size", "0x10"], "800x600"),
            (["--size", "99999x10"], "800x600"),
            (["--step", "0"], "between"),
            (["--step", "nan"], "between"),
            (["--occlusion", "1.1"], "between 0 and 1"),
            (["--camera", "up"], "front"),
            (["--alpha", "concave,2,3,3"], "between 0 and 1"),
            (["--region", "1:2"], "v0:v1"),
            (["--background", "red"], "hexadecimal"),
        ] {
            let message = render(&wrong).expect_err("is refused").to_string();
            assert!(message.contains(reason), "{message}");
        }
    }
}
