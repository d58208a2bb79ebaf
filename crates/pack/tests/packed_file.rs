//! Whole packed files: round trips, and files that are damaged or lie.

use std::fs::{self, File};
use std::io::{Seek, SeekFrom, Write};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread;

use tempfile::TempDir;
use voxrole_pack::directory::{Encoding, Place};
use voxrole_pack::header::{Parameter, Source, Statistics};
use voxrole_pack::histogram::HistogramShape;
use voxrole_pack::layer::Quantization;
use voxrole_pack::prologue::{PROLOGUE_BYTES, Prologue};
use voxrole_pack::quantization::narrow_distance;
use voxrole_pack::writer::Description;
use voxrole_pack::{
    DistanceQuantization, Error, GridGeometry, Histogram, HistogramAxis, HistogramKind, HitGradientQuantization, Layer,
    LayerKind, Limits, Precision, Reader, ScalarType, Scalars, Writer, with_scalars,
};

const DIMS: [u32; 3] = [35, 34, 3];

struct Sample {
    scalars: Scalars,
    distance: Vec<i16>,
    hit_gradient: Vec<u16>,
    normal: Vec<u16>,
}

fn sample(scalar_type: ScalarType) -> Sample {
    let voxels = DIMS.iter().product::<u32>();
    let bytes: Vec<u8> = (0..voxels as usize * scalar_type.size_in_bytes())
        .map(|byte| (byte.wrapping_mul(2_654_435_761) >> 7) as u8 & 0x3f)
        .collect();
    Sample {
        scalars: Scalars::from_le_bytes(scalar_type, &bytes),
        distance: (0..voxels).map(|voxel| (voxel as i16).wrapping_mul(31)).collect(),
        hit_gradient: (0..voxels).map(|voxel| (voxel / 7) as u16).collect(),
        normal: vec![0x8080; voxels as usize],
    }
}

/// Numbers where there is a boundary and nowhere else, as a run writes them; one voxel is masked.
fn consistent_sample() -> Sample {
    let voxels = 0..DIMS.iter().product::<u32>();
    let is_hit = |voxel: &u32| voxel % 5 < 2 && *voxel > 40;
    let only = |number: fn(u32) -> u16, none: u16| {
        voxels.clone().map(|voxel| if is_hit(&voxel) { number(voxel) } else { none }).collect::<Vec<u16>>()
    };
    let distance = only(|voxel| (voxel * 31 % 20_000) as u16, i16::MIN as u16);
    let mut distance: Vec<i16> = distance.into_iter().map(|bits| bits as i16).collect();
    distance[40] = DistanceQuantization::MASKED;
    Sample {
        distance,
        hit_gradient: only(|voxel| 1 + voxel as u16, 0),
        normal: only(|voxel| voxel as u16 & 0x7f7f, 0x8080),
        ..sample(ScalarType::U16)
    }
}

/// Every `2^level`-th voxel along each axis.
fn every<T: Copy>(values: &[T], level: usize) -> Vec<T> {
    let [nx, ny, nz] = DIMS.map(|dim| dim as usize);
    let place = |i: usize, j: usize, k: usize| (k * ny + j) * nx + i;
    let step = 1 << level;
    let rows = (0..nz).step_by(step).flat_map(|k| (0..ny).step_by(step).map(move |j| (j, k)));
    rows.flat_map(|(j, k)| (0..nx).step_by(step).map(move |i| values[place(i, j, k)])).collect()
}

fn description() -> Description {
    Description {
        made_by: "test 1".into(),
        source: Source { name: "sample.nrrd".into(), voxels_sha256: [7; 32] },
        parameters: vec![Parameter { name: "step".into(), value: "0.2 L_min".into() }],
        statistics: Statistics { value_range: [0.0, 63.0], max_gradient: 5.0, hits: 1, misses: 2, masked: 3 },
    }
}

fn histogram() -> Histogram {
    let axis = HistogramAxis { low: -1.0, high: 1.0, bins: 10 };
    Histogram {
        shape: HistogramShape { kind: HistogramKind::ValueGradient, axes: vec![axis; 2] },
        counts: (0..100).collect(),
    }
}

