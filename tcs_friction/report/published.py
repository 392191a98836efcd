"""The paper's own numbers, as corrected in docs/paper-errata.md."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from tcs_friction.control.tracking import TrackingErrors

# Table 3, arcsec. The printed columns are slipped.
BEFORE = TrackingErrors(0.8926, -0.8881, 0.1155, 0)
AFTER = TrackingErrors(0.2252, -0.3984, 0.0737, 0)

DOB_ACCURACY = 0.9694
RMSE_PSO_GA = 2.573  # N m, against the friction observed
RMSE_PSO = 5.152  # N m
POINTS = 4600  # friction-speed points a direction
SPEEDS = (1.0, 0.1, 0.0005, 0.00025, 0.0002, 0.00019375, 0.0001875, 0.000175, 0.00015, 0.0001)  # deg/s

# Table 2: name -> (CCW, CW, unit as it should have been printed).
TABLE_2: Mapping[str, tuple[float, float, str]] = MappingProxyType(
    {
        "stiffness": (5.17e3, 5.15e3, "N m/deg"),
        "damping": (10.12e5, 10.13e5, "N m s/deg"),
        "viscous": (9.99, 9.93, "N m s/deg"),
        "stribeck_velocity": (0.035, 0.033, "deg/s"),
        "coulomb": (78.10, 78.07, "N m"),
        "static": (117.17, 117.11, "N m"),
    }
)
SYMBOLS: Mapping[str, str] = MappingProxyType(
    {
        "stiffness": "σ₀",
        "damping": "σ₁",
        "viscous": "σ₂",
        "stribeck_velocity": "ω_S",
        "coulomb": "M_c",
        "static": "M_S",
    }
)
# Eq. 10 as the speed loop's plant: second v'' + first v' + constant v = u.
PLANT = (0.0003, 0.1082, 39.3918)
