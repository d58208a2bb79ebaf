"""Reads packed files (.vxr), written from crates/pack/SPEC.md alone; needs numpy and zstandard.

    file = vxr_reader.open_file("volume.vxr")
    file.header.dims, file.level_dims(1)
    stored = file.stored("distance", level=1)       # numpy array [z][y][x] of stored numbers
    distance = file.physical("distance", level=1)   # NaN where there is none; normals are [z][y][x][3]
    file.mask(level=1), file.masked(level=1), file.histogram("v-g")

Opening checks prologue, header, directory and extents; whatever reads bricks checks those. What must not be read raises
`Refused`; `read_everything` reads every brick and histogram.
"""

import dataclasses
import itertools
import math
import struct
import typing
import zlib
from pathlib import Path

import numpy
import zstandard

MAGIC = bytes.fromhex("89 56 58 52 0D 0A 1A 0A")
VERSION = 1
PROLOGUE_BYTES = 64
ENTRY_BYTES = 40
MAX_HEADER_BYTES = 1 << 20
BRICK = 32

# Limits of this reader, far above what its machine can hold.
MAX_VOXELS = 1 << 36
MAX_BINS = 1 << 26
MAX_WINDOW = 1 << 23

KINDS = ["value", "distance", "hit-gradient", "normal", "gradient-magnitude", "second-derivative"]
HISTOGRAM_KINDS = ["v-g", "v-f2", "v-hit", "hit-hit", "distance"]
FRAMES = ["unspecified", "left-posterior-superior"]
SCALARS = [numpy.dtype(name) for name in ["u1", "i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"]]
U8, I8, U16, I16, F32 = (SCALARS[code] for code in [0, 1, 2, 3, 6])
BIN = numpy.dtype("<u8")

CONSTANT, RAW, ZSTD, DIFFERENCES, SPARSE = range(5)
ZSTD_MAGIC = bytes.fromhex("28 B5 2F FD")
# A few bytes of a frame make at most some blocks of 128 KiB, so output is held against what is expected early on.
FRAME_STEP = 64

NO_DIRECTION = 0x8080
NO_RANGE = b"\xff" * 16


class Refused(ValueError):
    """The file is damaged or none of this version."""


def require(condition, reason):
    if not condition:
        raise Refused(reason)


@dataclasses.dataclass
class Linear:
    slope: float
    intercept: float

    def physical(self, stored):
        return self.slope * stored.astype(numpy.float64) + self.intercept


@dataclasses.dataclass
class Distance:
    d_max: float
    steps: int

    def physical(self, stored):
        distance = stored.astype(numpy.float32) * (numpy.float32(self.d_max) / numpy.float32(self.steps))
        return numpy.where(has_boundary(stored), distance, numpy.float32(numpy.nan))


@dataclasses.dataclass
class HitGradient:
    low: float
    high: float
    steps: int

    def physical(self, stored):
        share = (stored.astype(numpy.float32) - numpy.float32(1.0)) / numpy.float32(self.steps)
        span = numpy.float32(self.high) - numpy.float32(self.low)
        # In double precision the product is exact, so that, but for rare ties, all is rounded once.
        gradient = (share.astype(numpy.float64) * numpy.float64(span) + self.low).astype(numpy.float32)
        return numpy.where(stored > 0, gradient, numpy.float32(numpy.nan))


@dataclasses.dataclass
class Octahedral:
    def physical(self, stored):
        one = numpy.float32(1.0)
        x, y = (byte.astype(numpy.float32) / numpy.float32(127.0) for byte in signed_bytes(stored))
        z = one - abs(x) - abs(y)
        folded_x = (one - abs(y)) * numpy.where(x < 0, -one, one)
        folded_y = (one - abs(x)) * numpy.where(y < 0, -one, one)
        x, y = numpy.where(z < 0, folded_x, x), numpy.where(z < 0, folded_y, y)
        reciprocal = one / numpy.sqrt(x * x + y * y + z * z)
        normal = numpy.stack([x * reciprocal, y * reciprocal, z * reciprocal], axis=-1)
        normal[stored == NO_DIRECTION] = numpy.nan
        return normal


def signed_bytes(stored):
    return (stored & 0xFF).astype(numpy.uint8).view(numpy.int8), (stored >> 8).astype(numpy.uint8).view(numpy.int8)


