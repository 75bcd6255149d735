from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import wandering

from pipeline.contracts import contract
from pipeline.errors import ExitCode
from pipeline.models.coning import ConingMotion
from pipeline.stages import align
from pipeline.stages.base import StageError, Stand

OFFSET = 0.1234567  # s
MOUNTING = (0.02, -0.03, 0.05)  # rad
BOTH = {"clock_offset": True, "mounting_rotation": True}


def recorded(
    *,
    offset: float = OFFSET,
    mounting: tuple[float, float, float] = MOUNTING,
    noise: float = 1e-4,
    axes: tuple[int, ...] = (0, 1, 2),
    stream: str = "gyro",
) -> dict[str, pa.Table]:
    """Gyro (100 Hz) and reference (50 Hz) of the wandering motion, 40 s."""
    rng = np.random.default_rng(1)
    t = np.arange(4000) / 100
    body = wandering.rates(t, axes)
    if stream == "gyro_increments":
        fine = np.arange(40_001) / 1000
        turned = np.concatenate(
            [[[0.0, 0.0, 0.0]], np.cumsum(wandering.rates(fine, axes)[1:], axis=0) / 1000]
        )
        body = np.diff(turned[::10], axis=0, prepend=0)[:4000]
        noise = noise / 100
    values = body @ wandering.matrix(mounting) + noise * rng.normal(size=(4000, 3))
    at = np.arange(2000) / 50
    return {
        stream: wandering.table(stream, wandering.nanoseconds(t + offset), values),
        "reference": wandering.table("reference", wandering.nanoseconds(at), wandering.angles(at, axes)),
    }


def aligned(tables: dict[str, pa.Table], **settings: Any) -> dict[str, pa.Table]:
    out = align.run(tables, align.Settings(**settings), Stand())
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
    return out


def refusal(tables: dict[str, pa.Table], **settings: Any) -> StageError:
    with pytest.raises(StageError) as caught:
        align.run(tables, align.Settings(**settings), Stand())
    assert "\n" not in str(caught.value)
    return caught.value


def test_nothing_is_done_unless_asked() -> None:
    assert align.run(recorded(), align.Settings(), Stand()) == {}


@pytest.mark.parametrize("stream", ["gyro", "gyro_increments"])
def test_offset_and_mounting_are_found_and_taken_out(stream: str) -> None:
    tables = recorded(stream=stream)
    out = aligned(tables, **BOTH)
    rows = {r["quantity"]: r for r in out["alignment"].to_pylist()}
    truth = dict(
        zip(["clock_offset", "mounting_1", "mounting_2", "mounting_3"], [OFFSET, *MOUNTING], strict=True)
    )
    for name, value in truth.items():
        # Five standard errors; the sum of 1 ms steps that makes the increments is right to 5e-4 s.
        slack = 6e-4 if stream == "gyro_increments" and name == "clock_offset" else 0.0
        assert abs(rows[name]["value"] - value) < 5 * rows[name]["standard_error"] + slack
        assert rows[name]["standard_error"] < 1e-4
    found = rows["clock_offset"]["value"]
    before, after = tables[stream], out[stream]
    assert np.all(before["time"].to_numpy() - after["time"].to_numpy() == round(found * 1e9))
    if stream == "gyro":
        t = after["time"].to_numpy() * 1e-9
        values = np.stack([after[name].to_numpy() for name in "pqr"], axis=1)
        # Noise of 1e-4 rad/s and angles right to 1e-4 rad at rates below 2 rad/s.
        assert np.abs(values - wandering.rates(t)).max() < 6e-4
    assert {m["name"] for m in out["metrics"].to_pylist()} == set(truth)
    assert [f["kind"] for f in out["findings"].to_pylist()] == ["aligned"]


def test_each_alone() -> None:
    only_offset = aligned(recorded(mounting=(0, 0, 0)), clock_offset=True)
    assert only_offset["alignment"]["quantity"].to_pylist() == ["clock_offset"]
    only_mounting = aligned(recorded(offset=0.0), mounting_rotation=True)
    assert only_mounting["alignment"]["quantity"].to_pylist() == ["mounting_1", "mounting_2", "mounting_3"]
    assert only_mounting["gyro"]["time"].equals(recorded(offset=0.0)["gyro"]["time"])


