"""The graph of one axis: ros2 launch tcs_friction axis.launch.py axis:=FILE reference:=FILE clock:=real_time plant:=false

With plant:=mujoco model:=FILE joint:=NAME the axis is a joint of a MuJoCo model.
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
from tcs_friction.nodes.core.base import LOCK_STEP, REAL_TIME
from tcs_friction.nodes.core.files import config_file

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
MUJOCO = "mujoco"
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
    "plant": ("true", f"false: a driver takes the place of the simulated plant; {MUJOCO}: a joint of a model", (*SWITCH, MUJOCO)),
    "model": ("mount_two_axis.xml", "of plant:=mujoco, a path or a name in the package's config folder", ()),
    "joint": ("", "of the model, that is the axis; none: the one that has the axis' name", ()),
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
    """The nodes for the arguments given, then what activates them."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    common = {"axis": given["axis"], "clock": given["clock"], "use_sim_time": given["use_sim_time"] == "true"}
    own = settings(given)
    file = [given["params_file"]] if given["params_file"] else []
    made = {
        name: (LifecycleNode if name in MANAGED else Node)(
            package="tcs_friction",
            executable="mujoco_plant" if name == "plant" and given["plant"] == MUJOCO else name,
            name=name,
            namespace=given["namespace"],
            parameters=[common | own.get(name, {}), *file],
            ros_arguments=["--log-level", given["log_level"]],
            output="screen",
        )
        for name in NODES
        if name != "plant" or given["plant"] != "false"
    }
    managed = [made[name] for name in MANAGED if name in made and given["auto_activate"] == "true"]
    return [*made.values(), *(action for node in managed for action in activation(node))]


def settings(given: dict[str, str]) -> dict[str, dict[str, object]]:
    """The parameters of single nodes; a simulated axis starts where the reference does."""
    own: dict[str, dict[str, object]] = {
        "plant": {
            "start_position": load_reference(config_file(given["reference"])).at(0.0)[0],
            "beside": given["beside"].split(","),
        },
        "reference": {"reference_file": given["reference"]},
        "commission": {
            "reference_file": given["reference"],
            "measure_file": given["measure_file"],
            "simulated": given["plant"] != "false",
        },
    }
    if given["plant"] == MUJOCO:  # which does not tell what of its torques is friction
        own["plant"] |= {"mujoco_model": given["model"], "mujoco_joint": given["joint"], "truth": False}
        own["commission"]["truth"] = False
    for name in RESULTS:
        own.setdefault(name, {})["results"] = given["results"]
    for name in MANAGED:
        own.setdefault(name, {})["auto_activate"] = False
    return own


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
