"""Kills a run of `voxrole prepare` (SIGKILL) at random moments, goes on with it each time, and compares what comes of it.

usage: kill_and_resume.py VOXROLE VOLUME [--kills 20] [--memory 256MiB] [--seed 1] [options of prepare …]

The output must never lie under its own name before it is complete, must verify, and must be byte-identical to that of a run
that nobody stopped. Prints how much longer all runs took together than that one.
"""

import argparse
import hashlib
import json
import pathlib
import random
import subprocess
import tempfile
import time


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("voxrole")
    parser.add_argument("volume")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--memory", default="256MiB")
    parser.add_argument("--seed", type=int, default=1)
    options, others = parser.parse_known_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory(dir=".") as folder:
        folder = pathlib.Path(folder)
        undisturbed = folder / "undisturbed.vxr"
        start = time.monotonic()
        report = prepare(options, others, undisturbed, folder / "report.json")
        assert report.wait() == 0, "the run that nobody stops fails"
        whole = time.monotonic() - start
        blocks = json.loads((folder / "report.json").read_text())["blocks"]
        print(f"undisturbed: {whole:.1f} s, {blocks} blocks")

        killed = folder / "killed.vxr"
        spent, kills = 0.0, 0
        while kills < options.kills:
            # Moments all over the run, be they in the first look, in a block or where the file is put together.
            moment = chance.uniform(0.0, whole / 4.0)
            start = time.monotonic()
            run = prepare(options, others, killed, folder / "report.json")
            try:
                code = run.wait(moment)
            except subprocess.TimeoutExpired:
                run.kill()
                run.wait()
                kills += 1
                spent += time.monotonic() - start
                assert not killed.exists(), "a file lies under the final name before it is complete"
                continue
            assert code == 0, "a run that goes on fails"
            spent += time.monotonic() - start
            compare(options.voxrole, killed, undisturbed)
            print(f"complete after {kills} kills; once more from the beginning")
            killed.unlink()
            spent -= whole
        start = time.monotonic()
        assert prepare(options, others, killed, folder / "report.json").wait() == 0, "the last run fails"
        spent += time.monotonic() - start
        before = json.loads((folder / "report.json").read_text())["blocks_before"]
        compare(options.voxrole, killed, undisturbed)
        left = sorted(path.name for path in folder.iterdir())
        assert left == ["killed.vxr", "report.json", "undisturbed.vxr"], left
        more = spent / whole - 1.0
        print(f"{kills} kills; the last run found {before} of {blocks} blocks finished; same bytes; in all {100 * more:.0f} % more")
        print(f"time than undisturbed, {100 * more / kills:.1f} % for each kill")


def prepare(options, others, output, report):
    line = [options.voxrole, "prepare", options.volume, "-o", output, "--memory", options.memory, "--report", report]
    return subprocess.Popen(line + others, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compare(voxrole, found, expected):
    subprocess.run([voxrole, "verify", found], check=True, stdout=subprocess.DEVNULL)
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (found, expected)]
    assert digests[0] == digests[1], "other bytes than undisturbed"


if __name__ == "__main__":
    main()
