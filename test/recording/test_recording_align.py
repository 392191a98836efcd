"""Several topics on one time base: no bias, nothing carried over gaps, everything said."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording.align import align, held, interpolated
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

START = 1_700_000_000_000_000_000
POSITION = SignalSource("/state", "position")
TORQUE = SignalSource("/drive", "torque")
BESIDE = SignalSource("/state", "effort")
WIND = SignalSource("/wind", "vector.x")


def seconds(values: np.ndarray) -> np.ndarray:
    return START + np.rint(np.asarray(values) * 1e9).astype(np.int64)


def topic(
    source: SignalSource, times: np.ndarray, values: np.ndarray, log: np.ndarray | None = None, header: bool = True
) -> TopicColumns:
    stamps = seconds(times)
    log_times = stamps if log is None else seconds(log)
    return TopicColumns(source.topic, log_times, stamps if header else None, {source: np.asarray(values, dtype=float)})


def both(position: TopicColumns, torque: TopicColumns) -> Recording:
    return align({"/state": position, "/drive": torque}, SignalMap(POSITION, TORQUE), "bag")


T = np.arange(1000) * 1e-3


def state(values: dict[SignalSource, np.ndarray], times: np.ndarray = T, log: np.ndarray | None = None) -> TopicColumns:
    return TopicColumns("/state", seconds(times if log is None else log), seconds(times), values)


def test_signals_of_one_message_are_not_resampled() -> None:
    random = np.random.default_rng(0)
    position, torque = random.standard_normal((2, 1000))
    columns = {"/state": state({POSITION: position, BESIDE: torque})}
    recording = align(columns, SignalMap(POSITION, BESIDE), "bag")
    assert np.array_equal(recording.position, position)
    assert np.array_equal(recording.torque, torque)
    assert recording.t[-1] == pytest.approx(0.999, abs=1e-12)


def test_a_slower_torque_is_held_without_delay_or_lead() -> None:
    torque_times = np.arange(0, 1.0, 0.01)
    recording = both(topic(POSITION, T, np.sin(T)), topic(TORQUE, torque_times, np.arange(100.0)))
    assert np.array_equal(recording.torque, np.floor(np.round(recording.t * 100.0, 6)))
    assert any("torque: held from /drive" in note for note in recording.notes)


def test_a_faster_torque_is_the_last_one_at_or_before() -> None:
    fine = np.arange(0, 1.0, 1e-4)
    recording = both(topic(POSITION, T, np.sin(T)), topic(TORQUE, fine, fine))
    assert np.allclose(recording.torque, recording.t, atol=1e-9)


def test_other_signals_are_interpolated_without_bias() -> None:
    times = np.arange(-0.05, 1.1, 0.037)
    columns = {"/state": state({POSITION: np.sin(T), BESIDE: np.cos(T)}), "/wind": topic(WIND, times, 3.0 * times)}
    recording = align(columns, SignalMap(POSITION, BESIDE, exogenous={"wind": WIND}), "bag")
    assert np.allclose(recording.exogenous["wind"], 3.0 * recording.t, atol=1e-9)


def test_no_value_is_carried_over_a_gap() -> None:
    known = seconds(np.array([0.0, 0.1, 5.0, 5.1]))
    limit = 10**9
    wanted = seconds(np.array([0.05, 0.5, 2.0, 4.9, 5.05, 5.9, 7.0]))
    values = np.array([1.0, 2.0, 3.0, 4.0])
    assert held(wanted, known, values, limit).tolist()[:2] == [1.0, 2.0]
    assert np.isnan(held(wanted, known, values, limit)).tolist() == [False, False, True, True, False, False, True]
    lines = interpolated(wanted, known, values, limit)
    assert lines[0] == pytest.approx(1.5)
    assert np.isnan(lines).tolist() == [False, True, True, True, False, False, True]


def test_gaps_cut_the_recording_and_are_counted() -> None:
    keep = np.concatenate((np.arange(300), np.arange(400, 700), np.arange(705, 1000)))
    times = T[keep]
    recording = align({"/state": state({POSITION: times, BESIDE: times}, times)}, SignalMap(POSITION, BESIDE), "bag")
    assert recording.segments == (slice(0, 300), slice(300, 895))
    text = " | ".join(recording.notes)
    assert "105 messages missing" in text
    assert "1 gap longer than 0.01 s (10 usual periods), longest 0.101 s" in text


def test_samples_that_are_not_finite_are_cut_out_as_gaps() -> None:
    torque = np.cos(T)
    torque[500:503] = [np.nan, np.inf, -np.inf]
    recording = align({"/state": state({POSITION: T, BESIDE: torque})}, SignalMap(POSITION, BESIDE), "bag")
    assert len(recording) == 997
    assert recording.segments == (slice(0, 500), slice(500, 997))
    assert "mended: torque: 3 of 1000 samples missing or not finite, cut as gaps" in recording.notes


def test_a_velocity_of_nothing_but_nan_is_no_velocity() -> None:
    velocity = SignalSource("/state", "velocity")
    columns = {"/state": state({POSITION: T, BESIDE: T, velocity: np.full(1000, np.nan)})}
    recording = align(columns, SignalMap(POSITION, BESIDE, velocity), "bag")
    assert recording.velocity is None
    assert len(recording) == 1000


def test_an_optional_signal_that_is_mostly_missing_does_not_cost_the_recording() -> None:
    columns = {"/state": state({POSITION: T, BESIDE: T}), "/wind": topic(WIND, T[:300], T[:300])}
    recording = align(columns, SignalMap(POSITION, BESIDE, exogenous={"wind": WIND}), "bag")
    assert len(recording) == 1000
    assert "wind" not in recording.exogenous
    assert any(note.startswith("mended: wind: 690 of 1000 samples missing") for note in recording.notes)
    columns["/wind"] = topic(WIND, T[:700], T[:700])
    recording = align(columns, SignalMap(POSITION, BESIDE, exogenous={"wind": WIND}), "bag")
    assert len(recording) == len(recording.exogenous["wind"]) == 710


def test_a_torque_of_nothing_but_nan_is_an_error() -> None:
    columns = {"/state": state({POSITION: T, BESIDE: np.full(1000, np.nan)})}
    with pytest.raises(InputError, match="no finite torque sample"):
        align(columns, SignalMap(POSITION, BESIDE), "bag")


def test_empty_headers_fall_back_to_the_log_time() -> None:
    columns = TopicColumns("/state", seconds(T), np.zeros(1000, dtype=np.int64), {POSITION: T, BESIDE: T})
    recording = align({"/state": columns}, SignalMap(POSITION, BESIDE), "bag")
    assert recording.duration == pytest.approx(0.999)
    assert "time base: log times of /state" in recording.notes
    assert any("header stamps are empty" in note for note in recording.notes)


def test_a_topic_without_header_is_moved_onto_the_header_clock() -> None:
    """Both topics reach the recorder 40 ms late; only one says when it was measured."""
    columns = {
        "/state": state({POSITION: T}, T, T + 0.04),
        "/drive": topic(TORQUE, T + 0.04, T, header=False),
    }
    recording = align(columns, SignalMap(POSITION, TORQUE), "bag")
    assert np.allclose(recording.torque, recording.t, atol=1e-9)
    assert any("moved by -0.040000 s" in note for note in recording.notes)


def test_header_clocks_that_differ_meet_in_the_log_time() -> None:
    """The drive's clock counts from its own start."""
    columns = {
        "/state": state({POSITION: T}, T, T + 0.002),
        "/drive": topic(TORQUE, T - 1.6e9, T, log=T + 0.002),
    }
    recording = align(columns, SignalMap(POSITION, TORQUE), "bag")
    assert np.allclose(recording.torque, recording.t, atol=1e-6)
    assert any("on another clock" in note for note in recording.notes)


def test_a_torque_topic_that_ends_early_ends_the_recording() -> None:
    recording = both(topic(POSITION, T, T), topic(TORQUE, T[:500], T[:500]))
    assert len(recording) == pytest.approx(510, abs=1)


def test_torque_elsewhere_in_time_is_an_error() -> None:
    with pytest.raises(InputError, match="no finite torque sample"):
        both(topic(POSITION, T, T), topic(TORQUE, T + 0.5e9 * 0 + 100.0, T))


def test_temperature_may_be_slow_but_not_absent_for_long() -> None:
    source = SignalSource("/temperature", "temperature")
    columns = {
        "/state": state({POSITION: T, BESIDE: T}),
        "/temperature": topic(source, np.array([0.4]), np.array([17.0])),
    }
    recording = align(columns, SignalMap(POSITION, BESIDE, temperature=source), "bag")
    assert recording.temperature is not None
    assert set(recording.temperature.tolist()) == {17.0}
