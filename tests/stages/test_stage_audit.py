from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import wandering

from pipeline.contracts import contract
from pipeline.models.coning import ConingMotion, SmoothConing
from pipeline.numerics.rotation import euler_krylov_from_quaternion
from pipeline.stages import audit
from pipeline.stages.base import Stand

Row = dict[str, Any]
CONING = ConingMotion(cone_angle=np.radians(1.0), frequency=100.0)


def audited(tables: dict[str, pa.Table], **changed: Any) -> tuple[list[Row], dict[tuple[str, str], Any]]:
    """Findings, and metrics by channel and name; both tables keep their contracts' schemas."""
    out = audit.run(tables, audit.Settings(**changed), Stand())
    assert set(out) == {"findings", "metrics"}
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
    figures = {(m["channel"], m["name"]): m["value"] for m in out["metrics"].to_pylist()}
    return out["findings"].to_pylist(), figures


def noisy(seed: int = 1, count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """A gyro at rest: 400 Hz, noise of 1e-3 rad/s."""
    rng = np.random.default_rng(seed)
    return np.arange(count) * 2_500_000, 1e-3 * rng.normal(size=(count, 3))


def gyro(time: np.ndarray, rates: np.ndarray, **clocks: np.ndarray) -> dict[str, pa.Table]:
    return {"gyro": wandering.table("gyro", time, rates, **clocks)}


class TestSoundRecordings:
    @pytest.mark.parametrize("rate", [400.0, 1000.0, 20_000.0])
    def test_coning_is_only_said_to_have_a_constant_roll_rate(self, rate: float) -> None:
        t = np.arange(4001) / rate
        time = wandering.nanoseconds(t)
        tables = gyro(time, CONING.rates(t)) | {
            "reference": wandering.table("reference", time, CONING.angles(t))
        }
        findings, figures = audited(tables)
        assert [(f["channel"], f["kind"], f["severity"]) for f in findings] == [("p", "constant", "info")]
        assert figures["gyro", "sample_rate"] == pytest.approx(rate, rel=1e-6)  # stamps in whole nanoseconds
        # The criterion of the units: a reference that is differenced has the gyro's mean rate over a step.
        assert figures["gyro", "rotation_ratio"] == pytest.approx(1.0, abs=0.02)

    def test_a_smooth_roll_before_the_vibration_is_steady_not_frozen(self) -> None:
        """Section 5 of the paper: 400 samples of one value, which the reference confirms."""
        motion = SmoothConing(CONING, onset=0.0, slope=-0.05, offset=0.5)
        t = np.arange(-400, 401) / 400
        time = wandering.nanoseconds(t + 1)
        tables = gyro(time, motion.rates(t)) | {
            "reference": wandering.table("reference", time, motion.angles(t))
        }
        findings, figures = audited(tables)
        assert [(f["stream"], f["kind"]) for f in findings] == [("gyro", "steady")]
        assert figures["gyro", "frozen_count"] == 0
        # Without the reference nothing can confirm it.
        assert {f["kind"] for f in audited({"gyro": tables["gyro"]})[0]} == {"frozen"}

    def test_noise(self) -> None:
        findings, figures = audited(gyro(*noisy()))
        assert findings == []
        assert figures["gyro", "sample_count"] == 4000
        assert figures["gyro", "rate_jitter"] == 0

    def test_angles_that_go_round_are_no_spikes(self) -> None:
        time, noise = noisy()
        angles = np.stack(
            [(np.pi + noise[:, 0] + np.pi) % (2 * np.pi) - np.pi, noise[:, 1], noise[:, 2]], axis=1
        )
        assert np.ptp(angles[:, 0]) > 6
        assert audited({"reference": wandering.table("reference", time, angles)})[0] == []

    def test_the_stream_is_not_changed(self) -> None:
        time, rates = noisy()
        rates[5] = np.nan
        tables = gyro(time, rates)
        before = tables["gyro"].to_pydict()
        audited(tables)
        # NaN is not equal to itself; its text is.
        assert str(tables["gyro"].to_pydict()) == str(before)


class TestTime:
    def test_gap_repeated_and_backward_stamp(self) -> None:
        time, rates = noisy()
        keep = np.delete(np.arange(4000), slice(1000, 1010))
        time, rates = time[keep], rates[keep]
        time[2000] = time[1999]
        time[3000] = time[2998] - 1
        findings, figures = audited(gyro(time, rates))
        marked = {(f["kind"], f["start"], f["end"], f["count"]) for f in findings}
        assert marked == {
            ("gap", time[999], time[1000], 10),
            ("repeated stamp", time[2000], time[2000], 1),
            ("gap", time[1999], time[2001], 1),
            ("backward stamp", time[3000], time[3000], 1),
            ("gap", time[2999], time[3001], 1),
        }
        assert all(f["severity"] == "warning" for f in findings)
        assert figures["gyro", "gap_count"] == 3
        assert figures["gyro", "lost_count"] == 12
        assert figures["gyro", "longest_gap"] == pytest.approx(0.0275, rel=1e-9)
        assert figures["gyro", "repeated_stamp_count"] == figures["gyro", "backward_stamp_count"] == 1

    def test_jitter(self) -> None:
        time, rates = noisy()
        moved = time + np.random.default_rng(3).integers(-400_000, 400_001, size=len(time))
        findings, figures = audited(gyro(moved, rates))
        assert [f["kind"] for f in findings] == ["jitter"]
        # The difference of two uniform variates of half-width w has a median size of w (2 - sqrt 2).
        assert figures["gyro", "rate_jitter"] == pytest.approx(1.4826 * 4e-4 * (2 - np.sqrt(2)), rel=0.05)

    def test_batches_of_the_chosen_clock(self) -> None:
        time, rates = noisy()
        batches = time // 25_000_000 * 25_000_000 + np.arange(4000) % 10
        findings, _ = audited(gyro(batches, rates, header_stamp=time))
        kinds = {f["kind"] for f in findings}
        assert "batched stamps" in kinds

    def test_more_faults_than_rows_are_summed(self) -> None:
        time, rates = noisy(count=10_000)
        lost = np.arange(20, 9980, 40)
        keep = np.setdiff1d(np.arange(10_000), np.concatenate([lost, [5001, 5002, 5003]]))
        findings, figures = audited(gyro(time[keep], rates[keep]), max_rows=10)
        gaps = [f for f in findings if f["kind"] == "gap"]
        assert len(gaps) == 11
        assert sum(f["count"] for f in gaps) == figures["gyro", "lost_count"] == 252
        # The longest has its own row, wherever it lies.
        assert 3 in {f["count"] for f in gaps[:-1]}
        assert (gaps[-1]["count"], gaps[-1]["detail"].split()[0]) == (240, "240")


class TestClocks:
    def test_drift_and_batches_of_the_log_time(self) -> None:
        time, rates = noisy(count=40_000)
        log = np.rint(time * (1 + 500e-6)).astype(np.int64) // 25_000_000 * 25_000_000 + 5_000_000_000
        findings, figures = audited(gyro(time, rates, header_stamp=time, log_time=log))
        assert [(f["kind"], f["severity"], f["channel"]) for f in findings] == [
            ("clocks differ", "warning", "log_time")
        ]
        assert "in batches of 10 samples" in findings[0]["detail"]
        # The 25 ms of the batches come and go over 100 s of record: 250 ppm at the very most.
        assert figures["gyro.log_time", "clock_drift"] == pytest.approx(500e-6, abs=50e-6)
        assert figures["gyro.log_time", "clock_offset"] == pytest.approx(5.0, abs=0.03)

    def test_a_clock_that_stands_still(self) -> None:
        time, rates = noisy()
        findings, _ = audited(gyro(time, rates, header_stamp=np.zeros_like(time)))
        assert [(f["kind"], f["severity"]) for f in findings] == [("clock stands still", "info")]

    def test_the_same_clock_is_not_compared(self) -> None:
        time, rates = noisy()
        findings, figures = audited(gyro(time, rates, header_stamp=time))
        assert findings == []
        assert ("gyro.header_stamp", "clock_offset") not in figures


class TestValues:
    def test_nan_runs_together_and_alone(self) -> None:
        time, rates = noisy()
        rates[100:110] = np.nan
        rates[200, 1] = np.inf
        findings, figures = audited(gyro(time, rates))
        assert {(f["kind"], f["channel"], f["start"], f["end"], f["count"]) for f in findings} == {
            ("NaN", None, time[100], time[109], 10),
            ("NaN", "q", time[200], time[200], 1),
        }
        assert figures["gyro", "nan_count"] == figures["gyro.q", "nan_count"] == 11
        assert figures["gyro.p", "nan_count"] == 10

    def test_frozen_stream_and_frozen_channel(self) -> None:
        time, rates = noisy()
        rates[1000:1050] = rates[1000]
        rates[2000:2100, 2] = rates[2000, 2]
        findings, figures = audited(gyro(time, rates))
        assert {(f["kind"], f["channel"], f["start"], f["count"]) for f in findings} == {
            ("frozen", None, time[1000], 50),
            ("frozen", "r", time[2000], 100),
        }
        assert figures["gyro", "frozen_count"] == figures["gyro.r", "frozen_count"] == 150
        assert figures["gyro.p", "frozen_count"] == 50

    def test_clipped(self) -> None:
        t = np.arange(4000) / 400
        rates = np.stack([np.sin(6 * t), np.cos(5 * t), np.minimum(np.sin(7 * t), 0.8)], axis=1)
        findings, figures = audited(gyro(wandering.nanoseconds(t), rates))
        assert {(f["kind"], f["channel"]) for f in findings} == {("clipped", "r")}
        assert figures["gyro", "clipped_count"] == np.count_nonzero(rates[:, 2] == 0.8)

    def test_spike(self) -> None:
        time, rates = noisy()
        rates[1234, 0] += 0.05
        findings, figures = audited(gyro(time, rates))
        assert [(f["kind"], f["channel"], f["start"], f["end"]) for f in findings] == [
            ("spike", "p", time[1234], time[1234])
        ]
        assert figures["gyro", "spike_count"] == 1

    def test_dead_channels(self) -> None:
        time, rates = noisy()
        rates[:, 1] = 0.0
        rates[:, 2] = np.nan
        findings, figures = audited(gyro(time, rates))
        assert (figures["gyro", "error_count"], figures["gyro", "warning_count"]) == (2, 0)
        assert {(f["kind"], f["channel"], f["severity"]) for f in findings} == {
            ("missing channel", "q", "error"),
            ("missing channel", "r", "error"),
        }

    def test_a_record_that_never_changes(self) -> None:
        time, rates = noisy()
        findings, _ = audited(gyro(time, np.full_like(rates, 0.25)))
        assert [(f["kind"], f["severity"]) for f in findings] == [("constant", "warning")]

    def test_a_sensor_slower_than_its_record(self) -> None:
        time, rates = noisy()
        findings, _ = audited(gyro(time, np.repeat(rates[:1000], 4, axis=0)))
        assert [(f["kind"], f["severity"]) for f in findings] == [("held", "info")]
        assert "100 Hz" in findings[0]["detail"]


class TestUnits:
    @pytest.mark.parametrize(
        ("factor", "words"),
        [(180 / np.pi, "degrees where radians"), (np.pi / 180, "radians where degrees")],
    )
    @pytest.mark.parametrize("stream", ["gyro", "gyro_increments"])
    def test_a_reference_decides(self, factor: float, words: str, stream: str) -> None:
        t = np.arange(4000) / 100
        time = wandering.nanoseconds(t)
        turned = wandering.rates(t) @ wandering.matrix((0.3, 0.2, 1.0)) + 0.01
        values = factor * (turned if stream == "gyro" else turned / 100)
        tables = {
            stream: wandering.table(stream, time, values),
            "reference": wandering.table("reference", time, wandering.angles(t)),
        }
        findings, figures = audited(tables)
        assert [(f["kind"], f["severity"]) for f in findings] == [("implausible unit", "error")]
        assert words in findings[0]["detail"]
        # The bias, and for increments the half-step between a sum and its stamp, are not the reference's.
        assert figures[stream, "rotation_ratio"] == pytest.approx(factor, rel=0.05)

    def test_a_poor_reference_at_rest_decides_nothing(self) -> None:
        """Its differenced noise is 57 times that of the gyro, and that is no unit."""
        rng = np.random.default_rng(4)
        time, rates = noisy()
        angles = 0.057 / 400 / np.sqrt(2) * rng.normal(size=(4000, 3))
        tables = gyro(time, rates) | {"reference": wandering.table("reference", time, angles)}
        assert audited(tables)[0] == []

    def test_too_fast_without_a_reference(self) -> None:
        time, rates = noisy()
        findings, _ = audited(gyro(time, rates + 60.0))
        assert [(f["kind"], f["severity"], f["count"]) for f in findings] == [
            ("implausible unit", "warning", 4000)
        ]


class TestTooLittle:
    @pytest.mark.parametrize(
        ("count", "severity"), [(0, "error"), (1, "error"), (2, "warning"), (9, "warning")]
    )
    def test_few_samples(self, count: int, severity: str) -> None:
        time, rates = noisy(count=count)
        findings, figures = audited(gyro(time, rates))
        assert ("too few samples", severity) in [(f["kind"], f["severity"]) for f in findings]
        assert figures["gyro", "sample_count"] == count

    def test_all_nan(self) -> None:
        time, rates = noisy()
        findings, figures = audited(gyro(time, np.full_like(rates, np.nan)))
        assert [(f["kind"], f["severity"]) for f in findings] == [("missing channel", "error")] * 3
        assert figures["gyro", "nan_count"] == 4000

    def test_no_stream_at_all(self) -> None:
        assert audited({}) == ([], {})


STRANGE = np.array([0.0, 1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 5e-324, 0.5])


def strange(rng: np.random.Generator, count: int) -> np.ndarray:
    """Values that a broken logger might write, alone or among sound ones."""
    values = rng.choice(STRANGE, size=(count, 3))
    sound = rng.normal(size=(count, 3)) * 10.0 ** rng.integers(-300, 300)
    return np.where(rng.random((count, 3)) < rng.choice([0.0, 0.9, 1.0]), sound, values)


@pytest.mark.parametrize("seed", range(200))
def test_no_record_is_too_strange(seed: int) -> None:
    """Whatever was recorded is audited, without a warning of NumPy and with no row outside the contract."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 120))
    far = 2**61  # ns: 73 years either way, and the difference of two still fits
    time = [
        rng.integers(-far, far, count),
        np.arange(count) * 2_500_000 + rng.integers(0, 3, count) * 1_000_000,
        rng.integers(0, 50, count),
        np.arange(count) * 10_000_000,
    ][seed % 4].astype(np.int64)
    stream = str(rng.choice(["gyro", "gyro_increments"]))
    tables = {
        stream: wandering.table(stream, time, strange(rng, count), log_time=rng.integers(-far, far, count)),
        "reference": wandering.table("reference", time, strange(rng, count)),
    }
    findings, _ = audited(tables)
    assert all(f["count"] >= 0 for f in findings)


def test_real_recordings_of_others(shared_data: Path) -> None:
    """The optical reference of BROAD loses the body 1706 times; its gyro agrees with it in size."""
    data = np.genfromtxt(shared_data / "csv" / "broad_02_slow_rotation_B.csv", delimiter=",", skip_header=1)
    time = wandering.nanoseconds(data[:, 0])
    angles = euler_krylov_from_quaternion(data[:, 4:8])
    tables = gyro(time, data[:, 1:4]) | {"reference": wandering.table("reference", time, angles)}
    findings, figures = audited(tables)
    assert {(f["stream"], f["kind"]) for f in findings} == {("reference", "NaN")}
    assert figures["reference", "nan_count"] == 1706
    assert figures["gyro", "rotation_ratio"] == pytest.approx(1.0, abs=0.05)