def test_one_half_turn_of_the_case() -> None:
    """A gyro mounted upside down: the rotation vector is pi long, where its representation folds."""
    out = aligned(recorded(mounting=(np.pi - 1e-3, 0.0, 0.0)), **BOTH)
    angles = out["alignment"]["value"].to_numpy()[1:]
    assert np.abs(np.abs(angles) - [np.pi - 1e-3, 0, 0]).max() < 1e-3


def test_bad_samples_are_passed_over_and_kept() -> None:
    tables = recorded()
    gyro = tables["gyro"]
    p = gyro["p"].to_numpy().copy()
    p[1000:1100] = np.nan
    time = gyro["time"].to_numpy().copy()
    time[2000] = time[1990]
    tables["gyro"] = gyro.set_column(0, gyro.schema.field("time"), pa.array(time)).set_column(
        gyro.schema.get_field_index("p"), gyro.schema.field("p"), pa.array(p)
    )
    out = aligned(tables, **BOTH)
    row = out["alignment"].to_pylist()[0]
    assert abs(row["value"] - OFFSET) < 5 * row["standard_error"]  # five standard errors
    assert out["gyro"].num_rows == gyro.num_rows
    assert np.isnan(out["gyro"]["q"].to_numpy()[1000:1100]).all()


class TestWhatCannotBeDecidedIsRefused:
    def test_a_motion_about_one_axis(self) -> None:
        error = refusal(recorded(axes=(0,), offset=0.0), mounting_rotation=True)
        assert error.exit_code == ExitCode.NOT_MET
        assert "two axes" in str(error)

    def test_a_periodic_motion(self) -> None:
        motion = ConingMotion(cone_angle=np.radians(1.0), frequency=5.0)
        t = np.arange(2000) / 200
        tables = {
            "gyro": wandering.table("gyro", wandering.nanoseconds(t + 0.013), motion.rates(t)),
            "reference": wandering.table("reference", wandering.nanoseconds(t), motion.angles(t)),
        }
        assert "repeats itself after about 0.2 s" in str(refusal(tables, clock_offset=True))
        out = aligned(tables, clock_offset=True, max_offset=0.09)
        # A cone of 1 degree sampled 40 times a period, noise-free: interpolation leaves microseconds.
        assert out["alignment"]["value"].to_pylist() == pytest.approx([0.013], abs=2e-5)
        warnings = [f for f in out["findings"].to_pylist() if f["severity"] == "warning"]
        assert [f["kind"] for f in warnings] == ["ambiguous clock offset"]
        # A turn about the cone's axis is a delay.
        assert "determines" in str(refusal(tables, max_offset=0.09, **BOTH))

    def test_records_that_do_not_meet(self) -> None:
        error = refusal(recorded(offset=1.7e9), clock_offset=True)
        assert error.exit_code == ExitCode.INPUT
        assert "apart" in str(error)

    def test_an_offset_beyond_the_search(self) -> None:
        assert "max_offset" in str(refusal(recorded(offset=0.5), clock_offset=True, max_offset=0.3))

    def test_rates_that_have_nothing_to_do_with_the_reference(self) -> None:
        tables = recorded()
        rng = np.random.default_rng(2)
        noise = rng.normal(size=(4000, 3))
        tables["gyro"] = wandering.table("gyro", tables["gyro"]["time"].to_numpy(), noise)
        assert "correlate" in str(refusal(tables, clock_offset=True))

    def test_a_missing_stream(self) -> None:
        tables = recorded()
        del tables["reference"]
        error = refusal(tables, clock_offset=True)
        assert error.exit_code == ExitCode.USAGE
        assert "found gyro" in str(error)

    def test_too_few_samples(self) -> None:
        tables = {name: table.slice(0, 20) for name, table in recorded().items()}
        assert refusal(tables, clock_offset=True).exit_code == ExitCode.INPUT

    def test_stamps_in_batches(self) -> None:
        tables = recorded()
        time = tables["gyro"]["time"].to_numpy()
        batches = time // 100_000_000 * 100_000_000 + np.arange(len(time)) % 10
        tables["gyro"] = tables["gyro"].set_column(0, tables["gyro"].schema.field("time"), pa.array(batches))
        assert "batches" in str(refusal(tables, clock_offset=True))
