"""Run one node until it is interrupted; what `ros2 run tcs_friction NAME` does.

What follows --ros-args goes to ROS, for example: ./tcs node plant --ros-args -p axis:=my_axis.yaml -r __ns:=/elevation
Nodes on other machines find it only where the environment says so, for example by ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET.
"""

from __future__ import annotations

import argparse

from tcs_friction.errors import InputError
from tcs_friction.nodes.entry import start, stay_local

TAKES_ROS_ARGUMENTS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("name", help="plant, reference, dob, lugre_compensator, controller, identifier, ...")


def run(arguments: argparse.Namespace) -> int:
    """Run the node."""
    stay_local()
    try:
        return start(arguments.name, arguments.ros_arguments)
    except ModuleNotFoundError as error:
        raise InputError("node", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
