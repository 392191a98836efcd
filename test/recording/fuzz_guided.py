"""Damage guided by coverage: `PYTHONPATH=. .tcs/venv/bin/python test/recording/fuzz_guided.py [KIND] [libFuzzer options]`.

Needs `.tcs/venv/bin/pip install atheris`. KIND is one of recording_samples.KINDS that is a single file (mcap-zstd unless
named). The corpus is small good bags; every reading must end with a recording or one InputError. libFuzzer's options bound it:
-max_total_time=600 -rss_limit_mb=2048 -timeout=10.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["tcs_friction.recording"], exclude=["tcs_friction.recording.kernels"]):
    from recording_samples import KINDS, SIGNALS, samples, write

    from tcs_friction.errors import InputError
    from tcs_friction.recording.bags import read_recordings


def main() -> None:
    """Hand over to libFuzzer."""
    kind = sys.argv.pop(1) if len(sys.argv) > 1 and sys.argv[1] in KINDS else "mcap-zstd"
    folder = Path(tempfile.mkdtemp())
    corpus = folder / "corpus"
    corpus.mkdir()
    for count in (2, 20, 100):
        good = write(kind, folder / f"good_{count}", samples(count))
        if good.is_dir():
            raise SystemExit(f"{kind} is a directory; expected a kind that is one file")
        (corpus / str(count)).write_bytes(good.read_bytes())
    damaged = folder / f"damaged{good.suffix}"

    def read(data: bytes) -> None:
        damaged.write_bytes(data)
        with contextlib.suppress(InputError):
            read_recordings([damaged], SIGNALS)

    atheris.Setup([*sys.argv, str(corpus)], read)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
