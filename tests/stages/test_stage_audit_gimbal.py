from typing import Any

import gimbal_records as gr
import numpy as np
import pytest

from pipeline.contracts import contract
from pipeline.models.earth import Scheme
from pipeline.stages import audit
from pipeline.stages.base import Stand

Row = dict[str, Any]
SCHEMES = list(gr.STARTS)


def audited(
    records: list[gr.Record], schemes: list[Scheme], **changed: Any
) -> tuple[list[Row], dict[tuple[str, str], float]]:
    """Findings, and metrics by channel and name, each once."""
    out = audit.run(gr.tables(records, schemes), audit.Settings(**changed), Stand())
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
    rows = out["metrics"].to_pylist()
    figures = {(m["channel"], m["name"]): m["value"] for m in rows}
    assert len(figures) == len(rows)
    assert {name for _, name in figures} <= set(audit.METRICS)
    return out["findings"].to_pylist(), figures


class TestSoundRecords:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("step", [1.0, 60.0])
    @pytest.mark.parametrize("noise", [0.0, 0.3])
    @pytest.mark.parametrize("quantum", [0.0, 2 * np.pi / 2**20, 2 * np.pi / 2**16])
    def test_nothing_is_found(self, scheme: Scheme, step: float, noise: float, quantum: float) -> None:
        """An encoder of 16 bits holds an angle that turns with the Earth for several samples at 1 Hz."""
        record = gr.record(scheme, 24 if step > 1 else 6, step, noise=noise, quantum=quantum)
        findings, figures = audited([record], [scheme])
        assert findings == []
        assert figures["gimbal", "sample_count"] == len(record[0])
        assert figures["gimbal", "sample_rate"] == pytest.approx(1 / step, rel=1e-9)
        # Drift of 0.01 each stands in for the Earth rate in part: mc2 wholly in the equatorial scheme.
        assert figures["gimbal", "implied_earth_rate"] == pytest.approx(15.041, rel=0.03)

    def test_an_angle_at_rest_is_no_missing_channel(self) -> None:
        """In the equatorial scheme alpha2 stays where it is: a coarse encoder shows one value for hours."""
        record = gr.record("equatorial", 6, 60.0, noise=0.0, quantum=1e-2, start=(0.0, 0.0), drift=0.0)
        assert np.ptp(record[1][:, 1]) == 0
        findings, figures = audited([record], ["equatorial"])
        assert [(f["channel"], f["kind"], f["severity"]) for f in findings] == [
            ("alpha2", "constant", "info")
        ]
        assert figures["gimbal", "error_count"] == 0

    def test_wrapped_angles_are_no_spikes(self) -> None:
        time, alpha = gr.record("equatorial", 24, 60.0)
        assert audited([(time, alpha % (2 * np.pi))], ["equatorial"])[0] == []


class TestFaults:
    def test_each_is_marked_in_its_run(self) -> None:
        first, second = gr.record("vertical", 6, 1.0), gr.record("polar", 6, 2.0)
        second = (second[0] + 2 * 86_400 * 10**9, second[1])
        first[1][100] = np.nan
        first[1][5000, 0] += 1e-3
        first[1][9000:9060, 1] = first[1][9000, 1]
        kept = np.delete(np.arange(len(second[0])), slice(200, 210))
        findings, figures = audited([first, (second[0][kept], second[1][kept])], ["vertical", "polar"])
        assert [(f["kind"], f["channel"], f["start"], f["count"]) for f in findings] == [
            ("NaN", None, first[0][100], 1),
            ("spike", "alpha1", first[0][5000], 1),
            ("frozen", "alpha2", first[0][9000], 60),
            ("gap", None, second[0][199], 10),
        ]
        assert [f["detail"][:7] for f in findings] == ["run 'ru"] * 4
        assert ["run 1" in f["detail"] for f in findings] == [False, False, False, True]
        assert figures["gimbal", "sample_count"] == len(first[0]) + len(kept)
        assert figures["gimbal", "sample_rate"] == 0.5  # the slower run's
        assert figures["gimbal", "longest_gap"] == pytest.approx(22.0)
        assert figures["gimbal.alpha1", "spike_count"] == 1
        assert figures["gimbal.alpha2", "frozen_count"] == 60
        assert figures["gimbal", "warning_count"] == 4

    def test_clipped(self) -> None:
        time, alpha = gr.record("vertical", 12, 60.0)
        alpha[:, 0] = np.minimum(alpha[:, 0], np.quantile(alpha[:, 0], 0.8))
        findings, _ = audited([(time, alpha)], ["vertical"])
        assert "clipped" in {f["kind"] for f in findings if f["channel"] == "alpha1"}

    @pytest.mark.parametrize("nothing", [np.nan, np.inf])
    def test_no_angle_at_all(self, nothing: float) -> None:
        time, alpha = gr.record("vertical", 12, 60.0)
        alpha[:, 1] = nothing
        findings, figures = audited([(time, alpha)], ["vertical"])
        assert ("missing channel", "error") in {(f["kind"], f["severity"]) for f in findings}
        assert figures["gimbal", "error_count"] >= 1

    @pytest.mark.parametrize("dead", [(0,), (1,), (0, 1)])
    def test_an_angle_at_rest_where_the_earth_turns_it(self, dead: tuple[int, ...]) -> None:
        time, alpha = gr.record("polar", 12, 60.0)
        alpha[:, dead] = alpha[0, dead]
        findings, _ = audited([(time, alpha)], ["polar"])
        errors = [f for f in findings if (f["kind"], f["severity"]) == ("constant", "error")]
        assert [f["channel"] for f in errors] == [f"alpha{index + 1}" for index in dead]
        assert all("the encoder is dead" in f["detail"] for f in errors)

    def test_angles_of_two_units_are_an_error(self) -> None:
        """No one change of the plan explains them, and no gyro moves so."""
        time, alpha = gr.record("polar", 24, 60.0)
        findings, _ = audited([(time, alpha * np.array([180 / np.pi, 1.0]))], ["polar"])
        assert ("implausible Earth rate", "error") in {(f["kind"], f["severity"]) for f in findings}


