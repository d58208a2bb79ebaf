#!/usr/bin/env python3
"""Compares the time of whole runs, and of the derivatives alone, with teem's vprobe and with ITK.

Needs teem-apps, SimpleITK, numpy and pynrrd, and a built `voxrole`:

    python3 tests/peers/speed.py target/release/voxrole [--threads 2] [--rounds 3] [--edge 256]

The volume is the three-ball phantom as f32 without noise. One after the other in each round, the fastest of each counts:

- `vprobe -q 2d` (second derivative along the gradient) and `vprobe -q gm` (gradient magnitude), file to file, one thread: teem
  has no other way.
- `voxrole prepare --smooth none`, file to file, by each method.
- ITK's GradientMagnitude on the image in memory against our central differences, which compute f'' too: the kernel alone, into
  fields that are there (`cargo bench`), and as the stage `derivatives` of `--method fast`, most of which is the system's making room
  for two new fields.
"""

import argparse
import json
import os
import re
import subprocess
import tempfile
import time
from pathlib import Path

import numpy
import nrrd
import SimpleITK

METHODS = ["fast", "accurate", "auto"]
KERNELS = ["cargo", "bench", "--quiet", "--no-default-features", "-p", "voxrole-preprocess", "--bench", "kernels"]


def seconds(task):
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def run(*command):
    command = [str(part) for part in command]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def kernel_seconds(threads):
    """The time of central differences of 256³ samples, and of a copy of as many bytes."""
    command = [*KERNELS, "--", "derivatives/(copy|central2)", "--measurement-time", "2", "--warm-up-time", "1", "--noplot"]
    environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
    said = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    found = re.findall(r"time: +\[\S+ \S+ (\S+) (ms|µs)", said)
    return [float(number) / {"ms": 1e3, "µs": 1e6}[unit] for number, unit in found]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("voxrole", type=Path)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--edge", type=int, default=256)
    options = parser.parse_args()
    SimpleITK.ProcessObject.SetGlobalDefaultNumberOfThreads(options.threads)
    best = {}

    def keep(name, time):
        best[name] = min(time, best.get(name, float("inf")))

    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        volume, report = folder / "in.nrrd", folder / "report.json"
        run(options.voxrole, "phantom", "three-balls", "--dims", ",".join([str(options.edge)] * 3), "-o", volume)
        image = SimpleITK.GetImageFromArray(numpy.ascontiguousarray(nrrd.read(str(volume))[0].transpose(2, 1, 0)))
        for _ in range(options.rounds):
            for quantity in ["2d", "gm"]:
                probe = ["teem-vprobe", "-i", volume, "-k", "scalar", "-q", quantity, "-o", folder / "probe.nrrd"]
                keep(f"vprobe {quantity}", seconds(lambda: run(*probe)))
            keep("ITK gradient", seconds(lambda: SimpleITK.GradientMagnitude(image)))
            if options.edge == 256:
                copy, kernel = kernel_seconds(options.threads)
                keep("copy", copy)
                keep("kernel", kernel)
            for method in METHODS:
                smooth = [] if method == "auto" else ["--smooth", "none"]
                command = [options.voxrole, "prepare", volume, "-o", folder / "out.vxr", "--method", method, *smooth]
                command += ["--threads", options.threads, "--report", report]
                keep(method, seconds(lambda: run(*command)))
                if method == "fast":
                    stages = {stage["name"]: stage["seconds"] for stage in json.loads(report.read_text())["stages"]}
                    keep("derivatives", stages["derivatives"])

    print(f"{options.edge}³, f32, {options.threads} threads, fastest of {options.rounds}:")
    for name, time in best.items():
        print(f"  {name:14} {time:8.4f} s")
    for name in METHODS:
        print(f"  {name}: {best['vprobe 2d'] / best[name]:.1f} times faster than vprobe -q 2d")
    for name in ["kernel", "derivatives"]:
        if name in best:
            ratio = best["ITK gradient"] / best[name]
            print(f"  gradient magnitude and f'', {name}: {ratio:.1f} times faster than ITK's GradientMagnitude")
    if "kernel" in best:
        print(f"  kernel: {best['kernel'] / best['copy']:.1f} times a copy of the same bytes")


if __name__ == "__main__":
    main()
