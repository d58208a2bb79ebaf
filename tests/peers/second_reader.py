#!/usr/bin/env python3
"""Reads what voxrole packs with a second reader, written from crates/pack/SPEC.md alone, and compares all that both can say.

Needs numpy, zstandard and pynrrd, and a built `voxrole`:

    python3 tests/peers/second_reader.py target/release/voxrole

Small volumes of every type of number, with noise, NaN, an oblique grid, a slope, one value, one layer of voxels, are packed with
all sorts of options. Of each file:

- the header against `voxrole info --json` and against the input: its SHA-256, and the stored values number for number;
- every layer and mask on every level against level 0, and level 0 against `voxrole export`, to the exact float;
- the ranges in the directory, the counts in the header and the histograms against the layers, and the histograms against
  `voxrole histogram`;
- error bounds against the description's, and distances of few bits against those of 16.

The same holds for crates/pack/tests/data/v1_ball.vxr, whatever program made it. Then damage: that file with one bit of each byte
flipped, and cut at each length, must be refused; files that other programs might make of its parts must be read by both readers,
and ones that break one of the description's rules, with right checksums, by none.
Prints a line for each file; exits with 1 where anything disagrees.
"""

import argparse
import csv
import dataclasses
import hashlib
import json
import struct
import subprocess
import sys
import tempfile
import typing
from pathlib import Path

import nrrd
import numpy
import zstandard

import vxr_forge
import vxr_reader

SCALAR_NAMES = dict(zip(vxr_reader.SCALARS, ["u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64"]))
EXPORTED_FRAMES = {"unspecified": "Unspecified", "left-posterior-superior": "LeftPosteriorSuperior"}
AT_VOXELS = {"v-g": "gradient-magnitude", "v-f2": "second-derivative"}
NORMAL_BOUND = 0.0166
LARGEST_WINDOW = 8 << 20
KEPT = Path(__file__).parents[2] / "crates/pack/tests/data/v1_ball.vxr"


class Disagreement(Exception):
    pass


def agree(condition, what):
    if not condition:
        raise Disagreement(what)


def same_floats(ours, theirs):
    """Equal to the last bit, or both NaN."""
    return ours.shape == theirs.shape and bool(((ours == theirs) | (numpy.isnan(ours) & numpy.isnan(theirs))).all())


@dataclasses.dataclass
class Volume:
    """A volume to pack with so many bits: `make` writes it into a folder, and gives its path and its voxels [z][y][x]."""

    name: str
    make: typing.Callable
    options: list
    bits: typing.Optional[int] = None


