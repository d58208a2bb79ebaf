#!/usr/bin/env python3
"""Exports every field in every format and reads it back with other software.

Needs numpy, pynrrd, SimpleITK, nibabel, tifffile, vtk, zarr, ome-zarr and ome-zarr-models, and a built `voxrole`:

    python3 tests/peers/exports.py target/release/voxrole

The volume is a blurred ball on an oblique grid with a spacing, an origin and a unit of its own, written by pynrrd as u16 in
left-posterior-superior. For each combination of field, format and reader a line says whether numbers, their type, spacing,
unit and the world positions (left-posterior-superior) of the grid's corners are those expected. Values are compared with the array
that the volume was made from, other fields with what pynrrd reads of their NRRD; normals with the ball's, too. A second volume,
written by nibabel as i16 with slope and intercept, shows what becomes of these.

ITK's NIfTI reader makes 0 of NaN (nifticlib does), which is expected of it here.

Positions may be off by 1e-9 of the grid's extent; in NIfTI, which stores them as 32-bit floats, by 1e-6.
"""

import csv
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import nibabel
import nrrd
import numpy
import ome_zarr.io
import ome_zarr.reader
import ome_zarr_models.v05
import SimpleITK
import tifffile
import zarr
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

DIMS = (70, 50, 41)
SPACING = numpy.array([0.7, 1.1, 2.3])
ORIGIN = numpy.array([-31.25, 12.5, 101.75])
RADIUS = 18
FIELDS = ["value", "distance", "hit-gradient", "normal", "role", "gradient-magnitude", "second-derivative"]
LPS_FROM_RAS = numpy.diag([-1.0, -1.0, 1.0, 1.0])
outcomes = []


@dataclass
class Found:
    """What a reader gives: numbers by x, y, z (and component), and what it says of the grid; None where it says nothing."""

    numbers: numpy.ndarray
    world_from_index: numpy.ndarray | None = None
    spacing: numpy.ndarray | None = None
    unit: str | None = None
    tolerance: float = 1e-9


def rotation():
    """An oblique right-handed frame: turns about x by 20, y by -35 and z by 50 degrees."""
    x, y, z = (math.radians(angle) for angle in (20, -35, 50))
    about_x = [[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]]
    about_y = [[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]]
    about_z = [[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]]
    return numpy.array(about_z) @ about_y @ about_x


def affine(axes, spacing, origin):
    matrix = numpy.eye(4)
    matrix[:3, :3] = axes * spacing
    matrix[:3, 3] = origin
    return matrix


def positions(world_from_index, dims):
    index = numpy.stack(numpy.meshgrid(*(numpy.arange(n) for n in dims), indexing="ij"), axis=-1)
    return index @ world_from_index[:3, :3].T + world_from_index[:3, 3]


