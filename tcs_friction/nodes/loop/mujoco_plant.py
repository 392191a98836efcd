"""A joint of a MuJoCo model in place of the simulated axis: the same topics, services and clocks, under the same name.

All hinges and slides of the model are in `joint_states`: the chosen one under the axis' name, with what the axis file's encoder
says of it, the others under their own names, as they truly are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import text
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.base import derived
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import config_file
from tcs_friction.nodes.core.wire import Numbers
from tcs_friction.nodes.loop import plant
from tcs_friction.nodes.loop.plant import Plant, PlantConfig
from tcs_friction.physics.mujoco_axis import MujocoSimulator

DEFAULT_MODEL = "mount_two_axis.xml"


@dataclass(frozen=True)
class MujocoPlantConfig(PlantConfig):
    """Settings of the plant, and which joint of which model it is."""

    mujoco_model: str = text(DEFAULT_MODEL, "model, MJCF or URDF: a path or a name in the package's config folder")
    mujoco_joint: str = text("", "hinge or slide in it that is the axis; none: the one that has the axis' name")


def defaults(file: AxisFile) -> MujocoPlantConfig:
    """The settings that an axis file implies."""
    return derived(MujocoPlantConfig, plant.defaults(file))


class MujocoPlant(Plant):
    """A plant whose motion is MuJoCo's; drive and encoder are the axis file's."""

    _simulator: MujocoSimulator

    def __init__(self) -> None:
        super().__init__(defaults)

    def check(self, config: PlantConfig, file: AxisFile) -> None:
        if config.truth:
            found = "true, and MuJoCo does not tell what of its torques is friction"
            raise InputError("mujoco_plant: truth", found, "false; for the node commission too")
        super().check(config, file)

    def _identity(self, config: PlantConfig, file: AxisFile) -> tuple[object, ...]:
        assert isinstance(config, MujocoPlantConfig)
        return *super()._identity(config, file), config.mujoco_model, config.mujoco_joint

    def _make(self, config: PlantConfig, file: AxisFile) -> MujocoSimulator:
        assert isinstance(config, MujocoPlantConfig)
        path, joint = config_file(config.mujoco_model), config.mujoco_joint or file.axis.name
        return MujocoSimulator(file.axis, path, joint, config.period, config.seed, config.start_position)

    def _others(self) -> tuple[tuple[str, ...], Callable[[], tuple[Numbers, Numbers]]]:
        simulator = self._simulator
        for note in simulator.notes:
            self.get_logger().info(note)
        return simulator.other_joints, lambda: (simulator.other_positions(), simulator.other_velocities())


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(MujocoPlant, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
