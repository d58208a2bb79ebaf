#!/usr/bin/env python3
"""What a phantom's samples can give at best: crossings of f'' on the Fourier interpolation of the whole volume.

Needs numpy and pynrrd, and a built `voxrole`:

    python3 tests/peers/spectral_reference.py target/release/voxrole [ball box]

For phantoms that are 0 at every face, so that the volume may be continued periodically. f'' is computed in the frequency
domain on a grid four times as fine, and read between its samples by Lagrange interpolation of degree 7; a crossing is
bisected along the spectral gradient of the voxel. Beside it stands `--method accurate`. Voxels within two blurs of the
boundary, at least four from the border; distances in voxels.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import nrrd
import numpy

SIZE = 64
FINER = 4
TAPS = numpy.arange(-3, 5)
SEARCHED = 0.4
SAMPLE = 6000


def spectral_second_derivative(values):
    """f'' on the finer grid, and the gradient at the voxels."""
    spectrum = numpy.fft.fftn(values)
    frequency = numpy.fft.fftfreq(SIZE, 1 / SIZE)
    places = frequency.astype(int) % (SIZE * FINER)
    factor = 2j * numpy.pi * frequency / SIZE
    factor[SIZE // 2] = 0
    along = [factor[:, None, None], factor[None, :, None], factor[None, None, :]]

    def finer(spectrum):
        padded = numpy.zeros([SIZE * FINER] * 3, complex)
        padded[numpy.ix_(places, places, places)] = spectrum
        return numpy.fft.ifftn(padded).real * FINER**3

    gradient = [finer(spectrum * along[a]) for a in range(3)]
    second = sum(gradient[a] ** 2 * finer(spectrum * along[a] ** 2) for a in range(3))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        second += 2 * gradient[a] * gradient[b] * finer(spectrum * along[a] * along[b])
    second /= numpy.maximum(sum(component**2 for component in gradient), 1e-300)
    at_voxels = numpy.stack([component[::FINER, ::FINER, ::FINER] for component in gradient], -1)
    return second, at_voxels


def interpolate(field, places):
    """The field at places in voxels, by Lagrange polynomials of degree 7 along each axis."""
    places = places * FINER
    cells = numpy.floor(places).astype(int)
    weights = []
    for axis in range(3):
        offsets = (places - cells)[:, axis, None] - TAPS
        basis = numpy.ones_like(offsets)
        for i in range(len(TAPS)):
            for j in range(len(TAPS)):
                if i != j:
                    basis[:, i] *= offsets[:, j] / (TAPS[i] - TAPS[j])
        weights.append(basis)
    total = numpy.zeros(len(places))
    for a in range(len(TAPS)):
        for b in range(len(TAPS)):
            for c in range(len(TAPS)):
                at = [(cells[:, axis] + TAPS[tap]) % len(field) for axis, tap in enumerate((a, b, c))]
                total += weights[0][:, a] * weights[1][:, b] * weights[2][:, c] * field[tuple(at)]
    return total


def summary(errors):
    errors = numpy.abs(errors)
    return f"rms {numpy.sqrt((errors**2).mean()):.6f}, 99 % below {numpy.quantile(errors, 0.99):.6f}"


def measure(voxrole, folder, name, blur):
    def run(*arguments):
        subprocess.run([voxrole, *arguments], check=True, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    run("phantom", name, "--dims", "64,64,64", "--blur", str(blur), "-o", "p.nrrd", "--truth", "t.nrrd", "--crossing", "c.nrrd")
    run("prepare", "p.nrrd", "-o", "p.vxr", "--method", "accurate")
    run("export", "p.vxr", "--field", "distance", "-o", "d.nrrd")
    values, truth, crossing, found = (nrrd.read(str(folder / f"{file}.nrrd"))[0].astype(float) for file in "ptcd")
    near = numpy.zeros(truth.shape, bool)
    near[4:-4, 4:-4, 4:-4] = True
    near &= (numpy.abs(truth) <= 2 * blur) & numpy.isfinite(crossing)
    accurate = (found - crossing)[near & numpy.isfinite(found)]

    second, gradient = spectral_second_derivative(values)
    voxels = numpy.argwhere(near)
    voxels = voxels[numpy.random.default_rng(0).permutation(len(voxels))[:SAMPLE]]
    expected = crossing[tuple(voxels.T)]
    normals = gradient[tuple(voxels.T)]
    normals /= numpy.linalg.norm(normals, axis=1)[:, None]
    low, high = -expected - SEARCHED, -expected + SEARCHED
    bracketed = (interpolate(second, voxels + normals * low[:, None]) > 0) & (
        interpolate(second, voxels + normals * high[:, None]) < 0
    )
    for _ in range(22):
        middle = (low + high) / 2
        rises = interpolate(second, voxels + normals * middle[:, None]) > 0
        low, high = numpy.where(rises, middle, low), numpy.where(rises, high, middle)
    reference = (-(low + high) / 2 - expected)[bracketed]
    print(f"{name}, blur {blur}: accurate {summary(accurate)}; reference {summary(reference)} ({bracketed.mean():.1%} found)")


def main():
    voxrole = str(Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[2:] or ["ball", "box"]:
            for blur in (1.0, 1.5, 2.0):
                measure(voxrole, Path(folder), name, blur)


if __name__ == "__main__":
    main()
