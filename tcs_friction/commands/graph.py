"""Run the whole graph of an axis until it is interrupted: all nodes on one executor, or one process each.

What follows --ros-args goes to every node, for example: ./tcs graph --ros-args -p clock:=real_time
Nodes on other machines find it only where the environment says so, for example by ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET.
"""

from __future__ import annotations

import argparse
import sys

from tcs_friction.commands.inputs import MUJOCO, add_plant, check_plant
from tcs_friction.errors import InputError
from tcs_friction.nodes.entry import announce_compiling, end_at_once, keep_logs, stay_local

TAKES_ROS_ARGUMENTS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis, reference = "azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml"
    parser.add_argument("axis", nargs="?", default=axis, metavar="AXIS.yaml", help="axis file (default: %(default)s)")
    parser.add_argument("--reference", default=reference, metavar="REF.yaml", help="reference file (default: %(default)s)")
    parser.add_argument("--no-plant", action="store_true", help="a driver takes the place of the simulated plant")
    add_plant(parser)
    parser.add_argument("--processes", action="store_true", help="one process for each node")


def run(arguments: argparse.Namespace) -> int:
    """Run the graph."""
    check_plant(arguments)
    end_at_once()
    stay_local()
    keep_logs()
    announce_compiling()
    try:
        from tcs_friction.nodes import graph
    except ModuleNotFoundError as error:
        raise InputError("graph", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
    driven = ["-p", "simulated:=false"] if arguments.no_plant else []
    plant = "plant"
    if arguments.plant == MUJOCO:
        plant, driven = "mujoco_plant", graph.mujoco_arguments(arguments.model, arguments.joint)
    ros_arguments = graph.arguments_for(arguments.axis, arguments.reference, [*driven, *arguments.ros_arguments])
    names = tuple(plant if name == "plant" else name for name in graph.GRAPH if name != "plant" or not arguments.no_plant)
    place = "one process each" if arguments.processes else "one process"
    print(f"tcs-friction: {', '.join(names)} in {place}, until Ctrl-C", file=sys.stderr)
    return (graph.run_processes if arguments.processes else graph.run_together)(ros_arguments, names)
