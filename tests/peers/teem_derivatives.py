#!/usr/bin/env python3
"""Compares gradient magnitude and second directional derivative with teem's vprobe.

Needs `teem-vprobe` (Debian package teem-apps), numpy and pynrrd, and a built `voxrole`:

    python3 tests/peers/teem_derivatives.py target/release/voxrole FOLDER_WITH_REAL_DATA

At grid points teem's default kernels are central differences, so both programs must agree away from the border, where the
rules differ. The largest difference is given relative to the field's maximum; the limit is 1e-5.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import nrrd
import numpy

LIMIT = 1e-5
VOLUMES = {"tooth": "tooth/tooth.nhdr", "ch2": "ch2/ch2.nii.gz"}
QUANTITIES = {"gradient-magnitude": "gm", "second-derivative": "2d"}


def run(*command):
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main():
    voxrole, data = Path(sys.argv[1]), Path(sys.argv[2])
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for name, path in VOLUMES.items():
            packed, value = folder / f"{name}.vxr", folder / f"{name}.nrrd"
            run(voxrole, "prepare", data / path, "-o", packed, "--method", "fast", "--keep", "derivatives")
            run(voxrole, "export", packed, "--field", "value", "-o", value)
            for field, quantity in QUANTITIES.items():
                ours, theirs = folder / "ours.nrrd", folder / "theirs.nrrd"
                run(voxrole, "export", packed, "--field", field, "-o", ours)
                run("teem-vprobe", "-i", value, "-k", "scalar", "-q", quantity, "-o", theirs)
                inside = (slice(2, -2),) * 3
                ours, theirs = nrrd.read(str(ours))[0][inside], nrrd.read(str(theirs))[0][inside]
                # Where the gradient is 0 there is no direction: teem gives NaN or 0, we give 0.
                theirs = numpy.nan_to_num(theirs.astype(numpy.float64))
                difference = numpy.abs(ours - theirs).max() / numpy.abs(theirs).max()
                failed |= not difference <= LIMIT
                print(f"{name:8} {field:20} largest difference {difference:.2e} of the maximum {numpy.abs(theirs).max():.6g}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