fn write(path: &Path, sample: &Sample) -> u64 {
    let geometry = GridGeometry::axis_aligned(DIMS, [1.0, 1.0, 2.5]);
    let mut writer = Writer::create(path, geometry, 3).expect("creates");
    let linear = Quantization::Linear { slope: 2.0, intercept: -1.0 };
    with_scalars!(&sample.scalars, values => {
        let value = Layer::new(LayerKind::Value, sample.scalars.scalar_type(), linear);
        writer.write_layer(value, values).expect("writes");
    });
    let distance = Quantization::Distance(DistanceQuantization::new(15.0, Precision::default()));
    writer.write_layer(Layer::new(LayerKind::Distance, ScalarType::I16, distance), &sample.distance).expect("writes");
    let hit = Quantization::HitGradient(HitGradientQuantization::new(1.0, 2.0, Precision::default()));
    writer.write_layer(Layer::new(LayerKind::HitGradient, ScalarType::U16, hit), &sample.hit_gradient).expect("writes");
    let normal = Layer::new(LayerKind::Normal, ScalarType::U16, Quantization::Octahedral);
    writer.write_layer(normal, &sample.normal).expect("writes");
    writer.write_histograms(vec![histogram()]).expect("writes");
    writer.finish(description()).expect("finishes")
}

fn written(scalar_type: ScalarType) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sample.vxr");
    write(&path, &sample(scalar_type));
    (folder, path)
}

#[test]
fn every_type_survives_exactly() {
    for scalar_type in ScalarType::ALL {
        let (folder, path) = written(scalar_type);
        let expected = sample(scalar_type);
        let reader = Reader::open(&path).expect("opens");
        assert_eq!(reader.read_value().expect("reads"), (expected.scalars, 2.0, -1.0), "{}", scalar_type.name());
        assert_eq!(reader.read_layer::<i16>(LayerKind::Distance).expect("reads"), expected.distance);
        assert_eq!(reader.read_layer::<u16>(LayerKind::HitGradient).expect("reads"), expected.hit_gradient);
        assert_eq!(reader.read_layer::<u16>(LayerKind::Normal).expect("reads"), expected.normal);
        assert_eq!(reader.read_histogram(HistogramKind::ValueGradient).expect("reads"), histogram());
        assert_eq!(reader.header().parameters, description().parameters);
        assert_eq!(reader.header().statistics, description().statistics);
        assert_eq!(reader.verify().expect("is sound").bytes, fs::metadata(&path).expect("exists").len());
        let names: Vec<_> = fs::read_dir(folder.path()).expect("lists").collect();
        assert_eq!(names.len(), 1, "temporary files are left over: {names:?}");
    }
}

#[test]
fn levels_have_every_second_voxel_of_the_one_before() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sample.vxr");
    for expected in [sample(ScalarType::U16), consistent_sample()] {
        write(&path, &expected);
        let reader = Reader::open(&path).expect("opens");
        reader.verify().expect("is sound");
        let Scalars::U16(values) = &expected.scalars else { panic!("made so") };
        for level in 0..reader.levels() {
            let geometry = reader.geometry(level).expect("is there");
            assert_eq!(geometry.dims, DIMS.map(|dim| dim.div_ceil(1 << level)));
            assert_eq!(reader.read_value_level(level).expect("reads").0, Scalars::U16(every(values, level)));
            assert_eq!(reader.read_distance(level).expect("reads"), every(&expected.distance, level));
            assert_eq!(reader.read_hit_gradient(level).expect("reads"), every(&expected.hit_gradient, level));
            let normals = reader.read_level::<u16>(LayerKind::Normal, level).expect("reads");
            assert_eq!(normals, every(&expected.normal, level));
        }
        assert_eq!(reader.levels(), 3);
        assert!(reader.geometry(3).expect_err("is not there").to_string().contains("no level 3"));
    }
}

#[test]
fn hits_alone_are_stored_where_layers_agree() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sample.vxr");
    write(&path, &consistent_sample());
    let reader = Reader::open(&path).expect("opens");
    let encoding = |kind, brick| match reader.brick_entry(kind, 0, brick).expect("is there").place {
        Place::Stored(extent) => extent.encoding,
        Place::Constant(_) => Encoding::Constant,
    };
    // Distances of the brick that has the masked voxel, the second of the lowest row, have two numbers for none.
    assert_eq!(encoding(LayerKind::Distance, 0), Encoding::DeltaZstd);
    for kind in [LayerKind::HitGradient, LayerKind::Normal] {
        assert_eq!(encoding(kind, 0), Encoding::SparseZstd);
    }
    assert_eq!(encoding(LayerKind::Distance, 2), Encoding::SparseZstd);
}

