#!/usr/bin/env python3
"""Times whole runs of `voxrole prepare` on the three-ball phantom at growing sizes, with their peak memory; draws both.

Needs matplotlib for the plot, and a built `voxrole`:

    python3 tests/scaling.py target/release/voxrole OUT [--edges 128,256,512,1024] [--methods fast,accurate,auto]
        [--memory 1GiB] [--dtype u16] [--rounds 2]

Writes OUT/scaling.csv and OUT/scaling.png, and prints the table. Volumes are made in OUT and removed again: 2 GiB at 1024³ of u16.
The fastest of the rounds counts; peak memory is what the operating system says of the process.
"""

import argparse
import csv
import json
import os
import subprocess
from pathlib import Path


def prepare(voxrole, volume, folder, method, memory):
    """Seconds, peak memory in bytes, and the report of one run."""
    report = folder / "report.json"
    smooth = [] if method == "auto" else ["--smooth", "none"]
    command = [voxrole, "prepare", volume, "-o", folder / "out.vxr", "--method", method, *smooth]
    command += ["--memory", memory, "--report", report]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([str(part) for part in command], **quiet)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, f"prepare failed on {volume}"
    report = json.loads(report.read_text())
    return report["seconds"], usage.ru_maxrss * 1024, report


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("voxrole", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--edges", default="128,256,512,1024")
    parser.add_argument("--methods", default="fast,accurate,auto")
    parser.add_argument("--memory", default="1GiB")
    parser.add_argument("--dtype", default="u16")
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for edge in map(int, options.edges.split(",")):
        volume = options.out / f"three-balls-{edge}.nrrd"
        made = ["phantom", "three-balls", "--dims", f"{edge},{edge},{edge}", "--dtype", options.dtype, "-o", volume]
        subprocess.run([str(part) for part in [options.voxrole, *made]], check=True, stdout=subprocess.DEVNULL)
        for method in options.methods.split(","):
            runs = [prepare(options.voxrole, volume, options.out, method, options.memory) for _ in range(options.rounds)]
            seconds, peak, report = min(runs, key=lambda run: run[0])
            rows.append({
                "method": method,
                "edge": edge,
                "seconds": round(seconds, 3),
                "ns_per_voxel": round(1e9 * seconds / edge**3, 1),
                "peak_mib": round(peak / 2**20),
                "blocks": report["blocks"],
                "bytes_per_voxel": round(report["file_bytes"] / edge**3, 3),
            })
            print(*rows[-1].values(), sep=" | ", flush=True)
        volume.unlink()
    for name in ["out.vxr", "report.json"]:
        (options.out / name).unlink()
    with open(options.out / "scaling.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, options)


def draw(rows, options):
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, (times, memories) = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for method in options.methods.split(","):
        own = [row for row in rows if row["method"] == method]
        voxels = [row["edge"] ** 3 / 1e6 for row in own]
        times.plot(voxels, [row["seconds"] for row in own], marker="o", label=method)
        memories.plot(voxels, [row["peak_mib"] for row in own], marker="o", label=method)
    for axes, label in [(times, "seconds"), (memories, "peak resident memory, MiB")]:
        axes.set(xscale="log", yscale="log", xlabel="million voxels", ylabel=label)
        axes.grid(True, which="both", alpha=0.3)
    times.legend()
    times.set_title("whole run, file to file")
    memories.set_title(f"--memory {options.memory}")
    figure.savefig(options.out / "scaling.png", dpi=110)


if __name__ == "__main__":
    main()
