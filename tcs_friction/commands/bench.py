"""Run a benchmark, or all of them: speed and quality beside other tools, on this machine."""

from __future__ import annotations

import argparse
import importlib
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from tcs_friction.commands.parser import parser_of
from tcs_friction.diagnose.parallel import cores
from tcs_friction.errors import InputError, nearest
from tcs_friction.report.numbers import aligned


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments; what follows the name is the benchmark's own."""
    parser.add_argument("--json", action="store_true", help="one JSON object per benchmark on stdout")
    parser.add_argument("name", nargs="?", help="which one (default: all); NAME --help shows its options")
    parser.add_argument("options", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)


def run(arguments: argparse.Namespace) -> None:
    """Run and print."""
    known = available()
    if arguments.name is not None and arguments.name not in known:
        raise InputError("bench", f"no benchmark {arguments.name!r}", nearest(arguments.name, list(known)))
    for name in [arguments.name] if arguments.name else known:
        module = importlib.import_module(f"benchmarks.{name}")
        options = _options(name, module, arguments.options)
        if sys.stderr.isatty():
            print(f"{name}: {known[name]} ...", file=sys.stderr)
        report = {"benchmark": name, "results": module.run(options), "machine": machine()}
        if arguments.json or options.json:
            print(json.dumps(report), flush=True)
        else:
            print(table(report), flush=True)


def available() -> dict[str, str]:
    """Benchmarks that this checkout has: name -> what it measures. InputError outside a checkout."""
    try:
        package = importlib.import_module("benchmarks")
        listed: Mapping[str, str] = package.BENCHMARKS
    except (ImportError, AttributeError):
        raise InputError("bench", "no benchmarks here", "the repository's own ./tcs bench") from None
    folder = Path(package.__path__[0])
    return {name: what for name, what in listed.items() if (folder / f"{name}.py").is_file()}


def _options(name: str, module: ModuleType, words: Sequence[str]) -> argparse.Namespace:
    parser = parser_of(f"bench {name}", module)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    return parser.parse_args(words)


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    return {
        "processor": _processor(),
        "cores": cores(),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def table(report: Mapping[str, Any]) -> str:
    """The results as aligned text: what, ours, the other's, how many times."""
    rows = [("", "here", "beside", "ratio")]
    for entry in report["results"]:
        unit = "" if entry.get("unit") in (None, "", "1") else f" {entry['unit']}"
        ratio, error = entry.get("ratio"), entry.get("error")
        scatter = "" if error is None else f" ± {error:.2g}"
        rows.append(
            (
                str(entry["name"]),
                f"{_figure(entry['value'])}{scatter}{unit}",
                _figure(entry.get("beside")),
                "" if ratio is None else f"{_figure(ratio)} x",
            )
        )
    title = f"{report['benchmark']}  ({report['machine']['processor']}, {report['machine']['cores']} cores)"
    return "\n".join([title, *aligned(rows)])


def _figure(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
