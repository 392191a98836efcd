"""YAML files by anybody: whatever they say, reading them is quick, small, and ends with a value or one line."""

from __future__ import annotations

import re
import time
import tracemalloc
from pathlib import Path

import pytest
import yaml

from tcs_friction import yaml_files
from tcs_friction.config import load_axis
from tcs_friction.control.reference import load_reference
from tcs_friction.errors import InputError
from tcs_friction.yaml_files import dump_yaml, load_yaml, parse_yaml

AXIS = "axis: {{inertia: {}, friction: {{law: coulomb_viscous, coulomb: 1.0, viscous: 1.0}}}}\n"


def bomb(levels: int, *, merge: bool = False) -> str:
    """Every line stands for ten times what the one before stands for."""
    lines = ["a0: &a0 {x: 1}" if merge else "a0: &a0 [1]"]
    for k in range(1, levels):
        names = ", ".join([f"*a{k - 1}"] * 10)
        lines.append(f"a{k}: &a{k} {{<<: [{names}]}}" if merge else f"a{k}: &a{k} [{names}]")
    return "\n".join(lines)


def chain(length: int) -> str:
    """Every line is a list around the one before."""
    return "a0: &a0 []\n" + "\n".join(f"a{k}: &a{k} [*a{k - 1}]" for k in range(1, length))


