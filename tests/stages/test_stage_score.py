"""Score on tables whose figures are known in closed form."""

import numpy as np
import pyarrow as pa
import pytest
from pydantic import ValidationError

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.stages import score
from pipeline.stages.base import StageError, Stand, rows

STEP = 1_000_000  # ns
N = 1001
GRID = np.arange(N, dtype=np.int64) * STEP
T = GRID * 1e-9
ANGLES = ("psi", "theta", "gamma")


def attitude(psi, theta=0.0, gamma=0.0, *, time=GRID, segment=0, corrected=False):
    name = "attitude_corrected" if corrected else "attitude"
    angles = (np.broadcast_to(x, time.shape).astype(float) for x in (psi, theta, gamma))
    columns = dict(zip(ANGLES, angles, strict=True))
    return contracts.table(name, {"time": time, "segment": np.broadcast_to(segment, time.shape), **columns})


def reference(psi, theta=0.0, gamma=0.0, *, time=GRID):
    nothing = {n: pa.nulls(len(time), pa.int64()) for n in ("header_stamp", "log_time", "publish_time")}
    angles = (np.broadcast_to(x, time.shape).astype(float) for x in (psi, theta, gamma))
    columns = dict(zip(ANGLES, angles, strict=True))
    return contracts.table("reference", {"time": time, **nothing, **columns})


def scored(tables, *, channels=("psi",), returns_to_start=False):
    result = score.run(tables, score.Settings(channels=channels), Stand(returns_to_start=returns_to_start))
    for name in result:
        assert result[name].schema.equals(contracts.contract(name).schema, check_metadata=True)
    figures = {(m["channel"], m["name"]): m for m in result["metrics"].to_pylist()}
    return figures, result["findings"].to_pylist()


def value(figures, name, channel="psi"):
    return figures[channel, name]["value"]


def test_figures_of_a_known_error():
    tables = {
        "attitude": attitude(np.sin(2 * np.pi * T) + 0.3 * T),
        "attitude_corrected": attitude(np.sin(2 * np.pi * T) - 0.01, corrected=True),
        "reference": reference(np.sin(2 * np.pi * T)),
    }
    figures, findings = scored(tables)
    # ∫ (0.3 t)² dt / ∫ sin² dt = 0.03/0.5; the trapezoid rule is off by 1e-6 of it
    assert value(figures, "relative_rms_error") == pytest.approx(np.sqrt(0.06), rel=1e-6)
    assert value(figures, "relative_rms_error_corrected") == pytest.approx(0.01 * np.sqrt(2), rel=1e-12)
    assert value(figures, "peak_error") == pytest.approx(0.3, rel=1e-12)  # rounding
    assert value(figures, "final_error") == pytest.approx(0.3, rel=1e-12)
    assert value(figures, "final_error_corrected") == pytest.approx(-0.01, rel=1e-12)
    assert figures["psi", "relative_rms_error"]["unit"] == "1"
    assert figures["psi", "peak_error"]["unit"] == "rad"
    assert {m["verdict"] for m in figures.values()} == {"not evaluated"}
    assert {m["standard_error"] for m in figures.values()} == {None}
    assert findings == []


def test_all_angles_by_default():
    tables = {"attitude": attitude(T, T, T), "reference": reference(T, T, T)}
    figures = score.run(tables, score.Settings(), Stand())["metrics"]
    assert figures["channel"].to_pylist() == [c for c in ANGLES for _ in range(3)]
    assert set(figures["value"].to_pylist()) == {0.0}


def test_attitude_is_interpolated_to_the_reference():
    between = GRID[3:-3:7] + STEP // 3
    cubic = lambda t: 1 + t - 3 * t**2 + 2 * t**3  # noqa: E731  exact for the local cubic
    tables = {
        "attitude": attitude(cubic(T)),
        "reference": reference(cubic(between * 1e-9), time=between),
    }
    figures, _ = scored(tables)
    assert value(figures, "peak_error") < 1e-14  # rounding


def test_whole_turns_do_not_count():
    turning = 20 * T  # unwrapped
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    figures, _ = scored({"attitude": attitude(turning + 1e-3), "reference": reference(wrapped)})
    assert value(figures, "peak_error") == pytest.approx(1e-3, rel=1e-9)  # rounding of 20 rad


def test_only_the_common_time_counts():
    later = GRID + 400 * STEP
    tables = {"attitude": attitude(T), "reference": reference(1.0, time=later)}
    figures, findings = scored(tables)
    # from 0.4 to 1 s: the error t - 1 runs from -0.6 to 0
    assert value(figures, "peak_error") == pytest.approx(0.6, rel=1e-12)  # rounding
    assert value(figures, "final_error") == pytest.approx(0.0, abs=1e-12)
    assert value(figures, "relative_rms_error") == pytest.approx(np.sqrt(0.36 / 3), rel=1e-5)  # trapezoid
    assert [(f["kind"], f["count"], f["severity"]) for f in findings] == [
        ("outside the attitude", 400, "info")
    ]


