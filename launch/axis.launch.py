"""The whole graph of one axis: ros2 launch tcs_friction axis.launch.py axis:=FILE reference:=FILE clock:=lock_step"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

NODES = ("plant", "reference", "dob", "lugre_compensator", "controller", "identifier", "diagnoser", "commission")
ARGUMENTS = {
    "namespace": ("azimuth", "namespace of the axis"),
    "axis": ("azimuth_1p2m.yaml", "axis file, a path or a name in the package's config folder"),
    "reference": ("azimuth_1p2m_run.yaml", "reference file, a path or a name in the package's config folder"),
    "clock": ("lock_step", "lock_step or real_time"),
}


def generate_launch_description() -> LaunchDescription:
    """One process for each node."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()]
    parameters = {"axis": LaunchConfiguration("axis"), "clock": LaunchConfiguration("clock")}
    nodes = [
        Node(
            package="tcs_friction",
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[parameters | ({"reference_file": LaunchConfiguration("reference")} if name == "reference" else {})],
            output="screen",
        )
        for name in NODES
    ]
    return LaunchDescription([*declared, *nodes])
