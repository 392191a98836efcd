"""Axis and reference files made to hurt their reader."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from benchmarks.hostile_bags import Maker
from tcs_friction.config import shipped

AXIS = "axis: {{inertia: {}, friction: {{law: coulomb_viscous, coulomb: 1.0, viscous: 1.0}}}}\n"
EFFECTS = "axis: {{inertia: 1.0, friction: {{law: coulomb_viscous, coulomb: 1.0, viscous: 1.0}}, effects: [{}]}}\n"
REFERENCE = "reference: {{kind: multisine, components: {}}}\n"
COGGING = "{{effect: cogging, parameters: {{order: {}, amplitude: 1.0, phase: 0.0}}}}"
SHIPPED = ("azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml", "azimuth_1p2m_response.yaml")


def good(path: Path, _: int, name: str) -> Path:
    """An ordinary file."""
    return written(path, shipped(name).read_text())


def number(path: Path, size: int, text: str, around: str) -> Path:
    """A number that is none, or of many characters."""
    return written(path, around.format(text * size))


def many_effects(path: Path, size: int) -> Path:
    """An axis with `size` effects."""
    return written(path, EFFECTS.format(", ".join(COGGING.format(1 + number) for number in range(size))))


def large_table(path: Path, size: int) -> Path:
    """A learned map of `size` values."""
    table = f"{{coordinates: [position], lower: [0.0], upper: [1.0], values: [{'1.0, ' * size}]}}"
    return written(path, EFFECTS.format(f"{{effect: learned_map, table: {table}}}"))


def doubled(path: Path, size: int, item: str) -> Path:
    """Every line stands for twice what the one before stands for."""
    lines = [f"a{level}: &a{level} {item.format(level - 1)}" for level in range(1, size)]
    return written(path, "\n".join(["a0: &a0 {x: 1}", *lines, "axis: *a0"]))


def repeated(path: Path, size: int, text: str) -> Path:
    """The same text over and over."""
    return written(path, text * size)


def indented(path: Path, size: int) -> Path:
    """A block inside a block, and so on."""
    return written(path, "".join(f"{' ' * level}a:\n" for level in range(size)))


def device(path: Path, _: int) -> Path:
    """A device that never ends."""
    path.symlink_to("/dev/zero")
    return path


def pipe(path: Path, _: int) -> Path:
    """A pipe into which nobody writes."""
    os.mkfifo(path)
    return path


def written(path: Path, text: str) -> Path:
    """The text as a YAML file."""
    path = path.with_suffix(".yaml")
    path.write_text(text)
    return path


NUMBERS = ("9", "1:", "1_", ".inf", "2001-99-99", "!!int x", "!!float ''", "0x", "-", "'9' ", "017", "1:30", "yes", "1e")
REPEATED = ("[", "{a: ", "- ", "a: 1\n", "? ", "&a ", "!!a ", "# \n", "axis: {inertia: 1}\n---\n", "\t", "'", "|\n ", "é")
DOUBLED = ("[*a{0}, *a{0}]", "{{<<: [*a{0}, *a{0}]}}", "[*a{0}]", "{{? *a{0} : 1}}")
CASES: dict[Maker, tuple[int, int]] = {
    **{partial(good, name=name): (1, 1) for name in SHIPPED},
    **{partial(number, text=text, around=around): (1, 100_000) for text in NUMBERS for around in (AXIS, REFERENCE)},
    **{partial(repeated, text=text): (1, 1_000_000) for text in REPEATED},
    **{partial(doubled, item=item): (1, 100_000) for item in DOUBLED},
    many_effects: (1, 20_000), large_table: (1, 200_000), indented: (1, 5_000), device: (1, 1), pipe: (1, 1),
}  # fmt: skip
"""Makers, each with the least and the largest size to draw."""
