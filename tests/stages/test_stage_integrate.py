"""Integrate: the attitude of an exact motion, where it begins, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.models.coning import ConingMotion
from pipeline.numerics.rotation import quaternion_from_euler_krylov, quaternion_multiply, wrapped
from pipeline.stages import integrate
from pipeline.stages.base import StageError, Stand

Float = NDArray[np.float64]
Time = NDArray[np.int64]

MOTION = ConingMotion(cone_angle=np.radians(10.0), frequency=2.0)
START = 1_700_000_000_000_000_000
STEP = 1_000_000
METHODS = ["quaternion", "euler_krylov"]

ACCURATE = 1e-8
"""Fourth-order rules at w h = 0.0126: (w h)**4 = 2.5e-8, times a tenth of a radian."""


def seconds(time: Time) -> Float:
    return np.asarray((time - START) / 1e9, dtype=np.float64)


def clock(count: int) -> Time:
    return START + STEP * np.arange(count, dtype=np.int64)


def rates(*segments: Time) -> pa.Table:
    """Exact rates and increments of the motion."""
    parts: list[dict[str, Any]] = []
    for number, time in enumerate(segments):
        t = seconds(time)
        w = MOTION.rates(t)
        a = np.concatenate([np.zeros((1, 3)), MOTION.increments(t[:-1], t[1:])])
        columns = {"time": time, "segment": np.full(len(time), number)}
        columns |= {axis: w[:, k] for k, axis in enumerate("pqr")}
        columns |= {"increment_" + axis: a[:, k] for k, axis in enumerate("pqr")}
        parts.append(columns)
    return contracts.table("rates", {key: np.concatenate([p[key] for p in parts]) for key in parts[0]})


def reference(time: Time, angles: Float | None = None) -> pa.Table:
    if angles is None:
        angles = MOTION.angles(seconds(time))
    none = [None] * len(time)
    clocks = {"time": time, "header_stamp": none, "log_time": none, "publish_time": none}
    columns = {name: angles[:, k] for k, name in enumerate(("psi", "theta", "gamma"))}
    return contracts.table("reference", {**clocks, **columns})


def run(tables: dict[str, pa.Table], **settings: Any) -> tuple[pa.Table, Float, list[dict[str, Any]]]:
    out = integrate.run(tables, integrate.Settings(**settings), Stand())
    attitude = out["attitude"]
    angles = np.stack([attitude.column(name).to_numpy() for name in ("psi", "theta", "gamma")], axis=1)
    return attitude, angles, out["findings"].to_pylist()


def close(found: Float, expected: Float, atol: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


@pytest.mark.parametrize("method", METHODS)
class TestBothMethods:
    def test_give_the_motion_from_the_reference(self, method: str) -> None:
        time = clock(1501)
        attitude, angles, findings = run({"rates": rates(time), "reference": reference(time)}, method=method)
        close(angles, MOTION.angles(seconds(time)), ACCURATE)
        assert findings == []
        assert attitude.schema.equals(contracts.contract("attitude").schema)
        assert attitude.column("time").to_pylist() == time.tolist()

    def test_give_the_motion_from_the_plan_s_angles(self, method: str) -> None:
        time = clock(1501)
        start = tuple(MOTION.angles(np.zeros(1))[0])
        _, angles, findings = run(
            {"rates": rates(time)}, method=method, initial="angles", initial_angles=start
        )
        close(angles, MOTION.angles(seconds(time)), ACCURATE)
        assert findings == []

    def test_begin_each_segment_anew(self, method: str) -> None:
        first, second = clock(500), clock(1500)[700:]
        tables = {"rates": rates(first, second), "reference": reference(clock(1501))}
        attitude, angles, findings = run(tables, method=method)
        truth = MOTION.angles(seconds(np.concatenate([first, second])))
        close(angles, truth, ACCURATE)
        assert findings == []
        assert attitude.column("segment").to_pylist() == [0] * 500 + [1] * 800


class TestStart:
    def test_reference_is_interpolated_to_the_start(self) -> None:
        time = clock(1000)
        slow = START - 92_345_678 + 20 * STEP * np.arange(60, dtype=np.int64)  # 50 Hz, at other times
        _, angles, findings = run({"rates": rates(time), "reference": reference(slow)})
        # local cubic at 20 ms, w h = 0.25: 3/128 (w h)**4 of 0.17 rad = 1.6e-5
        close(angles, MOTION.angles(seconds(time)), 2e-5)
        assert findings == []

    def test_reference_that_wraps_is_interpolated_through_the_wrap(self) -> None:
        """Half a turn of psi away the reference's psi jumps; the quaternion does not."""
        time = clock(400)[125:]  # psi of the motion passes 0 at 0.125 s
        slow = START - 12_345_678 + 20 * STEP * np.arange(20, dtype=np.int64)
        half_a_turn = np.array([np.pi, 0, 0])
        turned = wrapped(MOTION.angles(seconds(slow)) + half_a_turn)
        assert np.ptp(turned[6:8, 0]) > 6, "the two samples about the start lie on both sides of the wrap"
        _, angles, _ = run({"rates": rates(time), "reference": reference(slow, turned)})
        expected = MOTION.angles(seconds(time)) + half_a_turn
        close(wrapped(angles - expected), 0 * expected, 2e-5)  # as above

    def test_late_reference_ties_the_segment_where_it_begins(self) -> None:
        time = clock(1000)
        _, angles, findings = run({"rates": rates(time), "reference": reference(clock(1000)[300:])})
        close(angles, MOTION.angles(seconds(time)), ACCURATE)
        assert [(f["kind"], f["severity"], f["end"]) for f in findings] == [
            ("initial attitude", "info", int(time[300]))
        ]

    def test_nan_and_unordered_reference_samples_are_not_used(self) -> None:
        time = clock(1000)
        angles = MOTION.angles(seconds(time))
        angles[0] = np.nan
        stamps = time.copy()
        stamps[500] = stamps[400]
        _, found, findings = run({"rates": rates(time), "reference": reference(stamps, angles)})
        close(found, MOTION.angles(seconds(time)), ACCURATE)
        assert not findings  # the next sample of the reference is as near as any other

    def test_a_slow_reference_ties_at_a_sample_of_its_own(self) -> None:
        """At ten samples a second nothing between them can be told: of 1e-9 rad, were it guessed, 1e-2."""
        time = clock(1000)[8:]
        slow = clock(1000)[::100]
        _, found, _ = run({"rates": rates(time), "reference": reference(slow)})
        close(found, MOTION.angles(seconds(time)), ACCURATE)

    def test_reference_elsewhere_leaves_a_relative_attitude_and_says_so(self) -> None:
        time = clock(500)
        late = reference(clock(2000)[1000:])
        _, angles, findings = run({"rates": rates(time), "reference": late}, initial_angles=(0.1, 0.2, 0.3))
        close(angles[0], np.array([0.1, 0.2, 0.3]), 1e-15)
        assert [(f["kind"], f["severity"]) for f in findings] == [("relative attitude", "warning")]

    def test_without_any_reference_only_what_is_in_pieces_is_a_warning(self) -> None:
        _, _, findings = run({"rates": rates(clock(500), clock(1500)[700:])})
        assert [(f["kind"], f["severity"]) for f in findings] == [
            ("relative attitude", "info"),
            ("relative attitude", "warning"),
        ]

    def test_later_segments_by_angles_are_relative_and_said_so(self) -> None:
        _, angles, findings = run({"rates": rates(clock(500), clock(1500)[700:])}, initial="angles")
        close(angles[[0, 500]], np.zeros((2, 3)), 0.0)
        assert [f["detail"][:9] for f in findings] == ["segment 1"]

    def test_initial_attitude_turns_the_history_as_a_whole(self) -> None:
        """Left multiplication: the motion from another start is the same motion, turned."""
        time = clock(800)
        start = MOTION.angles(np.zeros(1))[0]
        _, plain, _ = run({"rates": rates(time)}, initial="angles", initial_angles=tuple(start))
        _, turned, _ = run(
            {"rates": rates(time)},
            initial="angles",
            initial_angles=(float(start[0]) + 1.0, *start[1:].tolist()),
        )
        about_psi = quaternion_from_euler_krylov([1.0, 0.0, 0.0])
        expected = quaternion_multiply(about_psi, quaternion_from_euler_krylov(plain))
        dot = np.abs(np.sum(expected * quaternion_from_euler_krylov(turned), axis=1))
        close(dot, np.ones(800), 1e-13)


