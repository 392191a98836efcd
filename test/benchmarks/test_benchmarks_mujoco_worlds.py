"""Worlds on MuJoCo: each can be built, moves, is converged, and what the engine makes is what the truth says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks import mujoco_worlds
from benchmarks.mujoco_axis import run
from benchmarks.mujoco_effects import EFFECTS, Setting
from benchmarks.mujoco_motion import Motion
from benchmarks.mujoco_surroundings import SURROUNDINGS
from benchmarks.mujoco_worlds import BASES, draw, names, world
from tcs_friction.recording.recording import Recording

pytest.importorskip("mujoco")

SECONDS = 1.0
ALL = {**EFFECTS, **SURROUNDINGS}


def cut(motion: Motion, seconds: float = SECONDS) -> Motion:
    """The fastest stretch of a motion, from rest."""
    count = int(seconds / motion.period)
    power = np.cumsum(motion.velocity**2)
    first = int(np.argmax(power[count:] - power[:-count]))
    velocity = motion.velocity[first : first + count] * np.clip(np.arange(count) * motion.period, 0.0, 1.0)
    position = motion.position[first] + np.cumsum(velocity) * motion.period
    return Motion(motion.period, position, velocity, np.gradient(velocity, motion.period))


def drawn(name: str, telescope: bool, seed: int = 0) -> Setting:
    """An axis with one effect, and a few seconds of motion."""
    setting = draw(np.random.default_rng(seed), telescope, False, False)
    setting.motion = cut(setting.motion)
    if name:
        ALL[name](setting)
    return setting


def moved(setting: Setting, refine: int = 1) -> Recording:
    return run(
        setting.model,
        setting.motion,
        setting.loop,
        np.random.default_rng(1),
        0.0,
        setting.exogenous,
        refine=refine,
    )


@cache
def plain(telescope: bool) -> Recording:
    """The same axis and motion without any effect."""
    return moved(drawn("", telescope))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_there_are_enough_worlds_of_both_classes_and_nothing_missing_in_some() -> None:
    listed = names()
    assert len(listed) == len(set(listed)) >= 40
    nothing = [name for name in listed if "-nothing" in name]
    assert len(nothing) >= 10
    for of in ("telescope", "robot"):
        assert sum(name.startswith(of) for name in listed) >= 20
    for name in listed:
        parts = name.partition("-")[2].split("+")
        assert all(part in {*BASES, *ALL, "dry"} for part in parts), name


@pytest.mark.parametrize("telescope", [True, False], ids=["telescope", "robot"])
@pytest.mark.parametrize("name", ["", *ALL])
def test_every_part_can_be_built_and_is_felt(name: str, telescope: bool) -> None:
    """The loop follows its reference, and the torque is another one than without the part."""
    if name == "wind" and not telescope:
        pytest.skip("wind blows on telescopes")
    setting = drawn(name, telescope)
    recording = moved(setting)
    followed = rms(recording.position - setting.motion.position)
    assert followed < 0.1 * rms(setting.motion.position - setting.motion.position.mean())
    if name:
        assert rms(recording.torque - plain(telescope).torque) > 0.3 * setting.floor


@pytest.mark.parametrize("name", ["", "mode", "spring"])
@pytest.mark.parametrize("telescope", [True, False], ids=["telescope", "robot"])
def test_half_the_step_changes_nothing_that_can_be_seen(name: str, telescope: bool) -> None:
    """Motion within the noise of the encoder, torque far below that of the drive."""
    setting = drawn(name, telescope)
    seen = setting.loop.encoder_noise
    # Without the encoder's steps, which turn over at a rounding
    setting.loop = replace(setting.loop, encoder_noise=0.0, resolution=1e-13)
    coarse, fine = moved(setting), moved(setting, refine=2)
    assert rms(coarse.position - fine.position) < seen
    assert rms(coarse.torque - fine.torque) < 0.1 * setting.floor


def test_same_name_and_seed_same_world(monkeypatch: pytest.MonkeyPatch) -> None:
    real = mujoco_worlds.draw

    def short(*arguments: object) -> Setting:
        setting = real(*arguments)  # type: ignore[arg-type]
        setting.motion = cut(setting.motion, 2.0)
        return setting

    monkeypatch.setattr(mujoco_worlds, "draw", short)
    one, two = world("robot-gravity+cogging", 3), world("robot-gravity+cogging", 3)
    assert np.array_equal(one.recording.torque, two.recording.torque)
    assert one.believed.axis == two.believed.axis
    assert {ids[0] for ids in one.expected.effects} == {"imbalance", "cogging"}
    assert world("robot-gravity+cogging", 4).believed.axis.inertia != one.believed.axis.inertia
    known = world("telescope-nothing-known-gravity", 3)
    assert known.expected.nothing
    assert [item.term.id for item in known.believed.axis.effects] == ["imbalance"]
    outside = world("telescope-stop", 3)
    assert outside.expected.outside
