"""The graph of one axis: ros2 launch tcs_friction axis.launch.py axis:=FILE reference:=FILE clock:=real_time plant:=false

`ros2 launch tcs_friction axis.launch.py --show-args` lists all arguments. The managed nodes are configured and activated
from here.
"""

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from launch import Action, LaunchContext, LaunchDescription
from tcs_friction.control.reference import load_reference
from tcs_friction.nodes.base import LOCK_STEP, REAL_TIME
from tcs_friction.nodes.files import config_file

NODES = (
    "plant",
    "reference",
    "dob",
    "lugre_compensator",
    "controller",
    "identifier",
    "diagnoser",
    "commission",
)
MANAGED = ("plant", "controller")
RESULTS = ("identifier", "diagnoser", "commission")
SWITCH = ("true", "false")
ARGUMENTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "namespace": ("azimuth", "namespace of the axis", ()),
    "axis": ("azimuth_1p2m.yaml", "axis file, a path or a name in the package's config folder", ()),
    "reference": (
        "azimuth_1p2m_run.yaml",
        "reference file, a path or a name in the package's config folder",
        (),
    ),
    "beside": ("", "namespaces of other simulated axes, with commas: launched by themselves, in one time with this one", ()),
    "measure_file": (
        "azimuth_1p2m_measure.yaml",
        "reference on which commissioning measures friction, likewise",
        (),
    ),
    "results": ("results", "directory that results of services and actions go below", ()),
    "clock": (LOCK_STEP, "lock-step simulation, or real time", (LOCK_STEP, REAL_TIME)),
    "plant": ("true", "false: a driver takes the place of the simulated plant", SWITCH),
    "auto_activate": ("true", "false: plant and controller wait, without torque, for ros2 lifecycle", SWITCH),
    "use_sim_time": ("false", "time comes from /clock", SWITCH),
    "log_level": ("info", "what the nodes say", ("debug", "info", "warn", "error", "fatal")),
    "params_file": ("", "YAML file of parameters; what it says wins over the arguments", ()),
}


def generate_launch_description() -> LaunchDescription:
    """One process for each node."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text, choices=list(choices) or None)
        for name, (value, text, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Action]:
    """The nodes for the arguments given, then what activates them; the simulated axis starts where the reference does."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    simulated = given["plant"] == "true"
    common = {"axis": given["axis"], "clock": given["clock"], "use_sim_time": given["use_sim_time"] == "true"}
    own = {
        "plant": {
            "start_position": load_reference(config_file(given["reference"])).at(0.0)[0],
            "beside": given["beside"].split(","),
        },
        "reference": {"reference_file": given["reference"]},
        "commission": {
            "reference_file": given["reference"],
            "measure_file": given["measure_file"],
            "simulated": simulated,
        },
    }
    for name in RESULTS:
        own.setdefault(name, {})["results"] = given["results"]
    for name in MANAGED:
        own.setdefault(name, {})["auto_activate"] = False
    file = [given["params_file"]] if given["params_file"] else []
    made = {
        name: (LifecycleNode if name in MANAGED else Node)(
            package="tcs_friction",
            executable=name,
            name=name,
            namespace=given["namespace"],
            parameters=[common | own.get(name, {}), *file],
            ros_arguments=["--log-level", given["log_level"]],
            output="screen",
        )
        for name in NODES
        if simulated or name != "plant"
    }
    managed = [made[name] for name in MANAGED if name in made and given["auto_activate"] == "true"]
    return [*made.values(), *(action for node in managed for action in activation(node))]


def activation(node: LifecycleNode) -> list[Action]:
    """Configure a managed node as soon as it is there, and activate it when it is configured."""

    def change(transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
        )

    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change(Transition.TRANSITION_ACTIVATE)],
        handle_once=True,
    )
    return [RegisterEventHandler(configured), change(Transition.TRANSITION_CONFIGURE)]
