#!/usr/bin/env python3
"""Measures ITK's Canny edge detector on the phantoms of `voxrole bench smoothing`.

Needs SimpleITK, numpy and pynrrd, and a built `voxrole`:

    python3 tests/peers/canny.py target/release/voxrole CANNY.csv [--quick]
    target/release/voxrole bench smoothing -o FOLDER --canny CANNY.csv [--quick]

Canny marks edge voxels: no place in between voxels, no distance, no gradient at the boundary. What can be compared:

- localisation: rms distance of the edge voxels within two blurs of a true surface, along the gradient to the formula's
  zero crossing of f'' (`distance_rms`) and to the true surface (`surface_rms`);
- false edges: the share of edge voxels more than a voxel from every true surface;
- faces kept: of the voxels within half a voxel of a true surface, the share with an edge voxel within one voxel (itself or
  one of its six neighbours); of slabs, that of the worst face.

Only voxels at least four voxels from the volume's border count.

Thresholds follow the data. Hysteresis begins above four standard deviations of the gradient's noise after the Gaussian (the
noise floor of `voxrole prepare`), and not below a tenth of the largest gradient magnitude; it goes on down to half of that.
Values are scaled to 0..1000, because ITK's filter adds 1e-4 to g^2, which is no longer small for values from 0 to 1.
"""

import argparse
import csv
import subprocess
import tempfile
from pathlib import Path

import nrrd
import numpy
import SimpleITK

SCALE = 1000
SIGMAS = [1.0, 1.5]
NOISES = [0, 0.005, 0.01, 0.02, 0.03, 0.05]
# Phantom, thickness, blur, noises: those of `voxrole bench smoothing`.
SCENES = [
    ("ball", 4, 1.5, NOISES),
    ("slab-pair", 10, 1.5, NOISES),
    ("slab-pair", 4, 1.0, NOISES),
    ("slab-pair", 3, 1.0, NOISES),
    ("slab-pair", 2, 1.0, NOISES),
    ("junction", 4, 1.5, NOISES),
    ("slab-pair", 6, 1.0, [0.01, 0.03]),
    ("slab-pair", 10, 1.0, [0.01, 0.03]),
]
QUICK_SCENES = [
    ("ball", 4, 1.5, [0, 0.01, 0.03]),
    ("junction", 4, 1.5, [0, 0.01, 0.03]),
    ("slab-pair", 2, 1.0, [0, 0.01, 0.03]),
    ("slab-pair", 3, 1.0, [0, 0.01, 0.03]),
]
MARGIN = 4
NOISE_FLOOR = 4
LEAST_THRESHOLD = 0.1
# The slab pair's normal, and its place in the volume.
OBLIQUE = numpy.array([0.8, 0.48, 0.36])
OFF_CENTRE = numpy.array([0.3, -0.2, 0.1])


def make_phantom(voxrole, folder, edge, scene, noise):
    """Values, true signed distance and distance along the gradient to the crossing, indexed x, y, z."""
    phantom, thickness, blur, _ = scene
    paths = [folder / f"{name}.nrrd" for name in ("values", "truth", "crossing")]
    options = ["--thickness", thickness] if phantom == "slab-pair" else []
    command = [voxrole, "phantom", phantom, "--dims", f"{edge},{edge},{edge}", "--blur", blur, "--noise", noise]
    command += ["--value-scale", SCALE, *options, "-o", paths[0], "--truth", paths[1], "--crossing", paths[2]]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return [nrrd.read(str(path))[0].astype(numpy.float64) for path in paths]


def noise_of(values):
    """Standard deviation of white noise: the median absolute value of threefold second differences, of which a smooth
    signal has almost none."""
    for axis in range(3):
        values = numpy.diff(values, 2, axis)
    return numpy.median(numpy.abs(values)) / 0.6745 / 6**1.5


def gradient_noise(noise, sigma):
    """Standard deviation of each component of the gradient of white noise under a Gaussian."""
    return noise * (4 * numpy.pi * sigma**2) ** -0.75 / (2**0.5 * sigma)


