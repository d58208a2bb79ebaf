"""Sizes and speeds of codecs and of the stages before them, on the bricks of packed files; needs numpy, zstandard and lz4.

    python codecs.py FILE.vxr...

Every layer of the finest level is cut into its bricks, as stored numbers. The stages: `plain` numbers as they are, `planes`
their bytes sorted by place, `differences` from the number before in zigzag form and then planes; `masked` keeps only the voxels
with a boundary, to which the masks have to be added. Speeds are of the codec alone, in bytes of numbers, on one thread.
"""

import sys
import time

import lz4.block
import numpy
import vxr_reader
import zstandard


def zstd(level):
    packer, unpacker = zstandard.ZstdCompressor(level=level), zstandard.ZstdDecompressor()
    return packer.compress, unpacker.decompress


CODECS = {
    "zstd -1": zstd(-1),
    "zstd 1": zstd(1),
    "zstd 3": zstd(3),
    "zstd 6": zstd(6),
    "zstd 12": zstd(12),
    "lz4": (lz4.block.compress, lz4.block.decompress),
    "lz4 hc": (lambda data: lz4.block.compress(data, mode="high_compression"), lz4.block.decompress),
}


def planes(numbers):
    return numpy.ascontiguousarray(numbers.reshape(-1).view("u1").reshape(-1, numbers.itemsize).T)


def differences(numbers):
    signed = numbers.reshape(-1).view(f"i{numbers.itemsize}")
    steps = numpy.diff(signed, prepend=signed.dtype.type(0))
    return planes((steps << 1) ^ (steps >> (8 * numbers.itemsize - 1)))


STAGES = {"plain": lambda numbers: numbers, "planes": planes, "differences": differences}


def bricks(file, layer):
    """Numbers of each brick that are not all the same, and which of them have a boundary."""
    stored, bits = file.stored(layer.kind), file.mask()
    for place in file.brick_slices(0):
        numbers = numpy.ascontiguousarray(stored[place])
        if (numbers != numbers.flat[0]).any():
            yield numbers, bits[place]


def measure(codec, parts):
    pack, unpack = codec
    start = time.perf_counter()
    packed = [pack(part) for part in parts]
    packing = time.perf_counter() - start
    start = time.perf_counter()
    for part in packed:
        unpack(part)
    return sum(map(len, packed)), packing, time.perf_counter() - start


def rows(file, layer):
    cut = list(bricks(file, layer))
    voxels = numpy.prod(file.header.dims)
    variants = {"": [numbers for numbers, _ in cut]}
    if layer.kind in ("distance", "hit-gradient", "normal"):
        variants["masked "] = [numbers[bits] for numbers, bits in cut if bits.any()]
    for variant, numbers in variants.items():
        for stage, prepare in STAGES.items():
            if stage == "differences" and layer.scalar.kind == "f":
                continue
            parts = [prepare(part).tobytes() for part in numbers]
            for name, codec in CODECS.items():
                total = sum(map(len, parts))
                size, packing, unpacking = measure(codec, parts)
                yield variant + stage, name, size / voxels, total / packing / 1e6, total / unpacking / 1e6


def main():
    for path in sys.argv[1:]:
        file = vxr_reader.open_file(path)
        for layer in file.header.layers:
            print(f"\n{path}, {layer.kind}, {layer.scalar.name}\n")
            print("| stage | codec | bytes per voxel | pack, MB/s | unpack, MB/s |\n|---|---|---|---|---|")
            for stage, codec, size, packing, unpacking in rows(file, layer):
                print(f"| {stage} | {codec} | {size:.3f} | {packing:.0f} | {unpacking:.0f} |")


main()