class TestUnit:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("hours", [1, 24])
    def test_degrees_declared_as_radians(self, scheme: Scheme, hours: float) -> None:
        time, alpha = gr.record(scheme, hours, 10.0)
        findings, figures = audited([(time, np.degrees(alpha))], [scheme])
        assert [(f["kind"], f["severity"]) for f in findings] == [("implausible unit", "error")]
        assert "against 15.041 deg/h" in findings[0]["detail"]
        assert "if they are degrees where radians are stated" in findings[0]["detail"]
        assert figures["gimbal", "error_count"] == 1

    def test_in_the_equatorial_scheme_the_rate_is_57_times_the_earths(self) -> None:
        time, alpha = gr.record("equatorial", 24, 60.0, start=(0.0, 0.0), drift=0.0)
        _, figures = audited([(time, np.degrees(alpha))], ["equatorial"])
        # alpha1' = -s; with no drift only tilt and misalignment of some 1e-3 change it.
        assert figures["gimbal", "implied_earth_rate"] == pytest.approx(15.041 * 180 / np.pi, rel=0.01)

    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_radians_declared_as_degrees(self, scheme: Scheme) -> None:
        time, alpha = gr.record(scheme, 24, 60.0)
        findings, _ = audited([(time, np.radians(alpha))], [scheme])
        assert "if they are radians where degrees are stated" in findings[0]["detail"]

    def test_near_the_pole_small_angles_say_nothing(self) -> None:
        """The model is linear there: angles 57 times smaller turn just so."""
        time, alpha = gr.record("polar", 24, 60.0, start=(0.02, -0.01))
        assert audited([(time, np.radians(alpha))], ["polar"])[0] == []


class TestMounting:
    @pytest.mark.parametrize(
        ("signs", "words"),
        [
            ((-1, 1), "alpha1 negated: 1"),
            ((1, -1), "alpha2 negated: 1"),
            ((-1, -1), "alpha1 and alpha2 negated: 1"),
        ],
    )
    def test_a_wrong_sign_is_named(self, signs: tuple[int, int], words: str) -> None:
        time, alpha = gr.record("vertical", 24, 60.0, start=(0.5, -0.5))
        findings, figures = audited([(time, alpha * np.array(signs))], ["vertical"])
        assert [(f["kind"], f["severity"]) for f in findings] == [("implausible Earth rate", "error")]
        assert "check scheme, latitude and the signs" in findings[0]["detail"]
        assert words in findings[0]["detail"]
        assert figures["gimbal", "error_count"] == 1

    @pytest.mark.parametrize("truth", SCHEMES)
    @pytest.mark.parametrize("stated", SCHEMES)
    def test_a_wrong_scheme_is_named(self, truth: Scheme, stated: Scheme) -> None:
        findings, _ = audited([gr.record(truth, 24, 60.0)], [stated])
        if truth == stated:
            assert findings == []
        else:
            assert [f["kind"] for f in findings] == ["implausible Earth rate"]
            assert f"scheme {truth}: 1" in findings[0]["detail"]

    def test_exchanged_channels_are_named(self) -> None:
        time, alpha = gr.record("polar", 24, 60.0)
        findings, _ = audited([(time, alpha[:, ::-1])], ["polar"])
        assert "alpha1 and alpha2 exchanged: 1" in findings[0]["detail"]

    def test_the_inner_gimbal_at_its_singularity(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0)
        alpha[:, 1] *= np.radians(95) / np.abs(alpha[:, 1]).max()
        findings, _ = audited([(time, alpha)], ["vertical"])
        assert ("singular", "error") in {(f["kind"], f["severity"]) for f in findings}
