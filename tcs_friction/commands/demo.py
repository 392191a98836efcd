"""The main job, end to end, on the node graph: measure an axis, identify its friction, compensate it, measure again.

Prints Table 3's rows beside the paper's; leaves bags, identification.json, axis.yaml, commission.json, pictures and report.html.
"""

from __future__ import annotations

import argparse
import json

from tcs_friction.commands.inputs import MUJOCO, add_plant, check_plant
from tcs_friction.commands.status_line import status_line
from tcs_friction.errors import InputError
from tcs_friction.report.commission import console_table
from tcs_friction.writable import output_directory

BAR = 30
AXIS, MOUNT_AXIS = "azimuth_geared.yaml", "mount_azimuth.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    where = "where it goes (default: %(default)s)"
    parser.add_argument("-o", "--output", type=output_directory, default="demo", metavar="DIR", help=where)
    parser.add_argument("--axis", help=f"axis file (default: {AXIS}, of the shipped MuJoCo model {MOUNT_AXIS})")
    parser.add_argument("--reference", default="azimuth_geared_run.yaml", help="tracking run (default: %(default)s)")
    add_plant(parser)
    parser.add_argument("--processes", action="store_true", help="one process for each node")
    parser.add_argument("--seed", type=int, default=0, help="of noise and search (default 0)")
    parser.add_argument("--json", action="store_true", help="print commission.json")


def run(arguments: argparse.Namespace) -> None:
    """Run it and print."""
    check_plant(arguments)
    mujoco = (arguments.model, arguments.joint) if arguments.plant == MUJOCO else None
    try:
        from tcs_friction.nodes.own_graph import commission
    except ModuleNotFoundError as error:
        raise InputError("demo", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
    if arguments.output.exists() and any(arguments.output.iterdir()):
        raise InputError(str(arguments.output), "is not empty", "a new directory (-o DIR)")
    with status_line() as show:
        result = commission(
            arguments.axis or (MOUNT_AXIS if mujoco else AXIS),
            arguments.reference,
            arguments.output,
            arguments.processes,
            lambda share, stage: show(bar(share, stage)),
            seed=arguments.seed,
            mujoco=mujoco,
        )
    if arguments.json:
        print(json.dumps(result.to_mapping(), allow_nan=False))
        return
    print(console_table(result))
    observed = result.dob_relative_error
    if observed is not None:
        print(f"friction seen by the observer: {100.0 * (1.0 - observed):.2f} % accurate (paper 96.94 %)")
    print(f"{result.seconds:.0f} s")
    print(arguments.output / "report.html")


def bar(share: float, stage: str) -> str:
    """Progress as a bar.

    >>> bar(0.5, "measuring")
    '[###############...............]  50 %  measuring'
    """
    filled = round(BAR * share)
    return f"[{'#' * filled}{'.' * (BAR - filled)}] {100.0 * share:3.0f} %  {stage}"