#[test]
fn regions_and_bricks_are_parts_of_layers() {
    let (_folder, path) = written(ScalarType::U8);
    let (reader, expected) = (Reader::open(&path).expect("opens"), sample(ScalarType::U8));
    let [nx, ny, nz] = DIMS.map(|dim| dim as usize);
    for [x, y, z] in [[0..nx, 0..ny, 0..nz], [30..34, 31..33, 1..2], [34..35, 0..1, 2..3], [0..1, 33..34, 0..3]] {
        let region =
            reader.read_region::<i16>(LayerKind::Distance, 0, [x.clone(), y.clone(), z.clone()]).expect("reads");
        let rows = z.flat_map(|k| y.clone().map(move |j| (k * ny + j) * nx));
        let whole: Vec<i16> = rows.flat_map(|row| expected.distance[row + x.start..row + x.end].to_vec()).collect();
        assert_eq!(region, whole);
    }
    let brick = reader.read_brick::<u16>(LayerKind::Normal, 0, 3).expect("reads");
    assert_eq!(brick, vec![0x8080; 3 * 2 * 3]);
    for range in [[0..nx + 1, 0..1, 0..1], [0..1, 5..5, 0..1]] {
        assert!(matches!(reader.read_region::<i16>(LayerKind::Distance, 0, range), Err(Error::Parameter(_))));
    }
    assert!(matches!(reader.read_brick::<u16>(LayerKind::Normal, 0, 4), Err(Error::Parameter(_))));
}

#[test]
fn one_byte_holds_a_distance_and_a_gradient() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sample.vxr");
    let precision = Precision::new(8).expect("8 to 16");
    let voxels = DIMS.iter().product::<u32>() as i32;
    let codes = [DistanceQuantization::NO_BOUNDARY, DistanceQuantization::MASKED];
    let distance: Vec<i16> = (0..voxels)
        .map(|voxel| if voxel % 9 < 2 { codes[voxel as usize % 9] } else { (voxel % 253 - 126) as i16 })
        .collect();
    let magnitude: Vec<u8> = (0..voxels).map(|voxel| voxel as u8).collect();
    let mut writer = Writer::create(&path, GridGeometry::axis_aligned(DIMS, [1.0; 3]), 1).expect("creates");
    let quantization = Quantization::Distance(DistanceQuantization::new(15.0, precision));
    let layer = Layer::new(LayerKind::Distance, ScalarType::I16, quantization);
    assert!((layer.error_bound - 15.0 / 252.0).abs() < 0.002);
    writer.write_encoded_layer(layer, &distance, narrow_distance).expect("writes");
    let quantization = Quantization::HitGradient(HitGradientQuantization::new(1.0, 2.0, precision));
    writer.write_layer(Layer::new(LayerKind::HitGradient, ScalarType::U16, quantization), &magnitude).expect("writes");
    writer.finish(description()).expect("finishes");
    let reader = Reader::open(&path).expect("opens");
    reader.verify().expect("is sound");
    assert_eq!(reader.read_distance(0).expect("reads"), distance);
    let wide: Vec<u16> = magnitude.into_iter().map(u16::from).collect();
    assert_eq!(reader.read_hit_gradient(0).expect("reads"), wide);
}

#[test]
fn the_same_input_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = [1, 2, 7].map(|threads| {
        let path = folder.path().join(threads.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| write(&path, &sample(ScalarType::F32)));
        fs::read(path).expect("reads")
    });
    assert!(bytes.iter().all(|other| *other == bytes[0]));
}

#[test]
fn an_unfinished_file_leaves_nothing_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("unfinished.vxr");
    drop(Writer::create(&path, GridGeometry::axis_aligned(DIMS, [1.0; 3]), 1).expect("creates"));
    assert_eq!(fs::read_dir(folder.path()).expect("lists").count(), 0);
}

#[test]
fn what_is_not_there_is_said() {
    let (_folder, path) = written(ScalarType::U8);
    let reader = Reader::open(&path).expect("opens");
    let message = reader.read_layer::<f32>(LayerKind::SecondDerivative).expect_err("is missing").to_string();
    assert!(message.contains("second-derivative") && message.contains("--keep derivatives"), "{message}");
    let message = reader.read_layer::<f32>(LayerKind::Value).expect_err("is u8").to_string();
    assert!(message.contains("u8") && message.contains("f32"), "{message}");
    assert!(matches!(reader.read_histogram(HistogramKind::Distance), Err(Error::Parameter(_))));
    let missing = Reader::open(Path::new("no/such.vxr")).err().expect("fails");
    assert!(matches!(missing, Error::Io { .. }));
}

