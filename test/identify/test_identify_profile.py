"""Profile likelihood and the two kinds of standard error."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import LUGRE, axis_of, recording, series
from scipy.signal import lfilter

from tcs_friction.errors import InputError
from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.profile import _interval
from tcs_friction.identify.uncertainty import block_bootstrap, sandwich


@pytest.mark.parametrize("source", [series, recording], ids=["torques", "predictions"])
def test_intervals_of_profiles_agree_with_standard_errors_and_hold_the_truth(source: object) -> None:
    data = source(axis_of(), seconds=24.0)  # type: ignore[operator]
    found = identify([data], axis_of(), options=IdentifyOptions(profile=True))
    assert set(LUGRE) <= set(found.profiles)
    for name in ("coulomb", "static", "stiffness"):
        profile, estimate = found.profiles[name], found.parameters[name]
        lower, upper = profile.interval
        assert lower is not None
        assert upper is not None
        assert upper - lower == pytest.approx(2.0 * 1.96 * estimate.std, rel=0.25)
        assert lower < estimate.value < upper
        assert lower - estimate.std < LUGRE[name] < upper + estimate.std
        assert profile.rise[np.argmin(np.abs(profile.values - estimate.value))] == 0.0
    mapping = found.to_mapping()["profiles"]["static"]
    assert len(mapping["values"]) == len(mapping["rise"]) == 7
    assert "profiles" not in identify([data], axis_of()).to_mapping()


def test_an_interval_stays_open_where_the_data_are_indifferent() -> None:
    values = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    lower, upper = _interval(values, np.array([9.0, 4.0, 1.0, 0.0, 0.5, 0.6, 0.7]), 0.0)
    assert lower == pytest.approx(-1.96)
    assert upper is None


def test_bootstrap_and_sandwich_know_coloured_residuals() -> None:
    """A constant and a slow sine under first-order noise: the scatter over 300 noises against both kinds of error."""
    random = np.random.default_rng(2)
    count, decay = 4000, 0.9
    slopes = np.column_stack([np.ones(count), np.sin(np.arange(count) / 150.0)])
    noises = lfilter([1.0], [1.0, -decay], random.standard_normal((300, count)), axis=1)
    true = (noises @ np.linalg.pinv(slopes).T).std(axis=0)
    plain = noises[0].std() / np.linalg.norm(slopes, axis=0)
    for covariance in (
        sandwich(slopes, noises[0], np.ones(count)),
        block_bootstrap(slopes, noises[0], np.ones(count), 1),
    ):
        assert np.sqrt(np.diag(covariance)) == pytest.approx(true, rel=0.3)
    assert (plain < 0.4 * true).all()


def test_bootstrap_on_request() -> None:
    data = series(axis_of(), seconds=24.0)
    plain = identify([data], axis_of())
    again = identify([data], axis_of(), options=IdentifyOptions(uncertainty="bootstrap"))
    for name in ("coulomb", "static", "stiffness"):
        assert again.parameters[name].value == plain.parameters[name].value
        assert again.parameters[name].std == pytest.approx(plain.parameters[name].std, rel=0.4)
    with pytest.raises(InputError, match="sandwich or bootstrap"):
        IdentifyOptions(uncertainty="guess")
