"""Arguments that several commands take."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcs_friction.commands.parser import name_word
from tcs_friction.errors import InputError
from tcs_friction.recording.choice import Choice, columns_of
from tcs_friction.writable import output_directory

SIMULATED, MUJOCO = "simulated", "mujoco"
MOUNT = "mount_two_axis.xml"
EACH = "all: each of them, in a folder of its own, and one page over all"


def add_recordings(parser: argparse.ArgumentParser, bags: str, axis: str, axis_required: bool = True) -> None:
    """BAG..., --axis and -o; `bags` and `axis` are what the help says of them."""
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help=bags)
    parser.add_argument("--axis", required=axis_required, type=Path, metavar="AXIS.yaml", help=axis)
    parser.add_argument("-o", "--output", required=True, type=output_directory, metavar="DIR", help="where the results go")


def add_reading(parser: argparse.ArgumentParser, joint: bool = True, every: bool = False) -> None:
    """--column, --joint and --strict: what recordings, bags and tables alike, do not say themselves. every: --joint all."""
    add = parser.add_argument
    which = "of a table: which column, by name or number from 1, is time, position, torque, velocity, temperature or reference"
    add("--column", action="append", default=[], metavar="SIGNAL=COLUMN[:UNIT]", help=which)
    if joint:
        which = "which joint of the recording, by name or by number from 0 on"
        add("--joint", type=name_word, default="", metavar="NAME", help=which + (f"; {EACH}" if every else ""))
    add("--strict", action="store_true", help="refuse a recording in which something would have to be mended")


def choice_of(arguments: argparse.Namespace) -> Choice:
    """What --column, --joint and --strict say. Raises InputError for a column that is none."""
    return Choice(columns_of(arguments.column), arguments.joint or "", arguments.strict)


def add_plant(parser: argparse.ArgumentParser) -> None:
    """--plant, --model and --joint: what is moved."""
    what = "whose physics: the axis file's own, or a MuJoCo model's (default: %(default)s)"
    parser.add_argument("--plant", choices=(SIMULATED, MUJOCO), default=SIMULATED, help=what)
    parser.add_argument("--model", metavar="FILE.xml", help=f"MuJoCo: model, a path or a name in config (default: {MOUNT})")
    add_joint(parser)


def add_joint(parser: argparse.ArgumentParser) -> None:
    """--joint: which joint of a MuJoCo model is the axis."""
    which = "MuJoCo: joint that is the axis (default: the one that has its name)"
    parser.add_argument("--joint", type=name_word, default="", metavar="NAME", help=which)


def check_plant(arguments: argparse.Namespace) -> None:
    """Sets the default model. Raises InputError for a model or a joint that no plant is made of."""
    if arguments.plant == MUJOCO:
        if getattr(arguments, "no_plant", False):
            raise InputError("--plant mujoco", "--no-plant as well", "one of the two")
        arguments.model = arguments.model or MOUNT
    elif arguments.model or arguments.joint:
        raise InputError("--model" if arguments.model else "--joint", "given without MuJoCo", "--plant mujoco beside it")