fn fails(bytes: &[u8], folder: &Path) -> Option<Error> {
    let path = folder.join("damaged.vxr");
    fs::write(&path, bytes).expect("writes");
    fault(&path)
}

fn fault(path: &Path) -> Option<Error> {
    Reader::open(path).and_then(|reader| reader.verify()).err()
}

#[test]
fn every_truncation_is_noticed() {
    let (folder, path) = written(ScalarType::U16);
    let whole = fs::read(&path).expect("reads");
    for len in (0..whole.len()).step_by(97).chain(whole.len() - 5..whole.len()) {
        assert!(matches!(fails(&whole[..len], folder.path()), Some(Error::Format(_))), "{len} of {}", whole.len());
    }
    let longer = [whole.as_slice(), &[0]].concat();
    assert!(matches!(fails(&longer, folder.path()), Some(Error::Format(_))));
}

#[test]
fn every_damaged_byte_is_noticed() {
    let (folder, path) = written(ScalarType::U8);
    let whole = fs::read(&path).expect("reads");
    for place in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[place] ^= 1 << (place % 8);
        assert!(fails(&damaged, folder.path()).is_some(), "byte {place} of {}", whole.len());
    }
}

#[test]
#[ignore = "takes minutes: `just single-byte-changes`"]
fn every_value_of_every_byte_of_a_stored_file_is_noticed() {
    let whole = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/v1_ball.vxr")).expect("reads");
    let parts = thread::available_parallelism().map_or(1, NonZero::get);
    let unnoticed_in = |part: usize| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("damaged.vxr");
        fs::write(&path, &whole).expect("writes");
        let file = File::options().write(true).open(&path).expect("opens");
        let put = |place: usize, value: u8| {
            (&file).seek(SeekFrom::Start(place as u64)).expect("seeks");
            (&file).write_all(&[value]).expect("writes");
        };
        let mut unnoticed = Vec::new();
        for place in (part..whole.len()).step_by(parts) {
            for value in (0..=u8::MAX).filter(|&value| value != whole[place]) {
                put(place, value);
                if fault(&path).is_none() {
                    unnoticed.push((place, value));
                }
            }
            put(place, whole[place]);
        }
        assert!(fault(&path).is_none(), "the file is whole again");
        unnoticed
    };
    let unnoticed: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..parts).map(|part| scope.spawn(move || unnoticed_in(part))).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("ends")).collect()
    });
    println!("{} changes, {} of them unnoticed", 255 * whole.len(), unnoticed.len());
    assert_eq!(unnoticed, []);
}

#[test]
fn damage_is_named() {
    let (folder, path) = written(ScalarType::U8);
    let mut bytes = fs::read(&path).expect("reads");
    let entry = Reader::open(&path).expect("opens").brick_entry(LayerKind::Distance, 0, 2).expect("is there");
    let Place::Stored(extent) = entry.place else { panic!("varies") };
    bytes[extent.offset as usize] ^= 1;
    let message = fails(&bytes, folder.path()).expect("is noticed").to_string();
    assert!(message.contains("brick 2 of layer `distance`") && message.contains("checksum"), "{message}");
    // And what else there is.
    let other = Reader::open(&path).expect("opens").brick_entry(LayerKind::Value, 0, 0).expect("is there");
    let Place::Stored(extent) = other.place else { panic!("varies") };
    bytes[extent.offset as usize] ^= 1;
    let message = fails(&bytes, folder.path()).expect("is noticed").to_string();
    assert!(message.starts_with("brick 0 of layer `value`"), "{message}");
    assert!(message.ends_with("; damaged too: brick 2 of layer `distance`; prepare the volume again"), "{message}");
}

