"""What a format is asked for and what it gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis


@dataclass(frozen=True)
class Request:
    """An axis on its way into a format.

    axis, source: the axis and the file that it comes from.
    output: where it goes. into: the user's own model, for formats that change one.
    joint: name of the joint in that model, or of the axis in what is made anew.
    period: control period, s.
    speed: fastest (rad/s) over which friction is approximated or tabulated. travel: positions (rad) over which torque is.
    temperatures: degC, of a table. kind: which one, for formats with several.
    compensation: share, rest band and limits of what compensates.
    """

    axis: Axis
    source: Path
    output: Path
    into: Path | None = None
    joint: str = ""
    period: float = 1e-3
    speed: float = 1.0
    travel: tuple[float, float] = (-3.141592653589793, 3.141592653589793)
    temperatures: tuple[float, ...] = (20.0,)
    kind: str = ""
    compensation: CancellationConfig = field(default_factory=CancellationConfig)

    def model(self) -> str:
        """The text of the user's own model. Raises InputError where none is named or it cannot be read."""
        if self.into is None:
            raise InputError("--into", "is missing", "the model that gets the axis")
        try:
            return self.into.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "no UTF-8"
            raise InputError(str(self.into), f"cannot be read ({reason})", "a model in XML") from None


@dataclass(frozen=True)
class Exported:
    """Files by path, and what was said: what was there before, what is approximated how well, what the format cannot express."""

    files: Mapping[Path, str | bytes]
    lines: list[str]