def has_boundary(stored):
    return stored > numpy.iinfo(stored.dtype).min + 1


@dataclasses.dataclass
class Layer:
    kind: str
    scalar: numpy.dtype
    quantization: typing.Any
    error_bound: float

    def none(self):
        """The number that sparse bricks leave out; None for layers that are never sparse."""
        lowest = numpy.iinfo(self.scalar).min if self.scalar.kind in "iu" else 0
        return {"distance": lowest, "hit-gradient": 0, "normal": NO_DIRECTION}.get(self.kind)


@dataclasses.dataclass
class Axis:
    low: float
    high: float
    bins: int


@dataclasses.dataclass
class HistogramShape:
    kind: str
    axes: list


@dataclasses.dataclass
class Header:
    made_by: str
    source_name: str
    voxels_sha256: bytes
    dims: tuple
    spacing: tuple
    origin: tuple
    direction: numpy.ndarray
    unit: str
    frame: str
    levels: int
    parameters: list
    value_range: tuple
    max_gradient: float
    hits: int
    misses: int
    masked: int
    layers: list
    histograms: list


@dataclasses.dataclass
class Entry:
    offset: int
    length: int
    crc: int
    range: tuple
    encoding: int
    constant: bytes


class Fields:
    """Takes the header's fields one after the other."""

    def __init__(self, data):
        self.data = data
        self.at = 0

    def take(self, count):
        require(count <= len(self.data) - self.at, "the header ends early")
        self.at += count
        return self.data[self.at - count : self.at]

    def numbers(self, layout):
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def number(self, layout):
        return self.numbers(layout)[0]

    def string(self):
        try:
            return self.take(self.number("Q")).decode("utf-8")
        except UnicodeDecodeError:
            raise Refused("a string is not UTF-8") from None

    def items(self, read):
        """A list; every item takes bytes, so that a count that is too large ends at the header's end."""
        return [read() for _ in range(self.number("Q"))]

    def code(self, names):
        code = self.number("I")
        require(code < len(names), "unknown code of an enum")
        return names[code]

    def finish(self):
        require(self.at == len(self.data), "the header ends late")


def read_header(data):
    fields = Fields(data)
    header = Header(
        made_by=fields.string(),
        source_name=fields.string(),
        voxels_sha256=fields.take(32),
        dims=fields.numbers("3I"),
        spacing=fields.numbers("3d"),
        origin=fields.numbers("3d"),
        direction=numpy.array(fields.numbers("9d")).reshape(3, 3),
        unit=fields.string(),
        frame=fields.code(FRAMES),
        levels=fields.number("I"),
        parameters=fields.items(lambda: (fields.string(), fields.string())),
        value_range=fields.numbers("2d"),
        max_gradient=fields.number("d"),
        hits=fields.number("Q"),
        misses=fields.number("Q"),
        masked=fields.number("Q"),
        layers=fields.items(lambda: read_layer(fields)),
        histograms=fields.items(lambda: read_shape(fields)),
    )
    fields.finish()
    check_header(header)
    return header


def read_layer(fields):
    kind = fields.code(KINDS)
    scalar = fields.code(SCALARS)
    quantization = fields.code([Linear, Distance, HitGradient, Octahedral])
    layout = {Linear: "dd", Distance: "fH", HitGradient: "ffH", Octahedral: ""}[quantization]
    return Layer(kind, scalar, quantization(*fields.numbers(layout)), fields.number("d"))


def read_shape(fields):
    kind = fields.code(HISTOGRAM_KINDS)
    return HistogramShape(kind, fields.items(lambda: Axis(*fields.numbers("ddI"))))