def test_a_reference_that_is_hardly_scored_is_a_warning():
    """A record cut to pieces begins each at the reference: its figures are good, and say nothing."""
    pieces = attitude(T[:200], time=GRID[:200], segment=np.arange(200) // 2)
    _, findings = scored({"attitude": pieces, "reference": reference(T)})
    assert [(f["kind"], f["count"], f["severity"]) for f in findings] == [
        ("outside the attitude", N - 200, "warning")
    ]


def test_no_common_time_is_refused_with_both_spans():
    tables = {"attitude": attitude(T), "reference": reference(T, time=GRID + 5_000_000_000)}
    with pytest.raises(StageError, match="0 ns to 1000000000 ns, reference from 5000000000") as caught:
        scored(tables)
    assert caught.value.exit_code is ExitCode.INPUT


def test_reference_without_a_usable_sample_is_refused():
    with pytest.raises(StageError, match="without a usable sample"):
        scored({"attitude": attitude(T), "reference": reference(np.nan)})


def test_the_gap_between_segments_is_not_scored():
    keep = np.r_[0:300, 700:N]
    segment = np.where(keep < 300, 0, 1)
    error = np.where(keep < 300, 1e-3, 2e-3)
    tables = {"attitude": attitude(error, time=GRID[keep], segment=segment), "reference": reference(0.1)}
    figures, _ = scored(tables)
    expected = np.sqrt((0.299 * 0.099**2 + 0.300 * 0.098**2) / 0.599) / 0.1
    assert value(figures, "relative_rms_error") == pytest.approx(expected, rel=1e-12)  # rounding


def test_samples_of_the_reference_that_do_not_count_are_said():
    psi = np.ones(N)
    psi[[10, 11, 12]] = np.nan
    time = GRID.copy()
    time[500] = time[480]  # a stamp that falls back
    psi[500] = 77.0
    figures, findings = scored({"attitude": attitude(1.0), "reference": reference(psi, time=time)})
    assert value(figures, "peak_error") == 0
    assert [(f["kind"], f["count"], f["severity"]) for f in findings] == [
        ("NaN", 3, "warning"),
        ("time not advancing", 1, "warning"),
    ]
    assert (findings[0]["start"], findings[0]["end"]) == (10 * STEP, 12 * STEP)


def test_nan_in_an_angle_that_is_not_scored_does_not_matter():
    tables = {"attitude": attitude(1.0), "reference": reference(1.0, np.nan)}
    assert scored(tables)[1] == []


def test_reference_of_zero_has_no_criterion():
    figures, findings = scored({"attitude": attitude(1e-3), "reference": reference(0.0)})
    assert value(figures, "relative_rms_error") is None
    assert value(figures, "peak_error") == 1e-3
    assert [f["kind"] for f in findings] == ["undefined"]


def test_closure_without_a_reference():
    tables = {
        "attitude": attitude(0.2 + 0.01 * T + 2 * np.pi * T),
        "attitude_corrected": attitude(0.2, corrected=True),
    }
    figures, _ = scored(tables, returns_to_start=True)
    assert value(figures, "closure_error") == pytest.approx(0.01, rel=1e-12)  # rounding
    assert value(figures, "closure_error_corrected") == 0
    assert figures["psi", "closure_error"]["unit"] == "rad"


def test_closure_of_a_record_in_pieces_is_not_known():
    pieces = attitude(T, segment=np.arange(N) // 600)
    figures, findings = scored({"attitude": pieces}, returns_to_start=True)
    assert value(figures, "closure_error") is None
    assert [f["kind"] for f in findings] == ["not scored"]


def test_nothing_to_score_by_is_said():
    figures, findings = scored({"attitude": attitude(T)})
    assert figures == {}
    assert [f["kind"] for f in findings] == ["not scored"]


def test_trend_of_the_longest_segment_with_its_standard_errors():
    segment = np.where(np.arange(N) < 200, 0, 1)

    def row(number, a):
        nothing = ("frequency", "onset", "smooth_a", "smooth_b", "white_angle_noise", "angle_random_walk")
        return dict.fromkeys(nothing) | {
            "segment": number, "channel": "psi", "method": "harmonic", "origin": 0,
            "a": a, "a_standard_error": 0.1 * a, "b": 2 * a, "b_standard_error": None,
        }  # fmt: skip

    tables = {"attitude": attitude(T, segment=segment), "trend": rows("trend", [row(0, 1.0), row(1, 3.0)])}
    figures, _ = scored(tables, channels=("psi", "gamma"))
    assert value(figures, "trend_a") == 3.0
    assert figures["psi", "trend_a"]["standard_error"] == pytest.approx(0.3)
    assert figures["psi", "trend_a"]["unit"] == "rad/s"
    assert value(figures, "trend_b") == 6.0
    assert figures["psi", "trend_b"]["standard_error"] is None
    assert ("gamma", "trend_a") not in figures


def test_settings_are_checked():
    with pytest.raises(ValidationError):
        score.Settings(channels=("roll",))
