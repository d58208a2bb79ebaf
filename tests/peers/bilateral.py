#!/usr/bin/env python3
"""Compares the bilateral filter with ITK's, in time and in values, and its values with brute force.

Needs SimpleITK, numpy and pynrrd, and a built `voxrole`:

    python3 tests/peers/bilateral.py target/release/voxrole [--threads 2] [--rounds 3] [--edge 128]

The field is the three-ball phantom under noise of 3 %, as f32. Both filters have the same sigmas and the same neighbourhood:
ITK's reaches ceil(2.5 sigma) voxels, so sigma = 1 has radius 3 and 343 neighbours, which is `--radius 3` here. ITK looks its
range weights up in a table of 100 samples and cuts them at four sigma; that table only is made finer when values are compared.

- Time: ITK's filter on the image in memory against the stage `value smoothing` of `--smooth bilateral-value`, with the same
  number of threads, one after the other in each round. The ratio is that of the fastest runs, and of the medians.
- Values: `--smooth bilateral-derivatives` stores the filtered gradient magnitude, and `--smooth none` the one before that.
  Brute force is numpy's exp in float64 over all neighbours inside the volume; so are the deviations of `--bilateral exact` and
  of ITK, at least the radius off the border, beyond which ITK repeats the outermost values. Deviations are shares of the
  field's range.
"""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import nrrd
import numpy
import SimpleITK

RADIUS = 3
SHARES = [0.4, 0.15, 0.03]
# Runs of `voxrole` beside each one of ITK.
OURS_PER_ROUND = 5


def prepare(voxrole, folder, threads, *options):
    """The report of a run; the packed file is out.vxr."""
    report = folder / "report.json"
    command = [voxrole, "prepare", folder / "in.nrrd", "-o", folder / "out.vxr", "--method", "fast", "--threads", threads]
    command += ["--report", report, *options]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return json.loads(report.read_text())


def bilateral_options(placement, share, weights):
    sigmas = ["--spatial-sigma", 1, "--range-sigma", share, "--radius", RADIUS]
    return ["--smooth", placement, *sigmas, "--bilateral", weights]


def gradient_magnitude(voxrole, folder, threads, *options):
    """The stored gradient magnitude, indexed x, y, z."""
    prepare(voxrole, folder, threads, "--keep", "derivatives", *options)
    command = [voxrole, "export", folder / "out.vxr", "--field", "gradient-magnitude", "-o", folder / "g.nrrd"]
    subprocess.run([str(part) for part in command], check=True)
    return nrrd.read(str(folder / "g.nrrd"))[0]


def itk(range_sigma, samples=100):
    bilateral = SimpleITK.BilateralImageFilter()
    bilateral.SetDomainSigma(1)
    bilateral.SetRangeSigma(range_sigma)
    bilateral.SetNumberOfRangeGaussianSamples(samples)
    return bilateral


def brute_force(values, range_sigma):
    values = values.astype(numpy.float64)
    sums, totals = numpy.zeros_like(values), numpy.zeros_like(values)
    padded = numpy.pad(values, RADIUS, constant_values=numpy.inf)
    for offset in numpy.ndindex((2 * RADIUS + 1,) * 3):
        other = padded[tuple(slice(start, start + length) for start, length in zip(offset, values.shape))]
        inside = numpy.isfinite(other)
        difference = numpy.where(inside, other, values) - values
        spatial = numpy.exp(-sum((start - RADIUS) ** 2 for start in offset) / 2)
        weight = numpy.where(inside, spatial * numpy.exp(-((difference / range_sigma) ** 2) / 2), 0)
        sums += weight * difference
        totals += weight
    return values + sums / totals


def compare_times(args, folder, share):
    values = nrrd.read(str(folder / "in.nrrd"))[0]
    image = SimpleITK.GetImageFromArray(numpy.ascontiguousarray(values.T))
    bilateral = itk(share * float(numpy.ptp(values)))
    theirs, ours = [], {"fast": [], "exact": []}
    for _ in range(args.rounds):
        start = time.perf_counter()
        bilateral.Execute(image)
        theirs.append(time.perf_counter() - start)
        for weights, seconds in ours.items():
            for _ in range(OURS_PER_ROUND):
                report = prepare(args.voxrole, folder, args.threads, *bilateral_options("bilateral-value", share, weights))
                stages = {stage["name"]: stage["seconds"] for stage in report["stages"]}
                seconds.append(stages["value smoothing"])
                assert report["range_sigma"][0]["weights"] == weights
    for weights, seconds in ours.items():
        print(
            f"  {weights}: {min(seconds):.3f} s, median {statistics.median(seconds):.3f}; "
            f"ITK {min(theirs):.2f} s, median {statistics.median(theirs):.2f}; "
            f"ratio {min(theirs) / min(seconds):.0f}, of medians {statistics.median(theirs) / statistics.median(seconds):.0f}"
        )


def compare_values(args, folder, share):
    before = gradient_magnitude(args.voxrole, folder, args.threads, "--smooth", "none")
    reach = float(numpy.ptp(before))
    expected = brute_force(before, share * reach)
    whole, inner = (slice(None),) * 3, (slice(RADIUS, -RADIUS),) * 3
    found = {
        f"{weights} weights": (
            gradient_magnitude(
                args.voxrole, folder, args.threads, *bilateral_options("bilateral-derivatives", share, weights)
            ),
            whole,
        )
        for weights in ("fast", "exact")
    }
    image = SimpleITK.GetImageFromArray(before)
    for samples in (100, 10000):
        filtered = SimpleITK.GetArrayFromImage(itk(share * reach, samples).Execute(image))
        found[f"ITK, {samples} range samples"] = filtered, inner
    for name, (filtered, part) in found.items():
        deviation = numpy.abs(filtered.astype(numpy.float64) - expected)[part] / reach
        print(f"  {name}: deviation at most {deviation.max():.1e}, on average {deviation.mean():.1e} of the range")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("voxrole", type=lambda path: Path(path).resolve())
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--edge", type=int, default=128, help="voxels along each axis")
    args = parser.parse_args()
    SimpleITK.ProcessObject.SetGlobalDefaultNumberOfThreads(args.threads)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        dims = ",".join([str(args.edge)] * 3)
        command = [args.voxrole, "phantom", "three-balls", "--dims", dims, "--noise", "0.03", "-o", folder / "in.nrrd"]
        subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
        for share in SHARES:
            print(f"three-balls, {args.edge}^3, range sigma {share} of the range, {args.threads} threads")
            compare_times(args, folder, share)
            compare_values(args, folder, share)


if __name__ == "__main__":
    main()