HOSTILE = {
    "a date that is none": (AXIS.format("2001-99-99"), "axis: inertia: '2001-99-99'"),
    "a time that is none": (AXIS.format("!!timestamp 2001-01-01 25:61:61"), "line 1: '2001-01-01 25:61:61' cannot be used"),
    "an integer of 350 digits": (AXIS.format("9" * 350), "line 1: '9999999999999999999999999999999999999999' cannot be used"),
    "an integer of 5000 digits": (AXIS.format("9" * 5000), "line 1: a number of 5000 characters"),
    "minutes without end": (AXIS.format("1" + ":1" * 100_000), "axis: inertia: '1:1:1"),
    "a time of day": (AXIS.format("1:30"), "axis: inertia: '1:30', expected a finite number"),
    "a leading zero": (AXIS.format("017"), "line 1: 017 is to the base 8 for YAML 1.1 and to the base 10 for YAML 1.2, expected"),
    "a word for true": (AXIS.format("yes"), "axis: inertia: 'yes', expected a finite number"),
    "digits with gaps": (AXIS.format("1_000"), "axis: inertia: '1_000', expected a finite number"),
    "minutes called a number": (AXIS.format("!!int 1:30"), "line 1: '1:30' cannot be used as int"),
    "words called numbers": (AXIS.format("!!int x"), "line 1: 'x' cannot be used as int"),
    "nothing called a number": (AXIS.format("!!float ''"), "line 1: '' cannot be used as float"),
    "a word called true": (AXIS.format("!!bool perhaps"), "line 1: 'perhaps' cannot be used as bool"),
    "deep lists": ("[" * 100_000, "line 1: nests too deep"),
    "deep mappings": ("{a: " * 100_000, "line 1: nests too deep"),
    "deep blocks": ("".join(" " * k + "a:\n" for k in range(2000)), "line 33: nests too deep"),
    "deep by aliases": (chain(1000), "line 32: nests too deep"),
    "a list in itself": ("a: &a [*a]", r"line 1: \*a is a part of itself"),
    "aliases of aliases": (bomb(12), "stands for too many values"),
    "merges of merges": (bomb(12, merge=True), "stands for too many values"),
    "many values": ("[" + "1," * 120_000 + "]", "stands for too many values"),
    "much text": ("# " + "x" * yaml_files.LARGEST, "is too large"),
    "a key twice": ("axis:\n  inertia: 1.0\n  name: x\n  inertia: 2.0\n", "line 4: key 'inertia' comes twice"),
    "a key twice in a list": ("- {a: 1, b: {a: 1}, a: 2}", "line 1: key 'a' comes twice"),
    "a long key": ("axis: {? " + "k" * 100_000 + " : 1}", "unknown key"),
    "a long value": (AXIS.format("x" * 100_000), "axis: inertia"),
    "a list for a key": ("? [a]\n: 1\n", "line 1: found unhashable key"),
    "code": ('axis: !!python/object/apply:os.system ["x"]', "could not determine a constructor"),
    "no YAML": ("axis: [1,\n  2", "line 3: is not YAML"),
    "an unknown alias": ("axis: *nobody", "line 1: "),
    "two documents": ("axis: 1\n---\naxis: 2\n", "line 2: is not YAML \\(but found another document"),
    "control characters": ("axis: \0\x1b[31m", "is not YAML"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_cost_one_line(name: str, tmp_path: Path) -> None:
    text, message = HOSTILE[name]
    path = tmp_path / "axis.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"axis\.yaml: .*{message}") as caught:
        load_axis(path)
    assert len(str(caught.value)) < 2100
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("text", [bomb(9), bomb(9, merge=True), "[" * 1_000_000], ids=["aliases", "merges", "depth"])
def test_hostile_files_cost_little_memory(text: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            parse_yaml(text, "here")
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_references_are_read_in_the_same_way(tmp_path: Path) -> None:
    path = tmp_path / "reference.yaml"
    path.write_text("reference: {kind: hold, duration: 2.0, duration: 3.0}")
    with pytest.raises(InputError, match="line 1: key 'duration' comes twice"):
        load_reference(path)
    path.write_text("reference: {kind: [hold]}")
    with pytest.raises(InputError, match="unknown kind"):
        load_reference(path)


def test_time_grows_with_the_size_of_the_file_and_no_faster() -> None:
    """Ten times the values against as many times the time, with room for what the machine does beside."""

    def seconds(count: int) -> float:
        """The least of three times."""
        text, taken = "[" + ", ".join(["{a: 1.5, b: [x, 2]}"] * count) + "]", []
        for _ in range(3):
            begin = time.process_time()
            parse_yaml(text, "here")
            taken.append(time.process_time() - begin)
        return min(taken)

    assert seconds(4_000) < 40 * seconds(400)


TEXTS = ("1e3", "017", "1:30", "yes", "off", "0o17", "2001-01-01", "~", "", "null", "true", "1.", ".inf", "1_0", "<<", "# no")


def test_what_is_written_is_read_back_by_this_and_by_other_readers() -> None:
    content = {"texts": list(TEXTS), "numbers": [17, 1e-5, -1e20, 0.1], "others": [True, None]}
    for flow in (False, None, True):
        written = dump_yaml(content, flow=flow)
        assert parse_yaml(written, "here") == content
        assert yaml.safe_load(written) == content


def test_numbers_are_those_of_the_core_schema() -> None:
    texts = {"1e3": 1000.0, "-.5": -0.5, "1.": 1.0, "+12": 12, "0o17": 15, "0x1F": 31, "0": 0, "-0": 0, "0.5": 0.5, "007.5": 7.5}
    for text, value in texts.items():
        assert parse_yaml(f"x: {text}", "here") == {"x": value}, text
    for text in ("017", "-017", "08", "00"):
        with pytest.raises(InputError, match=r"line 1: .* expected no leading 0, or quotes"):
            parse_yaml(f"x: {text}", "here")
        assert parse_yaml(f"x: '{text}'", "here") == {"x": text}


def test_there_is_no_other_way_to_read_yaml() -> None:
    """Whatever reads YAML of its own does without the bounds of this one."""
    package = Path(yaml_files.__file__).parent
    readers = re.compile(r"yaml\.(\w*load\w*|parse|scan|compose\w*)\(|import \w*Loader|yaml\.\w*Loader")
    files = [path for path in package.rglob("*.py") if readers.search(path.read_text())]
    assert [path.name for path in files] == ["yaml_files.py"]


def test_what_files_may_say_is_still_understood(tmp_path: Path) -> None:
    assert load_yaml(Path(__file__).parents[1] / "config" / "azimuth_1p2m.yaml")["axis"]["inertia"] > 0.0
    text = "base: &b {x: 1, y: 0x10, z: -.inf}\nown: {<<: *b, x: 2}\nday: 2026-11-22\ntwice: [*b, *b]\non: yes\nnone: ~\n"
    content = parse_yaml(text.encode(), "here")
    assert content["own"] == {"x": 2, "y": 16, "z": float("-inf")}
    assert content["day"] == "2026-11-22"
    assert content["twice"] == [content["base"]] * 2
    assert (content["on"], content["none"]) == ("yes", None)
    with pytest.raises(InputError, match="is a directory"):
        load_yaml(tmp_path)
