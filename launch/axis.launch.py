"""The graph of one axis: ros2 launch tcs_friction axis.launch.py axis:=FILE reference:=FILE clock:=real_time plant:=false"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription
from tcs_friction.control.reference import load_reference
from tcs_friction.nodes.base import config_file

NODES = ("plant", "reference", "dob", "lugre_compensator", "controller", "identifier", "diagnoser", "commission")
ARGUMENTS = {
    "namespace": ("azimuth", "namespace of the axis"),
    "axis": ("azimuth_1p2m.yaml", "axis file, a path or a name in the package's config folder"),
    "reference": ("azimuth_1p2m_run.yaml", "reference file, a path or a name in the package's config folder"),
    "clock": ("lock_step", "lock_step or real_time"),
    "plant": ("true", "false: a driver takes the place of the simulated plant"),
}


def generate_launch_description() -> LaunchDescription:
    """One process for each node."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes for the arguments given; the simulated axis starts where the reference does."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    simulated = given["plant"] == "true"
    own = {
        "plant": {"start_position": load_reference(config_file(given["reference"])).at(0.0)[0]},
        "reference": {"reference_file": given["reference"]},
        "commission": {"reference_file": given["reference"], "simulated": simulated},
    }
    return [
        Node(
            package="tcs_friction",
            executable=name,
            name=name,
            namespace=given["namespace"],
            parameters=[{"axis": given["axis"], "clock": given["clock"]} | own.get(name, {})],
            output="screen",
        )
        for name in NODES
        if simulated or name != "plant"
    ]
