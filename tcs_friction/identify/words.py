"""What an identification says beside its numbers."""

from __future__ import annotations

from collections.abc import Mapping

from tcs_friction.conditioning.hold import Between
from tcs_friction.identify.models import depends_on_law, reads_load
from tcs_friction.identify.result import RISING, Estimate, TorqueTiming
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Place

AS_STATED = "as stated"

def rising(axis: Axis, parameters: Mapping[str, Estimate]) -> tuple[str, ...]:
    """That the identified law has no stiction, if so. Of a law that depends on the load these two parameters do not tell it."""
    static, coulomb = parameters.get("static"), parameters.get("coulomb")
    if static is None or coulomb is None or not (static.determined and coulomb.determined) or reads_load(axis):
        return ()
    if static.value >= coulomb.value:
        return ()
    sizes = f"static {static.value:.4g} {static.unit} is below coulomb {coulomb.value:.4g} {coulomb.unit}"
    return (f"{RISING}: {sizes}",)


def not_searched(axis: Axis) -> tuple[str, ...]:
    """The effects that the cost of a population method leaves out: compiled LuGre friction knows none that act on friction."""
    if axis.friction.term.id != "lugre" or not depends_on_law(axis):
        return ()
    names = ", ".join(item.term.id for item in axis.effects if item.term.place in (Place.SCALE, Place.SENSOR))
    return (f"the search itself knows nothing of {names}; --refine does",)


def when_torque_acts(timing: TorqueTiming | None, period: float) -> tuple[str, ...]:
    """A line that says when a torque acts that is logged every `period` s; none where that is stated."""
    if timing is None or timing.acts.reason == AS_STATED:
        return ()
    if not timing.acts.determined:
        return (f"when the torque acts is not told: the values allow for anywhere within the {1e3 * period:.3g} ms of a sample",)
    acts, std = 1e3 * timing.acts.value, 1e3 * timing.acts.std
    held = "goes on a line to the next" if timing.between == Between.LINE.value else "is held"
    begins = f"the logged torque begins to act {acts:.3g} ± {std:.2g} ms after its stamp"
    return (f"{begins} and {held} (a sample: {1e3 * period:.3g} ms)",)