def check_header(header):
    require(min(header.dims) > 0, "an axis of 0 voxels")
    require(math.prod(header.dims) <= MAX_VOXELS, "more voxels than this reader's limit")
    require(all(0.0 < spacing < math.inf for spacing in header.spacing), "spacing is not positive and finite")
    require(numpy.isfinite(header.origin).all(), "the origin is not finite")
    products = header.direction @ header.direction.T
    require((abs(products - numpy.identity(3)) <= 1e-3).all(), "directions are not orthonormal")
    require(1 <= header.levels <= 16, "no level or more than 16")
    kinds = [layer.kind for layer in header.layers]
    require(len(set(kinds)) == len(kinds), "a kind of layer is there twice")
    for layer in header.layers:
        require(layer_is_possible(layer), f"type and quantization do not go with the layer {layer.kind}")
        require(quantization_is_possible(layer.quantization), f"impossible quantization of the layer {layer.kind}")
        require(0.0 <= layer.error_bound < math.inf, "an error bound is negative or not finite")
    kinds = [shape.kind for shape in header.histograms]
    require(len(set(kinds)) == len(kinds), "a kind of histogram is there twice")
    for shape in header.histograms:
        check_shape(shape)


def check_shape(shape):
    require(len(shape.axes) == (1 if shape.kind == "distance" else 2), "a histogram with other than the axes of its kind")
    require(all(-math.inf < axis.low < axis.high < math.inf for axis in shape.axes), "impossible ends of a histogram's axis")
    bins = math.prod(axis.bins for axis in shape.axes)
    require(0 < bins <= MAX_BINS, "a histogram without bins, or with more than this reader's limit")


def layer_is_possible(layer):
    quantization = layer.quantization
    match layer.kind, quantization:
        case "value", Linear():
            return True
        case "distance", Distance():
            return 126 <= quantization.steps <= 32766 and layer.scalar == (I8 if quantization.steps == 126 else I16)
        case "hit-gradient", HitGradient():
            return 254 <= quantization.steps <= 65534 and layer.scalar == (U8 if quantization.steps == 254 else U16)
        case "normal", Octahedral():
            return layer.scalar == U16
        case ("gradient-magnitude" | "second-derivative"), Linear(slope=1.0, intercept=0.0):
            return layer.scalar == F32
    return False


def quantization_is_possible(quantization):
    match quantization:
        case Linear(slope, intercept):
            return slope != 0.0 and math.isfinite(slope) and math.isfinite(intercept)
        case Distance(d_max):
            return 0.0 < d_max < math.inf
        case HitGradient(low, high):
            return 0.0 <= low <= high < math.inf
    return True


def read_entry(data):
    offset, length, crc, low, high, encoding = struct.unpack_from("<QIIddB", data)
    require(encoding <= SPARSE, "an entry has an unknown encoding")
    require(data[33:] == bytes(7), "bytes of an entry that must be 0 are not")
    if encoding == CONSTANT:
        require(length == 0 and crc == 0, "an entry of a constant has stored bytes")
    if data[16:32] == NO_RANGE:
        return Entry(offset, length, crc, None, encoding, data[:8])
    require(low <= high, "an entry's smallest value is above its largest, or one is NaN")
    return Entry(offset, length, crc, (low, high), encoding, data[:8])


def unpack_frame(stored, expected):
    """The content of the zstd frame in front, which must be so many bytes, and what is behind it; stops soon after it has got
    more."""
    require(stored[:4] == ZSTD_MAGIC, "no zstd frame")
    decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW).decompressobj()
    parts, length, at = [], 0, 0
    try:
        while not decompressor.eof and at < len(stored):
            parts.append(decompressor.decompress(stored[at : at + FRAME_STEP]))
            at += FRAME_STEP
            length += len(parts[-1])
            require(length <= expected, "data unpack to another length")
    except zstandard.ZstdError as error:
        raise Refused(f"a zstd frame is damaged: {error}") from None
    require(decompressor.eof, "not a whole zstd frame")
    require(length == expected, "data unpack to another length")
    return b"".join(parts), decompressor.unused_data + stored[at:]


def unpack_planes(stored, scalar, count):
    """Numbers whose byte planes are a frame each."""
    planes = []
    for _ in range(scalar.itemsize):
        plane, stored = unpack_frame(stored, count)
        planes.append(plane)
    require(not stored, "bytes behind the zstd frames")
    matrix = numpy.frombuffer(b"".join(planes), numpy.uint8).reshape(scalar.itemsize, -1)
    return numpy.ascontiguousarray(matrix.T).reshape(-1).view(scalar)


