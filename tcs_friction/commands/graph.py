"""Run the whole graph of an axis, or of several, until it is interrupted: all nodes on one executor, or one process each.

What follows --ros-args goes to every node, for example: ./tcs graph --ros-args -p clock:=real_time
Several axes are each in the namespace of their name: ./tcs graph azimuth_1p2m.yaml altitude_1p2m.yaml
A parameter file speaks to single nodes: --ros-args --params-file FILE, with /altitude/plant: {ros__parameters: {seed: 1}}
Nodes on other machines find it only where the environment says so, for example by ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET.
"""

from __future__ import annotations

import argparse
import contextlib
import sys

from tcs_friction.commands.inputs import MUJOCO, add_plant, check_plant
from tcs_friction.commands.live import PORT, beside, check_packages, port_number
from tcs_friction.errors import InputError
from tcs_friction.nodes.entry import announce_compiling, end_at_once, keep_logs, stay_local

TAKES_ROS_ARGUMENTS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    axis, reference = "azimuth_1p2m.yaml", "azimuth_1p2m_run.yaml"
    parser.add_argument("axis", nargs="*", default=[axis], metavar="AXIS.yaml", help=f"axis files (default: {axis})")
    how = f"reference file, for all axes or for each in their order (default: AXIS_run.yaml beside AXIS.yaml, else {reference})"
    parser.add_argument("--reference", action="append", default=[], metavar="REF.yaml", help=how)
    parser.add_argument("--no-plant", action="store_true", help="a driver takes the place of the simulated plant")
    add_plant(parser)
    parser.add_argument("--realtime", action="store_true", help="real-time clock, and real-time scheduling as far as permitted")
    parser.add_argument("--cores", metavar="2,3", help="with --realtime: the processor cores to use (default: all)")
    parser.add_argument("--monitor", action="store_true", help="the node monitor as well, which tells when physics changes")
    parser.add_argument("--processes", action="store_true", help="one process for each node")
    parser.add_argument("--live", action="store_true", help="and its page, as `live` with the same axes shows it")
    parser.add_argument("--port", type=port_number, help=f"with --live: of the page; 0: any that is free (default: {PORT})")


def run(arguments: argparse.Namespace) -> int:
    """Run the graph."""
    check_plant(arguments)
    if arguments.cores and not arguments.realtime:
        raise InputError("--cores", f"{arguments.cores} without --realtime", "--realtime beside it")
    if arguments.port is not None and not arguments.live:
        raise InputError("--port", f"{arguments.port} without --live", "--live beside it")
    if arguments.live:
        check_packages()
    end_at_once()
    stay_local()
    keep_logs()
    announce_compiling()
    try:
        from tcs_friction.nodes import axes, graph
        from tcs_friction.nodes.core import scheduling
    except ModuleNotFoundError as error:
        raise InputError("graph", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
    driven = ["-p", "simulated:=false"] if arguments.no_plant else []
    if arguments.realtime:
        scheduling.ask(arguments.cores or scheduling.ALL)
        driven += ["-p", "clock:=real_time"]
    plant = "plant"
    if arguments.plant == MUJOCO:
        if len(arguments.axis) > 1:
            raise InputError("--plant mujoco", f"{len(arguments.axis)} axes", "one, whose joint of the model is driven")
        plant = "mujoco_plant"
        driven += graph.mujoco_arguments(arguments.model, arguments.joint)
    by_axis = axes.arguments_by_axis(arguments.axis, arguments.reference, [*driven, *arguments.ros_arguments])
    names = tuple(plant if name == "plant" else name for name in graph.GRAPH if name != "plant" or not arguments.no_plant)
    names += ("monitor",) if arguments.monitor else ()
    place = "one process each" if arguments.processes else "one process"
    whose = f" of {', '.join(by_axis)}" if len(by_axis) > 1 else ""
    print(f"tcs-friction: {', '.join(names)}{whose} in {place}, until Ctrl-C", file=sys.stderr)
    port = PORT if arguments.port is None else arguments.port
    with beside(arguments.axis, arguments.ros_arguments, port) if arguments.live else contextlib.nullcontext():
        return (graph.run_processes if arguments.processes else graph.run_together)(by_axis, names)
