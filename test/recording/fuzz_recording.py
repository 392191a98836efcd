"""Damage good bags at random for a long time.

    PYTHONPATH=. .tcs/venv/bin/python test/recording/fuzz_recording.py [--seconds 600] [--seed 0]

Every reading must end with a recording or one InputError, within seconds and without much memory. The unit tests do
a little of the same with hypothesis.
"""

from __future__ import annotations

import argparse
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from recording_samples import KINDS, SIGNALS, samples, write

from benchmarks.hostile_bags import damaged
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings

SLOW = 10.0  # s
MEMORY = 1 << 30  # bytes beyond the start


def storage(bag: Path) -> list[Path]:
    """The files of a bag."""
    return [bag] if bag.is_file() else sorted(path for path in bag.iterdir())


def run(seconds: float, seed: int) -> int:
    chance = random.Random(seed)
    folder = Path(tempfile.mkdtemp())
    good = {kind: write(kind, folder / kind, samples()) for kind in KINDS}
    for bag in good.values():
        read_recordings([bag], SIGNALS)
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    outcomes: Counter[str] = Counter()
    failures = 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        kind = chance.choice(KINDS)
        copy = folder / f"damaged{good[kind].suffix}"
        (shutil.copytree if good[kind].is_dir() else shutil.copy)(good[kind], copy)
        victim = chance.choice(storage(copy))
        victim.write_bytes(damaged(victim.read_bytes(), chance))
        started = time.process_time()
        try:
            (recording,) = read_recordings([copy], SIGNALS)
            outcomes["read whole" if len(recording) == 400 else "read in part"] += 1
            failed = ""
        except InputError:
            outcomes["refused"] += 1
            failed = ""
        except Exception:
            failed = traceback.format_exc()
        if time.process_time() - started > SLOW:  # of the processor: others may be at work beside
            failed += f"took {time.process_time() - started:.1f} s"
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        if peak - begin > MEMORY:
            failed += f"memory grew by {peak - begin} bytes"
            begin = peak
        if failed:
            failures += 1
            kept = folder / f"failure_{failures}_{copy.name}"
            copy.rename(kept)
            print(f"{kind} {victim.name} kept at {kept}:\n{failed}", file=sys.stderr)
        elif copy.is_dir():
            shutil.rmtree(copy)
        else:
            copy.unlink()
    print(dict(outcomes), f"{failures} failures, peak memory +{(peak - begin) >> 20} MB")
    if not failures:
        shutil.rmtree(folder)
    return 1 if failures else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sys.exit(run(arguments.seconds, arguments.seed))