def ball(world_from_index):
    """A ball about the grid's middle that falls off softly, from 1 to 0."""
    points = positions(world_from_index, DIMS)
    distance = numpy.linalg.norm(points - points[tuple(n // 2 for n in DIMS)], axis=-1)
    return 1 / (1 + numpy.exp((distance - RADIUS) / 2))


def read_pynrrd(path):
    numbers, header = nrrd.read(str(path))
    if numbers.ndim == 4:
        numbers = numpy.moveaxis(numbers, 0, -1)
    steps = header["space directions"][-3:].astype(float)
    matrix = affine(steps.T, 1, header["space origin"])
    assert header["space"] == "left-posterior-superior", header["space"]
    return Found(numbers, matrix, numpy.linalg.norm(steps, axis=1), header["space units"][-1])


def read_simpleitk(path):
    image = SimpleITK.ReadImage(str(path))
    numbers = SimpleITK.GetArrayFromImage(image)
    numbers = numbers.transpose(2, 1, 0, *range(3, numbers.ndim))
    axes = numpy.array(image.GetDirection()).reshape(3, 3)
    spacing = numpy.array(image.GetSpacing())
    is_nifti = ".nii" in path.name
    if is_nifti and numbers.ndim == 4:
        numbers = numbers * numpy.array([-1, -1, 1], numbers.dtype)
    matrix = affine(axes, spacing, image.GetOrigin())
    return Found(numbers, matrix, spacing, tolerance=1e-6 if is_nifti else 1e-9)


def read_nibabel(path):
    image = nibabel.load(path)
    numbers = numpy.asanyarray(image.dataobj)
    if numbers.ndim == 5:
        numbers = numbers[:, :, :, 0] * numpy.array([-1, -1, 1], numbers.dtype)
    header = image.header
    spacing = numpy.array(header.get_zooms()[:3], float)
    for code in ("qform_code", "sform_code"):
        assert header[code] == 1, f"{code} {header[code]}"
    assert numpy.allclose(header.get_qform(), header.get_sform(), rtol=0, atol=1e-4), "qform and sform differ"
    return Found(numbers, LPS_FROM_RAS @ header.get_sform(), spacing, header.get_xyzt_units()[0], tolerance=1e-6)


def read_vtk(path):
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    array = image.GetPointData().GetArray(0)
    assert array.GetName() == path.stem, array.GetName()
    numbers = vtk_to_numpy(array).reshape(*image.GetDimensions()[::-1], -1).transpose(2, 1, 0, 3)
    direction = image.GetDirectionMatrix()
    axes = numpy.array([[direction.GetElement(row, column) for column in range(3)] for row in range(3)])
    spacing = numpy.array(image.GetSpacing())
    matrix = affine(axes, spacing, image.GetOrigin())
    far = [n - 1 for n in image.GetDimensions()]
    point = [0.0, 0.0, 0.0]
    image.TransformIndexToPhysicalPoint(far, point)
    assert numpy.allclose(point, (matrix @ [*far, 1])[:3]), "VTK places the last voxel elsewhere"
    return Found(numbers[..., 0] if numbers.shape[-1] == 1 else numbers, matrix, spacing)


def read_tifffile(path):
    with tifffile.TiffFile(path) as file:
        assert file.is_imagej, "not ImageJ's"
        metadata, page = file.imagej_metadata, file.pages[0]
        numbers = file.asarray()
        in_plane = [page.tags[name].value for name in ("XResolution", "YResolution")]
        offsets = [page.dataoffsets[0] for page in file.pages]
        # ImageJ reads one page behind the other from the first on, whatever the directories say.
        assert all(b - a == page.nbytes for a, b in zip(offsets, offsets[1:])), "pages do not lie one behind the other"
    spacing = numpy.array([*(denominator / numerator for numerator, denominator in in_plane), metadata["spacing"]])
    numbers = numbers.transpose(2, 1, 0) if numbers.ndim == 3 else numbers.transpose(3, 2, 0, 1)
    origin = -numpy.array([metadata[axis + "origin"] for axis in "xyz"]) * spacing
    assert numpy.allclose(origin, ORIGIN, rtol=1e-9), f"origin {origin}"
    return Found(numbers, None, spacing, metadata["unit"])


def read_numpy(path):
    numbers = numpy.load(path)
    return Found(numbers.transpose(2, 1, 0, *range(3, numbers.ndim)))


def by_xyz(numbers):
    return numbers.transpose(2, 1, 0) if numbers.ndim == 3 else numbers.transpose(3, 2, 1, 0)


def read_zarr(path):
    group = zarr.open_group(path, mode="r")
    ome = group.attrs["ome"]
    ome_zarr_models.v05.Image.from_zarr(group)
    levels = ome["multiscales"][0]["datasets"]
    axes = ome["multiscales"][0]["axes"]
    for level, dataset in enumerate(levels):
        scale, translation = dataset["coordinateTransformations"]
        assert numpy.allclose(scale["scale"][-3:], 2.0**level * SPACING[::-1]), f"scale {scale}"
        assert numpy.allclose(translation["translation"][-3:], ORIGIN[::-1]), f"translation {translation}"
    finest = by_xyz(group["0"][:])
    coarse = by_xyz(group[levels[1]["path"]][:])
    assert numpy.array_equal(coarse, finest[::2, ::2, ::2], equal_nan=True), "level 1 is not every second voxel"
    assert group["0"].shards is not None, "not sharded"
    own = group.attrs["voxrole"]
    assert own["world"] == "left-posterior-superior"
    spacing = numpy.array(levels[0]["coordinateTransformations"][0]["scale"][:-4:-1])
    unit = {"millimeter": "mm"}[axes[-1]["unit"]]
    return Found(finest, numpy.array(own["world_from_index"]), spacing, unit)


def read_ome_zarr(path):
    [node] = ome_zarr.reader.Reader(ome_zarr.io.parse_url(path))()
    scale = node.metadata["coordinateTransformations"][0][0]["scale"]
    assert len(node.data) == 2, f"{len(node.data)} levels"
    return Found(by_xyz(node.data[0].compute()), None, numpy.array(scale[:-4:-1]))


# Name, ending, options, reader.
FORMATS = [
    ("NRRD", ".nrrd", [], "pynrrd", read_pynrrd),
    ("NRRD", ".nrrd", [], "SimpleITK", read_simpleitk),
    ("NRRD, gzip", ".nrrd", ["--compress"], "SimpleITK", read_simpleitk),
    ("NIfTI", ".nii", [], "nibabel", read_nibabel),
    ("NIfTI", ".nii.gz", [], "nibabel", read_nibabel),
    ("NIfTI", ".nii.gz", [], "SimpleITK", read_simpleitk),
    ("VTI", ".vti", [], "VTK", read_vtk),
    ("VTI, zlib", ".vti", ["--compress"], "VTK", read_vtk),
    ("TIFF", ".tif", [], "tifffile", read_tifffile),
    ("npy", ".npy", [], "numpy", read_numpy),
    ("OME-Zarr", ".ome.zarr", [], "zarr-python", read_zarr),
    ("OME-Zarr", ".ome.zarr", [], "ome-zarr-py", read_ome_zarr),
]


def line(what, form, reader, problems, detail=""):
    outcomes.append(not problems)
    print(f"{what:24} {form:12} {reader:12} {'; '.join(problems) or 'equal'}{detail}", flush=True)


def compare(found, numbers, world_from_index, spacing, scalar_type):
    """What is not as expected."""
    problems = []
    if found.numbers.dtype != scalar_type:
        problems.append(f"{found.numbers.dtype} instead of {scalar_type}")
    if found.numbers.shape != numbers.shape:
        return [*problems, f"shape {found.numbers.shape} instead of {numbers.shape}"]
    different = ~((found.numbers == numbers) | (numpy.isnan(found.numbers) & numpy.isnan(numbers)))
    if different.any():
        problems.append(f"{different.sum()} numbers differ")
    if found.spacing is not None and not numpy.allclose(found.spacing, spacing, rtol=1e-7, atol=0):
        problems.append(f"spacing {found.spacing}")
    if found.unit not in (None, "mm"):
        problems.append(f"unit {found.unit}")
    if found.world_from_index is not None:
        last = numpy.array(numbers.shape[:3]) - 1
        corners = numpy.array([[*(last * pick), 1] for pick in numpy.ndindex(2, 2, 2)])
        off = numpy.abs((found.world_from_index - world_from_index) @ corners.T)[:3].max()
        extent = numpy.linalg.norm(last * spacing)
        if not off <= found.tolerance * extent:
            problems.append(f"corners off by {off:.2e}")
    return problems


def check(run, packed, field, expected, world_from_index, folder):
    """Exports one field in each format and reads it back; `expected` gives numbers and their type for a format's name."""
    spacing = numpy.linalg.norm(world_from_index[:3, :3], axis=0)
    for form, ending, options, reader, read in FORMATS:
        path = folder / f"{field}{ending}"
        numbers, scalar_type = expected(form)
        reads_zero = form == "NIfTI" and reader == "SimpleITK" and numpy.isnan(numbers).any()
        if reads_zero:
            numbers = numpy.nan_to_num(numbers)
        try:
            run("export", packed, "--field", field, "-o", path, *options)
            problems = compare(read(path), numbers, world_from_index, spacing, scalar_type)
        except Exception as error:  # pylint: disable=broad-except
            problems = [f"{type(error).__name__}: {error}"]
        line(field, form, reader, problems, ", NaN read as 0" if reads_zero else "")


def check_normals(normals, role, world_from_index):
    """The normals of boundary voxels point to the ball's middle, in left-posterior-superior."""
    points = positions(world_from_index, DIMS)
    inwards = points[tuple(n // 2 for n in DIMS)] - points
    distance = numpy.linalg.norm(inwards, axis=-1)
    on_ball = (role == 1) & (numpy.abs(distance - RADIUS) < 2)
    cosine = (normals * inwards).sum(axis=-1)[on_ball] / distance[on_ball]
    angle = math.degrees(math.acos(min(1, cosine.min())))
    line("normal", "NRRD", "formula", [] if angle < 6 else ["not equal"], f", at most {angle:.1f} degrees off")


def check_histograms(run, packed, folder):
    """Tables and arrays hold the same counts, within the same edges."""
    for kind, quantities in {"v-g": ["value", "gradient_magnitude"], "distance": ["signed_distance"]}.items():
        table, array = folder / f"{kind}.csv", folder / f"{kind}.npy"
        run("histogram", packed, "--kind", kind, "-o", table)
        run("histogram", packed, "--kind", kind, "-o", array)
        counts = numpy.load(array)
        edges = [numpy.load(folder / f"{kind}_{quantity}_edges.npy") for quantity in quantities]
        problems = []
        if counts.dtype != numpy.uint64 or counts.shape != tuple(len(edge) - 1 for edge in edges):
            problems.append(f"{counts.dtype} {counts.shape}")
        with open(table, newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))[1:]
        total = 0
        for row in rows:
            numbers = [float(number) for number in row]
            bins = tuple(int(numpy.searchsorted(edge, numbers[3 * axis])) - 1 for axis, edge in enumerate(edges))
            bounds = [number for axis, edge in enumerate(edges) for number in edge[bins[axis] : bins[axis] + 2]]
            listed = [number for axis in range(len(edges)) for number in numbers[3 * axis + 1 : 3 * axis + 3]]
            if counts[bins] != numbers[-1] or not numpy.allclose(bounds, listed):
                problems.append(f"bin {bins}")
            total += int(numbers[-1])
        if total != counts.sum():
            problems.append(f"{total} counts in the table, {counts.sum()} in the array")
        line(f"histogram {kind}", "npy, CSV", "numpy", problems)


def main():
    voxrole = Path(sys.argv[1])

    def run(*command):
        parts = [str(part) for part in [voxrole, *command]]
        done = subprocess.run(parts, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        world_from_index = affine(rotation(), SPACING, ORIGIN)
        stored = numpy.round(1000 + 30000 * ball(world_from_index)).astype(numpy.uint16)
        header = {
            "space": "left-posterior-superior",
            "space directions": (rotation() * SPACING).T,
            "space origin": ORIGIN,
            "space units": ["mm"] * 3,
            "encoding": "raw",
        }
        volume, packed = folder / "ball.nrrd", folder / "ball.vxr"
        nrrd.write(str(volume), stored, header)
        run("prepare", volume, "-o", packed, "--method", "fast", "--keep", "derivatives")
        run("export", packed, "--all", "-o", folder / "reference", "--format", "nrrd")
        fields = {field: nrrd.read(str(folder / "reference" / f"{field}.nrrd"))[0] for field in FIELDS}
        fields["normal"] = numpy.moveaxis(fields["normal"], 0, -1)
        fields["value"] = stored
        for field, numbers in fields.items():
            own = {"value": numpy.uint16, "role": numpy.int8}.get(field, numpy.float32)
            types = {"TIFF": numpy.int16} if field == "role" else {}
            check(run, packed, field, lambda form: (numbers, types.get(form, own)), world_from_index, folder)
        check_normals(fields["normal"], fields["role"], world_from_index)

        coarse = affine(rotation(), 2 * SPACING, ORIGIN)
        for form, ending, options, reader, read in [FORMATS[0], FORMATS[4], FORMATS[6], FORMATS[8]]:
            path = folder / f"distance{ending}"
            run("export", packed, "--field", "distance", "--level", 1, "-o", path, *options)
            problems = compare(read(path), fields["distance"][::2, ::2, ::2], coarse, 2 * SPACING, numpy.float32)
            line("distance, level 1", form, reader, problems)

        slope, intercept = 0.5, -1024.0
        raw = numpy.round(stored / 20).astype(numpy.int16)
        image = nibabel.Nifti1Image(raw, LPS_FROM_RAS @ world_from_index)
        image.header.set_xyzt_units("mm")
        image.header.set_slope_inter(slope, intercept)
        image.set_qform(LPS_FROM_RAS @ world_from_index, 1)
        image.set_sform(LPS_FROM_RAS @ world_from_index, 1)
        nibabel.save(image, folder / "mapped.nii.gz")
        run("prepare", folder / "mapped.nii.gz", "-o", folder / "mapped.vxr", "--method", "fast")
        physical = raw * slope + intercept
        as_read = nibabel.load(folder / "mapped.nii.gz").affine
        for form, ending, options, reader, read in FORMATS:
            if form == "OME-Zarr" or form == "TIFF":
                continue
            path = folder / f"value{ending}"
            run("export", folder / "mapped.vxr", "--field", "value", "-o", path, *options)
            found = read(path)
            scalar_type = numpy.float64 if reader == "nibabel" else numpy.float32
            found.tolerance = 1e-6
            problems = compare(found, physical, LPS_FROM_RAS @ as_read, SPACING, scalar_type)
            if reader == "nibabel" and nibabel.load(path).header.get_data_dtype() != numpy.int16:
                problems.append("stored numbers were not kept")
            line("value, slope, intercept", form, reader, problems)
        check_histograms(run, packed, folder)
    print(f"{sum(outcomes)} of {len(outcomes)} combinations are as expected")
    sys.exit(0 if all(outcomes) else 1)


if __name__ == "__main__":
    main()
