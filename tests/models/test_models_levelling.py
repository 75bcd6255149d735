"""Levelling of a body at rest, against attitudes that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.levelling import pitch_and_roll, yaw_of_field
from pipeline.models.navigation_problem import EarthField
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll
from pipeline.numerics.rotation import matrix_from_quaternion, wrapped

ANGLE = st.floats(-3.1, 3.1)
PITCH = st.floats(-1.5, 1.5)


@given(ANGLE, PITCH, ANGLE)
def test_gravity_and_field_tell_the_attitude(yaw: float, pitch: float, roll: float) -> None:
    C = matrix_from_quaternion(quaternion_from_yaw_pitch_roll([yaw, pitch, roll]))
    field = EarthField(52e-6, np.deg2rad(71.0), np.deg2rad(11.0))
    force = C.T @ np.array([0.0, 0.0, -9.81])
    found = pitch_and_roll(force)
    # roundings of 1e-16, magnified by 1/cos(pitch) = 14 in roll; and in yaw by that and 1/cos(dip) = 3
    assert found == pytest.approx((pitch, roll), abs=2e-14)
    north = yaw_of_field(C.T @ field.ned, *found, field.declination)
    assert float(wrapped(north - yaw)) == pytest.approx(0.0, abs=1e-13)


def test_a_bias_tilts_by_its_part_of_gravity() -> None:
    pitch, roll = pitch_and_roll([0.15, -0.15, -9.81])
    # b/g to first order; the third, (b/g)^3/3, is 1e-6
    assert (pitch, roll) == pytest.approx((0.15 / 9.81, 0.15 / 9.81), abs=3e-6)
