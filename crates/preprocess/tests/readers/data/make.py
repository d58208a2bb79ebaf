"""Writes the small volumes beside it with VTK, tifffile and zarr-python, all of them the same 60 numbers.

python3 -m venv peers && peers/bin/pip install numpy vtk tifffile imagecodecs zarr && peers/bin/python make.py
"""

import json
import shutil
from pathlib import Path

import numcodecs
import numpy as np
import tifffile
import vtk
import zarr
from vtk.util.numpy_support import numpy_to_vtk

HERE = Path(__file__).parent
NUMBERS = (np.arange(60, dtype=np.uint16) * 1000).reshape(5, 4, 3)
SPACING = (3.0, 2.0, 1.0)


def write_vti():
    image = vtk.vtkImageData()
    image.SetExtent(2, 4, 0, 3, 0, 4)
    image.SetSpacing(1.0, 2.0, 3.0)
    image.SetOrigin(10.0, 20.0, 30.0)
    image.SetDirectionMatrix((0, -1, 0, 1, 0, 0, 0, 0, 1))
    scalars = numpy_to_vtk(NUMBERS.ravel(), deep=True)
    scalars.SetName("density")
    image.GetPointData().SetScalars(scalars)
    other = numpy_to_vtk(np.zeros(60, np.float32), deep=True)
    other.SetName("other")
    image.GetPointData().AddArray(other)
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetBlockSize(32)
    for mode in ("Ascii", "Binary", "Appended"):
        for compressor in ("None", "ZLib", "LZ4", "LZMA"):
            for encoded in (False, True):
                if encoded and mode != "Appended" or compressor != "None" and mode == "Ascii":
                    continue
                getattr(writer, f"SetDataModeTo{mode}")()
                getattr(writer, f"SetCompressorTypeTo{compressor}")()
                writer.SetEncodeAppendedData(encoded)
                big = mode == "Binary"
                (writer.SetByteOrderToBigEndian if big else writer.SetByteOrderToLittleEndian)()
                (writer.SetHeaderTypeToUInt32 if big else writer.SetHeaderTypeToUInt64)()
                name = "_".join(["vtk", mode, compressor] + ["base64"] * encoded).lower()
                writer.SetFileName(str(HERE / f"{name}.vti"))
                writer.Write()