class Program:
    def __init__(self, path, folder):
        self.path = path
        self.folder = folder

    def run(self, *arguments):
        command = [str(part) for part in (self.path, *arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        agree(done.returncode == 0, f"{' '.join(command)}: {done.stderr.strip()}")
        return done.stdout

    def phantom(self, name, *options):
        path = self.folder / f"{name}.nrrd"
        self.run("phantom", *options, "-o", path)
        return path, read_nrrd(path)

    def pack(self, volume, name, options, bits):
        path = self.folder / f"{name}.vxr"
        precision = [] if bits is None else ["--precision", bits]
        self.run("prepare", volume, *options, *precision, "-o", path)
        return path

    def info(self, path):
        return json.loads(self.run("info", "--json", path))

    def export(self, path, field):
        self.run("export", "--field", field, path, "-o", self.folder / "field.nrrd")
        return read_nrrd(self.folder / "field.nrrd")

    def histogram(self, path, kind):
        self.run("histogram", "--kind", kind, path, "-o", self.folder / "histogram.csv")
        with open(self.folder / "histogram.csv", newline="") as file:
            return list(csv.reader(file))[1:]

    def verifies(self, data):
        path = self.folder / "forged.vxr"
        path.write_bytes(data)
        return subprocess.run([str(self.path), "verify", str(path)], capture_output=True).returncode == 0


def read_nrrd(path):
    return nrrd.read(str(path))[0].T


def soft_ball(shape):
    z, y, x = numpy.meshgrid(*[numpy.linspace(-1.0, 1.0, n) for n in shape], indexing="ij")
    return 1.0 / (1.0 + numpy.exp(20.0 * (numpy.sqrt(x * x + y * y + z * z) - 0.6)))


def oblique_with_holes(folder):
    """f64 on an oblique grid in millimetres, with a box of NaN, an infinity, and the largest value beside a NaN."""
    voxels = soft_ball((34, 37, 41))
    voxels[3:6, 10:14, 20:30] = numpy.nan
    voxels[20, 20, 20] = numpy.inf
    voxels[4, 12, 30] = 9.0
    c, s = numpy.cos(0.3), numpy.sin(0.3)
    turned = numpy.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ numpy.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    header = {
        "space": "left-posterior-superior",
        "space directions": turned * numpy.array([[0.5], [0.7], [1.25]]),
        "space origin": [3.5, -20.0, 7.0],
        "space units": ["mm"] * 3,
    }
    nrrd.write(str(folder / "oblique.nrrd"), voxels.T.copy(), header=header)
    return folder / "oblique.nrrd", voxels


def one_value(folder):
    voxels = numpy.full((10, 20, 33), 7, numpy.uint8)
    nrrd.write(str(folder / "constant.nrrd"), voxels.T.copy())
    return folder / "constant.nrrd", voxels


def with_slope(folder):
    """NIfTI-1 of i16 with a slope, an intercept and a left-handed grid."""
    voxels = (soft_ball((20, 35, 33)) * 3000.0 - 500.0).astype("<i2")
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *voxels.shape[::-1], 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)
    struct.pack_into("<4f", header, 76, 1.0, 0.5, 0.7, 1.25)
    struct.pack_into("<3f", header, 108, 352.0, 0.37, -7.1)
    header[123] = 2
    struct.pack_into("<2h", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, -0.5, 0, 0, 10, 0, -0.7, 0, -5, 0, 0, 1.25, 3)
    header[344:348] = b"n+1\0"
    (folder / "slope.nii").write_bytes(bytes(header) + voxels.tobytes())
    return folder / "slope.nii", voxels


def volumes(program):
    def phantom(name, options, pack, bits=None):
        return Volume(name, lambda _: program.phantom(name, *options.split()), pack.split(), bits)

    return [
        phantom("noisy", "three-balls --dims 45,38,33 --dtype u8 --noise 0.02", "--levels 3 --keep derivatives"),
        phantom("anisotropic", "shells --dims 67,41,35 --dtype i16 --spacing 0.7,1,2.5", "", 12),
        phantom("one-level", "torus --dims 40,37,34 --dtype f32", "--levels 1", 16),
        phantom("twelve-bits", "slabs --dims 38,45,50 --dtype u12", "--levels 2", 8),
        phantom("i8", "ball --dims 33,20,12 --dtype i8", "--levels 16"),
        phantom("u16", "ball --dims 33,20,12 --dtype u16 --noise 0.3", "--method fast"),
        phantom("u32", "ball --dims 33,20,12 --dtype u32", "--levels 2 --keep derivatives"),
        phantom("i32", "ball --dims 33,20,12 --dtype i32", "--method paper --levels 2 --keep derivatives"),
        phantom("f64", "ball --dims 33,20,12 --dtype f64 --value-offset -0.25", "--dmax 3"),
        phantom("thin", "ball --dims 40,36,1 --dtype f32", "--levels 4 --keep derivatives"),
        Volume("oblique", oblique_with_holes, "--levels 3 --keep derivatives".split()),
        Volume("slope", with_slope, "--levels 2 --keep derivatives".split()),
        Volume("constant", one_value, "--levels 2 --keep derivatives".split()),
    ]


def check_info(file, info):
    header = file.header
    geometry, statistics = info["geometry"], info["statistics"]
    pairs = {
        "made_by": (header.made_by, info["made_by"]),
        "source": ((header.source_name, header.voxels_sha256.hex()), tuple(info["source"].values())),
        "dims": (list(header.dims), geometry["dims"]),
        "spacing": (list(header.spacing), geometry["spacing"]),
        "origin": (list(header.origin), geometry["origin"]),
        "direction": (header.direction.tolist(), geometry["direction"]),
        "unit": (header.unit, geometry["unit"]),
        "frame": (EXPORTED_FRAMES[header.frame], geometry["frame"]),
        "levels": (header.levels, info["levels"]),
        "parameters": (dict(header.parameters), info["parameters"]),
        "value_range": (list(header.value_range), statistics["value_range"]),
        "max_gradient": (header.max_gradient, statistics["max_gradient"]),
        "hits": (header.hits, statistics["hits"]),
        "misses": (header.misses, statistics["misses"]),
        "masked": (header.masked, statistics["masked"]),
        "layers": ([layer_info(file, layer) for layer in header.layers], info["layers"]),
        "histograms": ([shape_info(shape) for shape in header.histograms], info["histograms"]),
        "file_bytes": (len(file.data), info["file_bytes"]),
    }
    for name, (ours, theirs) in pairs.items():
        agree(ours == theirs, f"{name} is {ours}, by `info` {theirs}")


def layer_info(file, layer):
    name, fields = type(layer.quantization).__name__, vars(layer.quantization)
    entries = [entry for (_, kind), entries in file.entries.items() if kind == layer.kind for entry in entries]
    return {
        "error_bound": layer.error_bound,
        "kind": layer.kind,
        "quantization": {name: fields} if fields else name,
        "stored_bytes": sum(entry.length for entry in entries),
        "type": SCALAR_NAMES[layer.scalar],
    }


def shape_info(shape):
    return {"axes": [{"bins": axis.bins, "high": axis.high, "low": axis.low} for axis in shape.axes], "kind": shape.kind}


def check_input(file, voxels):
    agree(hashlib.sha256(numpy.ascontiguousarray(voxels).tobytes()).digest() == file.header.voxels_sha256, "the input's SHA-256")
    agree(file.header.dims == voxels.shape[::-1], "the input's dimensions")
    stored = file.stored("value")
    agree(stored.dtype == voxels.dtype and stored.tobytes() == voxels.tobytes(), "stored values are not the input's")
    physical = file.physical("value")
    finite = physical[numpy.isfinite(physical)]
    agree(file.header.value_range == (finite.min(), finite.max()), "smallest and largest value")


def check_levels(file):
    for level in range(file.header.levels):
        step = 1 << level
        for kind in file.layers:
            ours, of_level_0 = file.stored(kind, level), file.stored(kind)[::step, ::step, ::step]
            agree(ours.tobytes() == of_level_0.tobytes(), f"{kind} on level {level} is not that of level 0")
        agree((file.mask(level) == file.mask()[::step, ::step, ::step]).all(), f"mask on level {level}")


def check_hits(file):
    """Masks, numbers for none and counts go together."""
    header, mask, masked = file.header, file.mask(), file.masked()
    agree((mask == vxr_reader.has_boundary(file.stored("distance"))).all(), "mask and distances")
    agree((mask == (file.stored("hit-gradient") > 0)).all(), "mask and gradient magnitudes at the hit")
    agree((mask == (file.stored("normal") != vxr_reader.NO_DIRECTION)).all(), "mask and normals")
    counts = (int(mask.sum()), int((~mask & ~masked).sum()), int(masked.sum()))
    agree(counts == (header.hits, header.misses, header.masked), f"counts are {counts}")
    for kind in AT_VOXELS.values():
        if kind in file.layers:
            agree((numpy.isnan(file.stored(kind)) == masked).all(), f"NaN in {kind}")


def check_exports(program, path, file):
    for kind in file.layers:
        physical = file.physical(kind)
        if kind == "normal":
            ours = physical.astype(numpy.float64) @ file.header.direction
            theirs = program.export(path, kind)
        else:
            ours, theirs = physical, program.export(path, kind)
        agree(same_floats(ours.astype(theirs.dtype), theirs), f"{kind} is not what `export` says")
    roles, distance = program.export(path, "role"), file.physical("distance")
    agree(((roles == -1) == file.masked()).all(), "masked voxels by role")
    agree(((roles == 0) == (~file.mask() & ~file.masked())).all(), "voxels without a boundary by role")
    agree((distance[roles == 2] > 0).all() and (distance[roles == 3] < 0).all(), "sides by role")


def check_ranges(file):
    for (level, kind), entries in file.entries.items():
        if kind in ["mask", "normal"]:
            continue
        physical = file.physical(kind, level)
        for entry, slices in zip(entries, file.brick_slices(level)):
            finite = physical[slices][numpy.isfinite(physical[slices])]
            expected = (finite.min(), finite.max()) if finite.size else None
            agree(entry.range == expected, f"range of {kind} on level {level}: {entry.range} instead of {expected}")


def check_histograms(program, path, file):
    header = file.header
    for shape in header.histograms:
        counts = file.histogram(shape.kind)
        expected = header.hits + header.misses if shape.kind in AT_VOXELS else header.hits
        agree(int(counts.sum()) == expected, f"{shape.kind} counts {counts.sum()} voxels instead of {expected}")
        agree((counts == counts_of_table(shape, program.histogram(path, shape.kind))).all(), f"{shape.kind} by `histogram`")
        if AT_VOXELS.get(shape.kind) in file.layers:
            agree((counts == recount(file, shape)).all(), f"{shape.kind} is not that of its layers")


def counts_of_table(shape, rows):
    """Counts of a table with centre, low and high for each axis, then the count."""
    counts = numpy.zeros([axis.bins for axis in shape.axes][::-1], numpy.uint64)
    for row in rows:
        centres = [float(row[3 * index]) for index in range(len(shape.axes))]
        bins = [int((centre - axis.low) / (axis.high - axis.low) * axis.bins) for centre, axis in zip(centres, shape.axes)]
        counts[tuple(bins[::-1])] += int(row[-1])
    return counts


def recount(file, shape):
    counted = ~file.masked()
    bins = []
    for axis, kind in zip(shape.axes, ["value", AT_VOXELS[shape.kind]]):
        physical = file.physical(kind)[counted].astype(numpy.float64)
        numbers = numpy.floor((physical - axis.low) / (axis.high - axis.low) * axis.bins).astype(int)
        bins.append(numpy.where(physical == axis.high, axis.bins - 1, numbers))
    counts = numpy.zeros([axis.bins for axis in shape.axes][::-1], numpy.uint64)
    numpy.add.at(counts, tuple(bins[::-1]), 1)
    return counts


def check_bounds(file, bits):
    distance, hit = file.layers["distance"], file.layers["hit-gradient"]
    d_max, span = distance.quantization.d_max, hit.quantization.high - hit.quantization.low
    expected = {
        "value": 0.0,
        "distance": 1.02 * d_max / (2**bits - 4),
        "hit-gradient": span / (2 ** (bits + 1) - 4) + 3.0 * 2.0**-23 * hit.quantization.high,
        "normal": NORMAL_BOUND,
        "gradient-magnitude": 0.0,
        "second-derivative": 0.0,
    }
    for kind, layer in file.layers.items():
        agree(abs(layer.error_bound - expected[kind]) <= 1e-6 * expected[kind], f"error bound of {kind}: {layer.error_bound}")
    steps = (distance.quantization.steps, hit.quantization.steps)
    agree(steps == (2 ** (bits - 1) - 2, 2**bits - 2), f"steps {steps} for {bits} bits")
    gradients = [file.physical(kind) for kind in ["hit-gradient", "gradient-magnitude"] if kind in file.layers]
    largest = max(numpy.nan_to_num(gradient).max() for gradient in gradients)
    agree(largest <= file.header.max_gradient * (1.0 + 1e-6), "largest gradient magnitude")
    if len(gradients) == 2:
        agree(largest >= file.header.max_gradient * (1.0 - 1e-6), "largest gradient magnitude, at voxels and at hits")


def check_precision(file, precise):
    """The same volume by more bits: the same hits, and numbers within both bounds."""
    agree((file.mask() == precise.mask()).all(), "hits depend on the precision")
    agree((file.stored("normal") == precise.stored("normal")).all(), "normals depend on the precision")
    for kind in ["distance", "hit-gradient"]:
        apart = numpy.nanmax(abs(file.physical(kind).astype(numpy.float64) - precise.physical(kind)))
        bound = file.layers[kind].error_bound + precise.layers[kind].error_bound
        agree(apart <= bound, f"{kind} is {apart} off that of 16 bits, more than {bound}")


def check_windows(file):
    for entry in file.all_entries():
        if entry.encoding >= vxr_reader.ZSTD:
            parameters = zstandard.get_frame_parameters(file.data[entry.offset : entry.offset + entry.length])
            agree(parameters.window_size <= LARGEST_WINDOW, f"a window of {parameters.window_size} bytes")


def check_file(program, path, file, bits):
    file.read_everything()
    check_info(file, program.info(path))
    check_levels(file)
    check_hits(file)
    check_exports(program, path, file)
    check_ranges(file)
    check_histograms(program, path, file)
    check_bounds(file, bits)
    check_windows(file)


def check_volume(program, volume):
    source, voxels = volume.make(program.folder)
    path = program.pack(source, volume.name, volume.options, volume.bits)
    file = vxr_reader.open_file(path)
    check_file(program, path, file, volume.bits or 16)
    check_input(file, voxels)
    if volume.bits in [8, 12]:
        precise = program.pack(source, f"{volume.name}-precise", volume.options, 16)
        check_precision(file, vxr_reader.open_file(precise))
    return describe(file)


def check_kept(program, file):
    check_file(program, KEPT, file, 16)
    return describe(file)


def describe(file):
    header = file.header
    dims = " x ".join(map(str, header.dims))
    encodings = [entry.encoding for entry in file.all_entries()]
    used = ", ".join(f"{encodings.count(code)} of {code}" for code in sorted(set(encodings)))
    hits = f"{header.hits} hits, {header.masked} masked"
    return f"{dims} {SCALAR_NAMES[file.layers['value'].scalar]}, {header.levels} levels, {hits}; encodings: {used}"


def is_refused(data):
    try:
        vxr_reader.PackedFile(data).read_everything()
    except vxr_reader.Refused:
        return True
    return False


def check_damage(data):
    agree(not is_refused(data), "the file is refused before it is damaged")
    for at in range(len(data)):
        flipped = bytearray(data)
        flipped[at] ^= 1 << at % 8
        agree(is_refused(bytes(flipped)), f"bit {at % 8} of byte {at} is flipped, and nobody sees it")
    for length in range(len(data)):
        agree(is_refused(data[:length]), f"cut to {length} bytes, and nobody sees it")
    return f"{len(data)} flipped bits and {len(data)} cuts are refused"


def check_forged(program, file):
    counts = []
    for files, expected in [(vxr_forge.sound(file), True), (vxr_forge.unsound(file), False)]:
        counts.append(0)
        for name, data in files:
            counts[-1] += 1
            agree(is_refused(data) != expected, f"{name}: this reader's answer")
            agree(program.verifies(data) == expected, f"{name}: `verify`'s answer")
    return f"{counts[0]} sound files are read by both readers, {counts[1]} unsound ones by none"


def check_all(program):
    failures = 0

    def report(name, check):
        nonlocal failures
        try:
            print(f"{name:12} {check()}", flush=True)
        except (Disagreement, vxr_reader.Refused) as error:
            failures += 1
            print(f"{name:12} DISAGREES: {error}", flush=True)

    for volume in volumes(program):
        report(volume.name, lambda: check_volume(program, volume))
    kept = vxr_reader.open_file(KEPT)
    report("kept", lambda: check_kept(program, kept))
    report("damage", lambda: check_damage(kept.data))
    report("forged", lambda: check_forged(program, kept))
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("voxrole", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        failures = check_all(Program(options.voxrole, Path(folder)))
    if failures:
        sys.exit(f"{failures} of the above disagree")


if __name__ == "__main__":
    main()