def canny(values, sigma):
    """Edge voxels and the two thresholds."""
    image = SimpleITK.GetImageFromArray(values.astype(numpy.float32))
    gradient = SimpleITK.GetArrayFromImage(SimpleITK.GradientMagnitude(SimpleITK.DiscreteGaussian(image, sigma**2)))
    upper = max(NOISE_FLOOR * gradient_noise(noise_of(values), sigma), LEAST_THRESHOLD * float(gradient.max()))
    edges = SimpleITK.CannyEdgeDetection(image, upper / 2, upper, [sigma**2] * 3)
    return SimpleITK.GetArrayFromImage(edges) > 0, upper / 2, upper


def face_of(phantom, truth, thickness, blur):
    """Which of the scene's faces is nearest, by voxel."""
    if phantom != "slab-pair":
        return numpy.zeros(truth.shape, int)
    edge = truth.shape[0]
    unit = edge / 64
    inner = max(16 * unit, 8 * blur) / 2
    places = numpy.indices(truth.shape).transpose(1, 2, 3, 0) - (edge - 1) / 2 - OFF_CENTRE
    offsets = numpy.array([-inner - thickness, -inner, inner, inner + thickness])
    distances = numpy.abs((places @ OBLIQUE)[..., None] - offsets)
    known = numpy.isfinite(truth)
    assert numpy.allclose(distances.min(-1)[known], numpy.abs(truth[known]), atol=1e-4), "the slabs lie elsewhere"
    return distances.argmin(-1)


def within_one(mask):
    """Voxels of which the voxel itself or one of its six neighbours is in the mask."""
    reached = mask.copy()
    for axis in range(3):
        after, before = [slice(None)] * 3, [slice(None)] * 3
        after[axis], before[axis] = slice(1, None), slice(None, -1)
        reached[tuple(after)] |= mask[tuple(before)]
        reached[tuple(before)] |= mask[tuple(after)]
    return reached


def rms(errors):
    errors = errors[numpy.isfinite(errors)]
    return numpy.sqrt(numpy.mean(errors**2)) if errors.size else ""


def measure(edges, truth, crossing, scene):
    phantom, thickness, blur, _ = scene
    inside = numpy.zeros(truth.shape, bool)
    inside[(slice(MARGIN, -MARGIN),) * 3] = True
    # Farther than the file says is far.
    distance = numpy.where(numpy.isfinite(truth), numpy.abs(truth), numpy.inf)
    counted = edges & inside
    near = counted & (distance <= 2 * blur)
    faces, reached, on_face = face_of(phantom, truth, thickness, blur), within_one(edges), inside & (distance <= 0.5)
    kept = [reached[on_face & (faces == face)].mean() for face in numpy.unique(faces[on_face])]
    return {
        "edge_voxels": counted.sum(),
        "near_voxels": near.sum(),
        "distance_rms [voxel]": rms(crossing[near]),
        "surface_rms [voxel]": rms(truth[near]),
        "false_share": (distance[counted] > 1).mean() if counted.any() else "",
        "faces_kept": min(kept),
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("voxrole", type=lambda path: Path(path).resolve())
    parser.add_argument("table", type=Path)
    parser.add_argument("--quick", action="store_true", help="the small volumes of bench smoothing --quick")
    args = parser.parse_args()
    edge, scenes = (32, QUICK_SCENES) if args.quick else (64, SCENES)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            phantom, thickness, blur, noises = scene
            for noise in noises:
                values, truth, crossing = make_phantom(args.voxrole, Path(folder), edge, scene, noise)
                for sigma in SIGMAS:
                    edges, lower, upper = canny(values, sigma)
                    case = {"phantom": phantom, "edge [voxel]": edge, "blur [voxel]": blur, "thickness [voxel]": thickness}
                    case |= {"noise [step]": noise, "sigma [voxel]": sigma, "lower [step / voxel]": lower / SCALE}
                    case["upper [step / voxel]"] = upper / SCALE
                    rows.append(case | measure(edges, truth, crossing, scene))
                    print(" ".join(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in rows[-1].values()))
    with args.table.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