def undo_differences(numbers):
    if numbers.dtype.kind not in "iu" or numbers.dtype.itemsize > 4:
        return numbers
    unsigned = numbers.view(f"<u{numbers.dtype.itemsize}")
    differences = numpy.where(unsigned % 2 == 0, unsigned // 2, ~(unsigned // 2))
    return numpy.cumsum(differences, dtype=unsigned.dtype).view(numbers.dtype)


def unpack_constant(entry, scalar, count):
    require(not any(entry.constant[scalar.itemsize :]), "bytes behind a constant that must be 0 are not")
    return numpy.full(count, numpy.frombuffer(entry.constant, scalar, 1)[0])


def unpack_numbers(entry, stored, scalar, count):
    """Numbers of an entry that is not sparse; `stored` are its bytes."""
    if entry.encoding == CONSTANT:
        return unpack_constant(entry, scalar, count)
    if entry.encoding == RAW:
        require(len(stored) == count * scalar.itemsize, "data have another length")
        return numpy.frombuffer(stored, scalar)
    numbers = unpack_planes(stored, scalar, count)
    return numbers if entry.encoding == ZSTD else undo_differences(numbers)


def unpack_sparse(entry, stored, layer, bits):
    require(bits is not None, "a sparse brick without a mask")
    none = layer.none()
    require(none is not None, f"the layer {layer.kind} is never sparse")
    numbers = numpy.full(len(bits), none, layer.scalar)
    numbers[bits] = undo_differences(unpack_planes(stored, layer.scalar, int(bits.sum())))
    return numbers


def open_file(path):
    return PackedFile(Path(path).read_bytes())


class PackedFile:
    def __init__(self, data):
        self.data = data
        header_extent, directory_extent = self._read_prologue()
        self.header = read_header(self._checked(*header_extent, "header"))
        self.layers = {layer.kind: layer for layer in self.header.layers}
        self._read_directory(directory_extent)
        self._check_extents(header_extent, directory_extent)

    def _read_prologue(self):
        prologue = self.data[:PROLOGUE_BYTES]
        require(len(prologue) == PROLOGUE_BYTES and prologue[:8] == MAGIC, "no packed file")
        require(struct.unpack_from("<I", prologue, 8) == (VERSION,), "another version")
        require(zlib.crc32(prologue[:60]) == struct.unpack_from("<I", prologue, 60)[0], "the prologue's checksum is wrong")
        require(prologue[12:16] == prologue[56:60] == bytes(4), "bytes of the prologue that must be 0 are not")
        require(struct.unpack_from("<Q", prologue, 16) == (len(self.data),), "another length than the prologue's")
        header_extent, directory_extent = struct.unpack_from("<QII", prologue, 24), struct.unpack_from("<QII", prologue, 40)
        require(header_extent[1] <= MAX_HEADER_BYTES, "the header is too long")
        return header_extent, directory_extent

    def _checked(self, offset, length, crc, what):
        require(offset + length <= len(self.data), f"{what} beyond the file's end")
        data = self.data[offset : offset + length]
        require(zlib.crc32(data) == crc, f"{what}: the checksum is wrong")
        return data

    def _brick_lists(self):
        """What the directory lists bricks of, in order: (level, "mask" or a layer's kind)."""
        kinds = (["mask"] if "distance" in self.layers else []) + list(self.layers)
        return [(level, kind) for level in range(self.header.levels) for kind in kinds]

    def _read_directory(self, extent):
        lists = self._brick_lists()
        counts = [math.prod(self._bricks_along(level)) for level, _ in lists]
        total = sum(counts) + len(self.header.histograms)
        require(extent[1] == ENTRY_BYTES * total, "the directory's length is not that of its entries")
        data = self._checked(*extent, "directory")
        entries = iter([read_entry(data[at : at + ENTRY_BYTES]) for at in range(0, len(data), ENTRY_BYTES)])
        self.entries = {key: list(itertools.islice(entries, count)) for key, count in zip(lists, counts)}
        self.histogram_entries = list(entries)
        self._check_entries()

    def _check_entries(self):
        for (_, kind), entries in self.entries.items():
            if kind in ["mask", "normal"]:
                require(all(entry.range is None for entry in entries), f"an entry of the {kind} has a range of values")
        for entry in self.histogram_entries:
            require(entry.encoding in [CONSTANT, RAW, ZSTD], "an entry of a histogram has an unknown encoding")
            require(entry.range is None, "an entry of a histogram has a range of values")

    def all_entries(self):
        return itertools.chain(*self.entries.values(), self.histogram_entries)

    def _check_extents(self, *last):
        stored = [(entry.offset, entry.length) for entry in self.all_entries() if entry.encoding != CONSTANT]
        end = PROLOGUE_BYTES
        for offset, length in sorted(stored) + [extent[:2] for extent in last]:
            require(offset == end, "extents leave gaps or overlap")
            end += length
        require(end == len(self.data), "extents do not fill the file")

    def _bricks_along(self, level):
        return [-(-n // BRICK) for n in self.level_dims(level)]

    def level_dims(self, level):
        """Voxels of a level along x, y, z."""
        return [-(-n // (1 << level)) for n in self.header.dims]

    def level_spacing(self, level):
        return [spacing * (1 << level) for spacing in self.header.spacing]

    def brick_slices(self, level):
        """Slices [z][y][x] of a level's bricks, in the directory's order."""
        cuts = [[slice(at, min(at + BRICK, n)) for at in range(0, n, BRICK)] for n in self.level_dims(level)]
        return [(z, y, x) for z in cuts[2] for y in cuts[1] for x in cuts[0]]

    def _brick_bits(self, level, brick, count):
        """The bits of a brick's mask, or None in a file without distances."""
        if (level, "mask") not in self.entries:
            return None
        entry = self.entries[level, "mask"][brick]
        require(entry.encoding != SPARSE, "a mask is never sparse")
        data = unpack_numbers(entry, self._stored_bytes(entry), U8, -(-count // 8))
        bits = numpy.unpackbits(data, bitorder="little").astype(bool)
        require(not bits[count:].any(), "a mask has bits behind its last voxel")
        return bits[:count]

    def _stored_bytes(self, entry):
        if entry.encoding == CONSTANT:
            return b""
        return self._checked(entry.offset, entry.length, entry.crc, "brick")

    def _brick_numbers(self, level, brick, count, layer):
        entry = self.entries[level, layer.kind][brick]
        stored = self._stored_bytes(entry)
        if entry.encoding == SPARSE:
            return unpack_sparse(entry, stored, layer, self._brick_bits(level, brick, count))
        return unpack_numbers(entry, stored, layer.scalar, count)

    def _assemble(self, level, scalar, brick_numbers):
        result = numpy.empty(self.level_dims(level)[::-1], scalar)
        for brick, slices in enumerate(self.brick_slices(level)):
            view = result[slices]
            view[...] = brick_numbers(brick, view.size).reshape(view.shape)
        return result

    def stored(self, kind, level=0):
        """A layer's stored numbers [z][y][x]."""
        layer = self.layers[kind]
        return self._assemble(level, layer.scalar, lambda brick, count: self._brick_numbers(level, brick, count, layer))

    def physical(self, kind, level=0):
        """A layer's physical values [z][y][x], NaN where there is none; normals [z][y][x][3] in grid axes.

        The value is in double precision, all else in single.
        """
        return self.layers[kind].quantization.physical(self.stored(kind, level))

    def mask(self, level=0):
        """Where voxels have a boundary, [z][y][x]; only in a file with distances."""
        return self._assemble(level, bool, lambda brick, count: self._brick_bits(level, brick, count))

    def masked(self, level=0):
        """Where the stencil held NaN or infinity, [z][y][x]; only in a file with distances."""
        stored = self.stored("distance", level)
        return stored == numpy.iinfo(stored.dtype).min + 1

    def histogram(self, kind):
        """Counts of a histogram, [second axis][first axis] or [axis]."""
        index = [shape.kind for shape in self.header.histograms].index(kind)
        return self._histogram(index)

    def _histogram(self, index):
        entry, shape = self.histogram_entries[index], self.header.histograms[index]
        bins = [axis.bins for axis in shape.axes][::-1]
        return unpack_numbers(entry, self._stored_bytes(entry), BIN, math.prod(bins)).reshape(bins)

    def read_everything(self):
        for level, kind in self.entries:
            self.mask(level) if kind == "mask" else self.stored(kind, level)
        for index in range(len(self.histogram_entries)):
            self._histogram(index)
