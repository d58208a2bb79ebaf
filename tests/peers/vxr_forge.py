"""Packed files (.vxr) that other programs might make, and ones that nobody may make, all with right checksums.

`Parts` takes a packed file apart and builds it again with new offsets, lengths and checksums. `sound(file)` and `unsound(file)`
give pairs of a name and the bytes of a file; the latter each break one rule of crates/pack/SPEC.md that a reader must watch.
Both want a file that has a value, distances, gradient magnitudes at the hit, normals and histograms.
"""

import copy
import math
import struct
import zlib

import numpy
import zstandard

import vxr_reader

QUANTIZATIONS = [vxr_reader.Linear, vxr_reader.Distance, vxr_reader.HitGradient, vxr_reader.Octahedral]
NAN, INFINITY = math.nan, math.inf


def string(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<Q", len(data)) + data


def items(parts):
    parts = list(parts)
    return struct.pack("<Q", len(parts)) + b"".join(parts)


def code(names, name):
    """The code of a name; a number stands for itself, be it a code or not."""
    return struct.pack("<I", name if isinstance(name, int) else names.index(name))


def layer_bytes(layer):
    quantization = layer.quantization
    layout = {"Linear": "<dd", "Distance": "<fH", "HitGradient": "<ffH", "Octahedral": "<"}[type(quantization).__name__]
    return b"".join(
        [
            code(vxr_reader.KINDS, layer.kind),
            code(vxr_reader.SCALARS, layer.scalar),
            code(QUANTIZATIONS, type(quantization)),
            struct.pack(layout, *vars(quantization).values()),
            struct.pack("<d", layer.error_bound),
        ]
    )


def shape_bytes(shape):
    axes = [struct.pack("<ddI", axis.low, axis.high, axis.bins) for axis in shape.axes]
    return code(vxr_reader.HISTOGRAM_KINDS, shape.kind) + items(axes)


def header_bytes(header):
    return b"".join(
        [
            string(header.made_by),
            string(header.source_name),
            header.voxels_sha256,
            struct.pack("<3I3d3d9d", *header.dims, *header.spacing, *header.origin, *numpy.ravel(header.direction)),
            string(header.unit),
            code(vxr_reader.FRAMES, header.frame),
            struct.pack("<I", header.levels),
            items(string(name) + string(value) for name, value in header.parameters),
            struct.pack("<3d3Q", *header.value_range, header.max_gradient, header.hits, header.misses, header.masked),
            items(map(layer_bytes, header.layers)),
            items(map(shape_bytes, header.histograms)),
        ]
    )


def planes(numbers):
    return numpy.ascontiguousarray(numbers.view(numpy.uint8).reshape(len(numbers), -1).T).tobytes()


def differences(numbers):
    """Of integers of up to 32 bits."""
    unsigned = numbers.view(f"<u{numbers.itemsize}")
    signed = numpy.diff(unsigned, prepend=unsigned.dtype.type(0)).view(f"<i{numbers.itemsize}")
    return numpy.where(signed >= 0, 2 * signed, -2 * signed - 1).astype(unsigned.dtype)


def frame(content, **options):
    return zstandard.ZstdCompressor(level=3, **options).compress(content)


def frames(numbers, **options):
    """Each byte plane of the numbers in a frame of its own."""
    content = planes(numbers)
    return b"".join(
        frame(content[index * len(numbers) : (index + 1) * len(numbers)], **options) for index in range(numbers.itemsize)
    )


class Piece:
    """One entry of the directory with its stored bytes and the numbers that they mean."""

    def __init__(self, name, entry, stored, numbers, bits):
        self.name = name
        self.encoding = entry.encoding
        self.constant = entry.constant
        self.low_high = vxr_reader.NO_RANGE if entry.range is None else struct.pack("<dd", *entry.range)
        self.zeros = bytes(7)
        self.stored = stored
        self.numbers = numbers
        self.bits = bits

    def entry_bytes(self, offset):
        if self.encoding == vxr_reader.CONSTANT:
            place = self.constant + bytes(8)
        else:
            place = struct.pack("<QII", offset, len(self.stored), zlib.crc32(self.stored))
        return place + self.low_high + bytes([self.encoding]) + self.zeros

    def store(self, encoding, stored):
        self.encoding, self.stored = encoding, stored

    def store_raw(self):
        self.store(vxr_reader.RAW, self.numbers.tobytes())

    def store_zstd(self, **options):
        self.store(vxr_reader.ZSTD, frames(self.numbers, **options))

    def store_differences(self):
        self.store(vxr_reader.DIFFERENCES, frames(differences(self.numbers)))

    def store_sparse(self):
        self.store(vxr_reader.SPARSE, frames(differences(self.numbers[self.bits])))

    def store_constant(self, constant):
        self.store(vxr_reader.CONSTANT, b"")
        self.constant = constant


class Parts:
    def __init__(self, file):
        self.header = copy.deepcopy(file.header)
        self.end_of_header = b""
        self.pieces = list(brick_pieces(file)) + list(histogram_pieces(file))
        self.version = vxr_reader.VERSION
        self.order = "bhd"
        self.backwards = False

    def piece(self, *name):
        return next(piece for piece in self.pieces if piece.name == name)

    def layer(self, kind):
        return next(layer for layer in self.header.layers if layer.kind == kind)

    def keep_layers(self, kinds):
        """Leaves those layers, in that order."""
        self.header.layers = [self.layer(kind) for kind in kinds]
        kept = ["mask"] * ("distance" in kinds) + list(kinds)
        levels = range(self.header.levels)
        bricks = [piece for level in levels for kind in kept for piece in self.pieces if piece.name[:2] == (level, kind)]
        self.pieces = bricks + [piece for piece in self.pieces if piece.name[0] == "histogram"]

    def build(self):
        header = header_bytes(self.header) + self.end_of_header
        offsets, bricks = self._place_bricks(64 + (len(header) if self.order[0] == "h" else 0))
        directory = b"".join(piece.entry_bytes(offset) for piece, offset in zip(self.pieces, offsets))
        parts = {"b": bricks, "h": header, "d": directory}
        body, extents = b"", {}
        for part in self.order:
            extents[part] = struct.pack("<QII", 64 + len(body), len(parts[part]), zlib.crc32(parts[part]))
            body += parts[part]
        prologue = vxr_reader.MAGIC + struct.pack("<IIQ", self.version, 0, 64 + len(body))
        prologue += extents["h"] + extents["d"] + bytes(4)
        return prologue + struct.pack("<I", zlib.crc32(prologue)) + body

    def _place_bricks(self, start):
        offsets, bricks = [0] * len(self.pieces), b""
        for index in reversed(range(len(self.pieces))) if self.backwards else range(len(self.pieces)):
            offsets[index] = start + len(bricks)
            if self.pieces[index].encoding != vxr_reader.CONSTANT:
                bricks += self.pieces[index].stored
        return offsets, bricks


def stored_bytes(file, entry):
    return b"" if entry.encoding == vxr_reader.CONSTANT else file.data[entry.offset : entry.offset + entry.length]


def brick_pieces(file):
    for (level, kind), entries in file.entries.items():
        numbers, mask = file.mask(level) if kind == "mask" else file.stored(kind, level), file.mask(level)
        for brick, (entry, slices) in enumerate(zip(entries, file.brick_slices(level))):
            ravelled = numbers[slices].ravel()
            if kind == "mask":
                ravelled = numpy.packbits(ravelled, bitorder="little")
            yield Piece((level, kind, brick), entry, stored_bytes(file, entry), ravelled, mask[slices].ravel())


def histogram_pieces(file):
    for shape, entry in zip(file.header.histograms, file.histogram_entries):
        yield Piece(("histogram", shape.kind), entry, stored_bytes(file, entry), file.histogram(shape.kind).ravel(), None)


def forged(file, edit):
    parts = Parts(file)
    edit(parts)
    return parts.build()


def sound(file):
    """Files that a reader must take."""
    first = {kind: (0, kind, 0) for kind in ["mask", *file.layers]}

    def without_histograms(parts):
        parts.header.histograms = []
        parts.pieces = [piece for piece in parts.pieces if piece.name[0] != "histogram"]

    def all_raw(parts):
        for piece in parts.pieces:
            piece.store_raw()

    def without_mask(parts):
        all_raw(parts)
        parts.keep_layers(["value", "hit-gradient", "normal"])

    def left_handed(parts):
        parts.header.direction[0] *= -1.0

    edits = {
        "nothing changed": lambda parts: None,
        "bricks backwards": lambda parts: setattr(parts, "backwards", True),
        "all raw": all_raw,
        "no histograms": without_histograms,
        "no layers": lambda parts: parts.keep_layers([]),
        "layers in another order": lambda parts: parts.keep_layers(["normal", "hit-gradient", "distance", "value"]),
        "value alone": lambda parts: parts.keep_layers(["value"]),
        "hits without distances": without_mask,
        "left-handed axes": left_handed,
        "no length in a zstd frame": lambda parts: parts.piece(*first["value"]).store_zstd(write_content_size=False),
        "checksum in a zstd frame": lambda parts: parts.piece(*first["value"]).store_zstd(write_checksum=True),
    }
    for kind in ["mask", "value", "distance", "hit-gradient", "normal"]:
        edits[f"{kind} as zstd"] = lambda parts, kind=kind: parts.piece(*first[kind]).store_zstd()
        edits[f"{kind} as differences"] = lambda parts, kind=kind: parts.piece(*first[kind]).store_differences()
    for kind in ["distance", "hit-gradient", "normal"]:
        edits[f"{kind} sparse"] = lambda parts, kind=kind: parts.piece(*first[kind]).store_sparse()
    for name, edit in edits.items():
        yield name, forged(file, edit)


def unsound(file):
    """Files that a reader must refuse."""
    yield from cut_or_overlapping(file)
    for name, edit in [*header_edits(), *layer_edits(), *histogram_edits(), *entry_edits(), *data_edits()]:
        yield name, forged(file, edit)


def cut_or_overlapping(file):
    data = forged(file, lambda parts: None)

    def with_length(data):
        prologue = data[:16] + struct.pack("<Q", len(data)) + data[24:60]
        return prologue + struct.pack("<I", zlib.crc32(prologue)) + data[64:]

    yield "last byte cut off", with_length(data[:-1])
    yield "a byte behind the end", with_length(data + b"\0")
    yield "prologue alone", with_length(data[:64])

    def share(parts):
        one, other = parts.piece("histogram", "v-g"), parts.piece("histogram", "v-f2")
        place = one.entry_bytes
        other.store(one.encoding, b"")
        other.entry_bytes = lambda offset: place(offset - len(one.stored))

    yield "two histograms share their bytes", forged(file, share)


def header_edits():
    def field(name, value):
        return lambda parts: setattr(parts.header, name, value)

    def direction(row, column, value):
        return lambda parts: parts.header.direction.__setitem__((row, column), value)

    def long(parts):
        parts.header.unit = "m" * vxr_reader.MAX_HEADER_BYTES

    for version in [0, 2]:
        yield f"version {version}", lambda parts, version=version: setattr(parts, "version", version)
    for order in ["hbd", "bdh"]:
        yield f"parts in the order {order}", lambda parts, order=order: setattr(parts, "order", order)
    yield "header ends late", lambda parts: setattr(parts, "end_of_header", b"\0")
    yield "header too long", long
    yield "unit not UTF-8", field("unit", b"\xff")
    yield "axis of 0 voxels", field("dims", (8, 0, 8))
    yield "a far larger volume", field("dims", (2**32 - 1,) * 3)
    for spacing in [0.0, -1.0, NAN, INFINITY]:
        yield f"spacing {spacing}", field("spacing", (1.0, spacing, 1.0))
    yield "origin NaN", field("origin", (0.0, NAN, 0.0))
    yield "axis too long", direction(0, 0, 1.001)
    yield "axes not at right angles", direction(0, 1, 0.002)
    yield "direction NaN", direction(2, 2, NAN)
    yield "unknown frame", field("frame", 2)
    for levels in [0, 1, 3, 17]:
        yield f"{levels} levels instead of 2", field("levels", levels)


def layer_edits():
    def of_layer(kind, name, value):
        return lambda parts: setattr(parts.layer(kind), name, value)

    def of_quantization(kind, name, value):
        return lambda parts: setattr(parts.layer(kind).quantization, name, value)

    def narrow(kind, scalar, steps):
        def edit(parts):
            parts.layer(kind).scalar = scalar
            parts.layer(kind).quantization.steps = steps

        return edit

    yield "unknown kind of layer", of_layer("value", "kind", 6)
    yield "unknown scalar type", of_layer("value", "scalar", 8)
    yield "a kind of layer twice", of_layer("normal", "kind", "value")
    yield "value with distance quantization", of_layer("value", "quantization", vxr_reader.Distance(1.0, 126))
    yield "value of another type", of_layer("value", "scalar", vxr_reader.F32)
    yield "normal of another type", of_layer("normal", "scalar", vxr_reader.I16)
    for steps in [0, 125, 126, 32767]:
        yield f"distance of i16 with {steps} steps", of_quantization("distance", "steps", steps)
    for steps in [125, 127]:
        yield f"distance of i8 with {steps} steps", narrow("distance", vxr_reader.I8, steps)
    for steps in [0, 253, 254, 65535]:
        yield f"hit gradient of u16 with {steps} steps", of_quantization("hit-gradient", "steps", steps)
    for steps in [253, 255]:
        yield f"hit gradient of u8 with {steps} steps", narrow("hit-gradient", vxr_reader.U8, steps)
    for bad in [NAN, INFINITY]:
        for kind, name in [("value", "slope"), ("value", "intercept"), ("distance", "d_max"), ("hit-gradient", "low")]:
            yield f"{name} {bad}", of_quantization(kind, name, bad)
        yield f"error bound {bad}", of_layer("distance", "error_bound", bad)
    yield "high infinite", of_quantization("hit-gradient", "high", INFINITY)
    yield "slope 0", of_quantization("value", "slope", 0.0)
    yield "d_max 0", of_quantization("distance", "d_max", 0.0)
    yield "d_max negative", of_quantization("distance", "d_max", -1.0)
    yield "low above high", of_quantization("hit-gradient", "low", 1e9)
    yield "low negative", of_quantization("hit-gradient", "low", -1.0)
    yield "error bound negative", of_layer("value", "error_bound", -1.0)


def histogram_edits():
    def of_axis(name, value):
        return lambda parts: setattr(parts.header.histograms[0].axes[0], name, value)

    def axes(count):
        return lambda parts: setattr(parts.header.histograms[0], "axes", [vxr_reader.Axis(0.0, 1.0, 1)] * count)

    def ends(low, high):
        def edit(parts):
            of_axis("low", low)(parts)
            of_axis("high", high)(parts)

        return edit

    yield "unknown kind of histogram", lambda parts: setattr(parts.header.histograms[0], "kind", 5)
    yield "histogram twice", lambda parts: setattr(parts.header.histograms[0], "kind", parts.header.histograms[1].kind)
    for count in [0, 1, 3]:
        yield f"histogram with {count} axes", axes(count)
    for bins in [0, 1, 2**32 - 1]:
        yield f"axis with {bins} bins", of_axis("bins", bins)
    for low, high in [(1.0, 1.0), (1.0, 0.0), (NAN, 1.0), (0.0, INFINITY)]:
        yield f"axis from {low} to {high}", ends(low, high)
    yield "shape of a histogram missing", lambda parts: parts.header.histograms.pop()


def entry_edits():
    def of_value(name, value):
        return lambda parts: setattr(parts.piece(0, "value", 0), name, value)

    def constant_with_bytes(parts):
        piece = parts.piece(0, "value", 0)
        piece.store_constant(bytes(8))
        piece.constant += b"\1"
        piece.entry_bytes = lambda _: piece.constant + bytes(7) + piece.low_high + bytes(8)

    yield "entry missing", lambda parts: parts.pieces.pop()
    yield "entry too many", lambda parts: parts.pieces.append(parts.pieces[-1])
    yield "unknown encoding", of_value("encoding", 5)
    for at in range(7):
        yield f"byte {33 + at} of an entry not 0", of_value("zeros", bytes(at) + b"\1" + bytes(6 - at))
    not_a_number = struct.pack("<d", NAN)
    ranges = {
        "smallest above largest": struct.pack("<dd", 2.0, 1.0),
        "smallest NaN": not_a_number + struct.pack("<d", 1.0),
        "largest NaN": struct.pack("<d", 1.0) + not_a_number,
        "both NaN, but not all FF": not_a_number * 2,
        "half of the range FF": vxr_reader.NO_RANGE[:8] + struct.pack("<d", 1.0),
    }
    for name, low_high in ranges.items():
        yield name, of_value("low_high", low_high)
    yield "bytes behind a constant", lambda parts: parts.piece(0, "value", 0).store_constant(bytes(7) + b"\1")
    yield "constant with stored bytes", constant_with_bytes


def data_edits():
    value, mask = (0, "value", 0), (0, "mask", 0)

    def store(name, encoding, make):
        def edit(parts):
            piece = parts.piece(*name)
            piece.store(encoding, make(piece))

        return edit

    def mask_with_last_bit(piece):
        content = bytearray(piece.numbers.tobytes())
        content[-1] |= 0x80
        return bytes(content)

    def without_mask(parts):
        parts.piece(0, "normal", 0).store_sparse()
        parts.keep_layers(["value", "normal"])

    def whole_mask_behind(parts):
        """The mask's last bits alone are wrong: all that hangs on it is stored without it."""
        for piece in parts.pieces:
            piece.store_raw()
        store((1, "mask", 0), vxr_reader.RAW, mask_with_last_bit)(parts)

    yield "raw too long", store(value, vxr_reader.RAW, lambda piece: piece.numbers.tobytes() + b"\0")
    yield "raw too short", store(value, vxr_reader.RAW, lambda piece: piece.numbers.tobytes()[1:])
    yield "raw of no bytes", store(value, vxr_reader.RAW, lambda piece: b"")
    for encoding in [vxr_reader.ZSTD, vxr_reader.DIFFERENCES]:
        yield f"encoding {encoding} too long", store(value, encoding, lambda piece: frames(numpy.append(piece.numbers, piece.numbers[:1])))
        yield f"encoding {encoding} too short", store(value, encoding, lambda piece: frames(piece.numbers[1:]))
        yield f"encoding {encoding} of 64 MiB", store(value, encoding, lambda piece: frame(bytes(1 << 26)))
        yield f"encoding {encoding} without a frame", store(value, encoding, lambda piece: planes(piece.numbers))
        yield f"encoding {encoding} cut", store(value, encoding, lambda piece: frames(piece.numbers)[:-1])
        yield f"encoding {encoding} and a byte", store(value, encoding, lambda piece: frames(piece.numbers) + b"\0")
        yield f"encoding {encoding} and a frame", store(value, encoding, lambda piece: frames(piece.numbers) + frame(b""))
    yield "sparse value", lambda parts: parts.piece(*value).store_sparse()
    yield "sparse mask", store(mask, vxr_reader.SPARSE, lambda piece: frame(piece.numbers.tobytes()))
    yield "sparse histogram", store(("histogram", "v-g"), vxr_reader.SPARSE, lambda piece: frames(piece.numbers))
    yield "sparse without a mask", without_mask
    yield "sparse with another mask", lambda parts: parts.piece(*mask).store_constant(bytes(8))
    yield "bits behind the mask's last voxel", whole_mask_behind