/// Replaces bytes inside the header, or inside the directory, and makes all checksums right again.
fn forge(whole: &[u8], in_header: bool, from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    let mut start = [0; PROLOGUE_BYTES];
    start.copy_from_slice(&bytes[..PROLOGUE_BYTES]);
    let mut prologue = Prologue::from_bytes(&start).expect("is sound");
    let table = if in_header { &mut prologue.header } else { &mut prologue.directory };
    let range = table.offset as usize..table.offset as usize + table.bytes as usize;
    let place = bytes[range.clone()].windows(from.len()).position(|window| window == from).expect("is there");
    bytes[range.start + place..][..to.len()].copy_from_slice(to);
    table.crc32 = crc32fast::hash(&bytes[range]);
    bytes[..PROLOGUE_BYTES].copy_from_slice(&prologue.to_bytes());
    bytes
}

fn le(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

#[test]
fn lies_are_refused_before_memory_is_asked_for() {
    let (folder, path) = written(ScalarType::U8);
    let whole = fs::read(&path).expect("reads");
    let dims = le(&DIMS);
    let spacing = 2.5_f64.to_le_bytes();
    let d_max = 15.0_f32.to_le_bytes();
    let first_brick = [(PROLOGUE_BYTES as u64).to_le_bytes().as_slice()].concat();
    let name_length = [11_u64.to_le_bytes().as_slice(), b"sample.nrrd"].concat();
    // A kind, and the beginning of two axes.
    let histogram = |kind: u32| [le(&[kind, 2, 0]).as_slice(), &(-1.0_f64).to_le_bytes()].concat();
    let huge_length = [u64::MAX.to_le_bytes().as_slice(), b"sample.nrrd"].concat();
    for (what, in_header, from, to) in [
        ("dims 2^31", true, dims.as_slice(), le(&[1 << 31; 3])),
        ("dims of a terabyte", true, &dims, le(&[10_000; 3])),
        ("dims 0", true, &dims, le(&[35, 0, 3])),
        ("more bricks than the directory has", true, &dims, le(&[35, 34, 99])),
        ("negative spacing", true, &spacing, (-2.5_f64).to_le_bytes().to_vec()),
        ("spacing NaN", true, &spacing, f64::NAN.to_le_bytes().to_vec()),
        ("d_max 0", true, &d_max, 0_f32.to_le_bytes().to_vec()),
        ("a name of 2^64 bytes", true, &name_length, huge_length),
        ("bins 0", true, &le(&[10]), le(&[0])),
        ("distances over two axes", true, &histogram(0), histogram(4)),
        ("a brick elsewhere", false, &first_brick, 1_u64.to_le_bytes().to_vec()),
        ("a brick beyond the end", false, &first_brick, u64::MAX.to_le_bytes().to_vec()),
    ] {
        let error = fails(&forge(&whole, in_header, from, &to), folder.path());
        assert!(matches!(error, Some(Error::Format(_) | Error::LimitsExceeded { .. })), "{what}: {error:?}");
    }
}

/// Files of released versions open forever. What they hold was read by a second reader, too.
#[test]
fn files_of_version_1_are_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/v1_ball.vxr");
    let reader = Reader::open(&path).expect("opens");
    assert_eq!(reader.verify().expect("is sound").bytes, 5136);
    assert_eq!((reader.header().geometry.dims, reader.levels()), ([34, 5, 4], 2));
    assert_eq!(reader.header().statistics.hits, 123);
    let distance = reader.read_distance(0).expect("reads");
    assert_eq!(distance.iter().filter(|&&stored| stored > DistanceQuantization::MASKED).count(), 123);
    let crc32 = |bytes: &[u8]| crc32fast::hash(bytes);
    let (Scalars::U8(values), ..) = reader.read_value().expect("reads") else { panic!("u8") };
    let bytes = |numbers: Vec<u16>| numbers.into_iter().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    let found = [
        crc32(&values),
        crc32(&bytes(distance.into_iter().map(|stored| stored as u16).collect())),
        crc32(&bytes(reader.read_hit_gradient(0).expect("reads"))),
        crc32(&bytes(reader.read_layer(LayerKind::Normal).expect("reads"))),
    ];
    assert_eq!(found.map(|crc32| format!("{crc32:08x}")), ["d6a57b27", "486d5dea", "28cef69c", "fe88b5d8"]);
}

#[test]
fn limits_are_the_caller_s() {
    let (_folder, path) = written(ScalarType::U8);
    let limits = Limits { max_voxels: 100, ..Limits::default() };
    assert!(matches!(Reader::open_with(&path, &limits), Err(Error::LimitsExceeded { found: 3570, .. })));
}
