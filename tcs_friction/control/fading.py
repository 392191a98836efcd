"""Real time: what appears or goes away does so over a stated time, never in a step."""

from __future__ import annotations

from tcs_friction.control.stamps import SECOND


class Ramp:
    """A factor from 0 to 1 that takes `duration` seconds from one end to the other."""

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self.value = 0.0

    def toward(self, on: bool, elapsed: float) -> float:
        """The factor after `elapsed` more seconds on the way to 1 (on) or 0."""
        if self.value != on:  # there already: the usual case
            step = elapsed / self.duration if self.duration > 0.0 else 1.0
            self.value = min(1.0, self.value + step) if on else max(0.0, self.value - step)
        return self.value


class FadingInput:
    """The latest value of an input that may stop: used while it is young, faded out when it stays away, faded in again."""

    def __init__(self, age_limit: float, fade_time: float) -> None:
        self._ramp = Ramp(fade_time)
        self.configure(age_limit, fade_time)
        self.restart()

    def configure(self, age_limit: float, fade_time: float) -> None:
        """Other times, s."""
        self._limit, self._limit_ns = age_limit, age_limit * SECOND
        self._ramp.duration = fade_time

    def restart(self) -> None:
        """Nothing has come yet."""
        self._value, self._stamp, self._asked = 0.0, -1, -1
        self._ramp.value = self.entered = 0.0
        self.rises = False

    def put(self, value: float, stamp: int) -> None:
        """A new value, of a state's stamp (ns)."""
        self._value, self._stamp = value, stamp

    @property
    def share(self) -> float:
        """What of the value is used, 0 to 1."""
        return self._ramp.value

    def withdraw(self) -> None:
        """Whoever gives the value has none any more: the last one fades out."""
        self._stamp = -1

    def fresh(self, stamp: int) -> bool:
        """Whether the value is young enough at a stamp."""
        return self._stamp >= 0 and abs(stamp - self._stamp) <= self._limit_ns

    def at(self, stamp: int, wanted: bool = True) -> float:
        """What to use at a stamp, faded in or out where it is `wanted` or not; to be asked at every tick.

        `entered` is by how much it has changed since the tick before because it fades; it `rises` where it fades in.
        """
        ramp, used = self._ramp, wanted and (stamp == self._stamp or self.fresh(stamp))
        if ramp.value == used:  # the usual case first: nothing fades
            self._asked = stamp
            if self.entered:
                self.rises, self.entered = False, 0.0
            return self._value if used else 0.0
        elapsed = min(max(stamp - self._asked, 0) / SECOND, self._limit) if self._asked >= 0 else 0.0
        self._asked = stamp
        before = ramp.value
        share = ramp.toward(used, elapsed)
        self.rises, self.entered = share > before, self._value * (share - before)
        return self._value * share

    def at_once(self, stamp: int, wanted: bool = True) -> float:
        """The same with nothing to fade: where everything begins."""
        self._ramp.value, self._asked = float(wanted and self.fresh(stamp)), stamp
        self.rises, self.entered = False, 0.0
        return self._value * self._ramp.value