def write_tiff():
    imagej = {"imagej": True, "resolution": (1.0, 0.5), "metadata": {"spacing": 3.0, "unit": "um", "axes": "ZYX"}}
    tifffile.imwrite(HERE / "tifffile_imagej.tif", NUMBERS, **imagej)
    tifffile.imwrite(HERE / "tifffile_imagej_big_endian.tif", NUMBERS, byteorder=">", **imagej)
    tczyx = np.stack([np.zeros_like(NUMBERS), NUMBERS + 1, NUMBERS + 2, NUMBERS], axis=0).reshape(2, 2, 5, 4, 3)
    tzcyx = tczyx.transpose(0, 2, 1, 3, 4)
    imagej["metadata"] = {"spacing": 3.0, "unit": "um", "axes": "TZCYX"}
    tifffile.imwrite(HERE / "tifffile_hyperstack.tif", tzcyx, **imagej)
    for name, options in {
        "plain": {},
        "bigtiff": {"bigtiff": True},
        "lzw": {"compression": "lzw", "predictor": True},
        "deflate": {"compression": "zlib", "rowsperstrip": 3},
        "packbits": {"compression": "packbits"},
        "zstd": {"compression": "zstd"},
        "strips": {"rowsperstrip": 1},
        "inverted": {"photometric": "miniswhite"},
        "tiles": {"tile": (16, 16), "compression": "zlib"},
        "big_endian": {"byteorder": ">", "compression": "lzw"},
    }.items():
        tifffile.imwrite(HERE / f"tifffile_{name}.tif", NUMBERS, photometric=options.pop("photometric", "minisblack"), **options)
    tifffile.imwrite(HERE / "tifffile_float16.tif", (NUMBERS / 1000).astype(np.float16), photometric="minisblack")
    tifffile.imwrite(HERE / "tifffile_rgb.tif", np.stack([NUMBERS, NUMBERS // 2, NUMBERS // 4], axis=-1), photometric="rgb")
    planar = np.stack([NUMBERS, NUMBERS // 2, NUMBERS // 4], axis=1)
    tifffile.imwrite(HERE / "tifffile_planar.tif", planar, photometric="rgb", planarconfig="separate", compression="zlib")
    ome = {"PhysicalSizeX": 1.0, "PhysicalSizeY": 2.0, "PhysicalSizeZ": 0.003, "PhysicalSizeZUnit": "mm"}
    tifffile.imwrite(HERE / "tifffile.ome.tif", NUMBERS, metadata={"axes": "ZYX", **ome}, photometric="minisblack")
    tifffile.imwrite(
        HERE / "tifffile_tczyx.ome.tif", tczyx, metadata={"axes": "TCZYX", **ome}, photometric="minisblack", compression="zlib"
    )
    shutil.rmtree(HERE / "slices", ignore_errors=True)
    (HERE / "slices").mkdir()
    for index, plane in enumerate(NUMBERS):
        tifffile.imwrite(HERE / "slices" / f"s{index + 8}.tif", plane, photometric="minisblack", compression="lzw")


def write_zarr():
    shutil.rmtree(HERE / "zarr", ignore_errors=True)
    root = HERE / "zarr"
    chunks = (2, 4, 3)
    three = {"gzip": zarr.codecs.GzipCodec(), "zstd": zarr.codecs.ZstdCodec(checksum=True), "plain": None}
    for name in ("lz4", "zstd", "zlib", "blosclz"):
        for shuffle in ("noshuffle", "shuffle", "bitshuffle"):
            three[f"blosc_{name}_{shuffle}"] = zarr.codecs.BloscCodec(cname=name, shuffle=shuffle, blocksize=4096)
    smooth = NUMBERS.repeat(2, axis=0).repeat(8, axis=1).repeat(8, axis=2)
    for name, codec in three.items():
        is_blosc = name.startswith("blosc")
        array = zarr.create_array(
            root / f"v3_{name}", shape=smooth.shape if is_blosc else NUMBERS.shape, dtype="u2", zarr_format=3,
            chunks=smooth.shape if is_blosc else chunks, compressors=codec, overwrite=True,
        )
        array[:] = smooth if is_blosc else NUMBERS
    for name, codec in {"zlib": numcodecs.Zlib(), "blosc": numcodecs.Blosc(), "zstd": numcodecs.Zstd(), "none": None}.items():
        array = zarr.create_array(
            root / f"v2_{name}", shape=NUMBERS.shape, dtype=">u2", zarr_format=2, chunks=chunks, compressors=codec,
            order="F" if name == "zlib" else "C", overwrite=True,
        )
        array[:] = NUMBERS
    axes = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}] + [
        {"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"
    ]
    for version, name in (("0.4", 2), ("0.5", 3)):
        group = zarr.open_group(root / f"ome_{version}.zarr", mode="w", zarr_format=name)
        options = {"shards": (1, 1, 4, 4, 6)} if name == 3 else {}
        array = group.create_array("0", shape=(2, 2, 5, 4, 3), dtype="u2", chunks=(1, 1, 2, 4, 3), **options)
        array[1, 1] = NUMBERS
        array[0, 1] = NUMBERS + 1
        transformations = [
            {"type": "scale", "scale": [1.0, 1.0, *SPACING]},
            {"type": "translation", "translation": [0.0, 0.0, 30.0, 20.0, 10.0]},
        ]
        multiscales = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": transformations}]}]
        if name == 3:
            group.attrs["ome"] = {"version": version, "multiscales": multiscales}
        else:
            multiscales[0]["version"] = version
            group.attrs["multiscales"] = multiscales


if __name__ == "__main__":
    write_vti()
    write_tiff()
    write_zarr()
    print(json.dumps({str(path.relative_to(HERE)): path.stat().st_size for path in sorted(HERE.rglob("*")) if path.is_file()}, indent=1))