class TestSingularity:
    def climbing(self, count: int = 2001) -> pa.Table:
        """theta = t, psi = gamma = 0: passes 90 degrees after pi/2 s."""
        zero, one = np.zeros(count), np.ones(count)
        step = np.append(0.0, np.full(count - 1, STEP / 1e9))
        columns = {"time": clock(count), "segment": np.zeros(count), "p": zero, "q": zero, "r": one}
        increments = {"increment_p": zero, "increment_q": zero, "increment_r": step}
        return contracts.table("rates", {**columns, **increments})

    def test_euler_krylov_refuses_it_and_names_the_time(self) -> None:
        with pytest.raises(StageError, match=r"\(1\.554000 s into segment 0\).*below 89 degrees") as caught:
            run({"rates": self.climbing()}, method="euler_krylov", initial="angles")
        assert caught.value.exit_code == ExitCode.NOT_MET

    def test_margin_is_the_plan_s(self) -> None:
        settings = {"method": "euler_krylov", "initial": "angles", "singularity_margin_deg": 30.0}
        with pytest.raises(StageError, match=r"1\.048000 s"):  # 60 degrees are 1.0472 rad
            run({"rates": self.climbing()}, **settings)

    def test_quaternion_passes_through_and_says_so(self) -> None:
        _, angles, findings = run({"rates": self.climbing()}, initial="angles")
        theta = np.arange(2001) / 1000
        # beyond the pole theta falls, and psi and gamma differ by half a turn
        close(angles[:, 1], np.minimum(theta, np.pi - theta), 1e-12)
        assert [f["kind"] for f in findings] == ["near singularity"]
        assert findings[0]["count"] == 3  # |t − 1.5708| < 0.1° = 1.75 ms: 1.570, 1.571, 1.572 s
