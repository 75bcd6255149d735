"""The stage modulation on the models that the stage noise finds in records with known truth."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pydantic import ValidationError
from static_records import COLOURED, DEG, PERIODIC, WALKING, WHITE, N, record

from pipeline.models.random_error import Noise2, RandomError, White
from pipeline.models.random_error_growth import (
    growth,
    recommended_rate,
    reversing_growth,
    schuler_growth,
    variance,
    worse_bands,
)
from pipeline.stages import modulation, noise
from pipeline.stages.base import Stand
from pipeline.storage.contract_check import violations

NAMED = {"p": WHITE, "q": COLOURED, "r": PERIODIC}
CHANNELS = list(NAMED)


@cache
def noises(seed: int = 4) -> dict[str, pa.Table]:
    settings = noise.Settings(estimators=("allan",), added_terms=())
    return noise.run(record(NAMED, seed=seed), settings, Stand())


def modulated(seed: int = 4, **settings: Any) -> dict[str, pa.Table]:
    return modulation.run(noises(seed), modulation.Settings(**settings), Stand())


@cache
def walking(*added_terms: Literal["rate_random_walk"]) -> dict[str, pa.Table]:
    settings = noise.Settings(estimators=("allan",), added_terms=added_terms)
    return noise.run(record({"p": WALKING}, seed=2), settings, Stand())


@cache
def usual() -> dict[str, pa.Table]:
    return modulated()


def of(out: dict[str, pa.Table], table: str, channel: str) -> pd.DataFrame:
    rows = out[table].to_pandas()
    return rows[rows["channel"] == channel].reset_index(drop=True)


def figure(out: dict[str, pa.Table], channel: str, name: str) -> pd.Series[Any]:
    rows = of(out, "metrics", channel)
    return rows[rows["name"] == name].iloc[0]


def reason(out: dict[str, pa.Table], channel: str) -> str:
    rows = of(out, "findings", channel)
    return str(rows[rows["kind"] == "recommended rate"]["detail"].iloc[0])


def test_the_tables_satisfy_their_contracts() -> None:
    out = usual()
    assert set(out) == set(modulation.PRODUCES)
    for name, table in out.items():
        assert not violations(name, table), name


@pytest.mark.parametrize("channel", CHANNELS)
def test_the_growth_is_that_of_the_truth_within_its_interval(channel: str) -> None:
    table, truth = of(usual(), "modulation", channel), NAMED[channel]
    assert table["rotation_rate"].iloc[0] == 0
    size = growth(truth, table["rotation_rate"].to_numpy())
    # the 95 % interval, widened to 3.5 standard errors: rates share the errors of at most four parameters
    spread = np.log(table["upper"] / table["lower"]) / (2 * 1.96)
    assert (np.abs(np.log(table["growth"] / size)) < 3.5 * spread).all()
    assert (table["lower"] < table["growth"]).all()
    assert (table["growth"] < table["upper"]).all()


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rates, held = np.radians([0.2, 1.0, 3.0]), []
    for seed in range(12):
        out = modulated(seed, lowest_rate_deg_s=0.2, highest_rate_deg_s=100.0, rate_count=10)
        for channel in CHANNELS:
            table = of(out, "modulation", channel)
            for rate in rates:
                row = table.iloc[(table["rotation_rate"] - rate).abs().argmin()]
                truth = float(growth(NAMED[channel], row["rotation_rate"]))
                held.append(row["lower"] < truth < row["upper"])
    # 95 % of 108, about 40 of them independent: fewer than 87 % come once in 50 sets of seeds
    assert np.mean(held) > 0.87


@pytest.mark.parametrize("channel", CHANNELS)
def test_the_other_growths_are_those_of_the_model(channel: str) -> None:
    table, truth = of(usual(), "modulation", channel), NAMED[channel]
    rates = table["rotation_rate"].to_numpy()
    # as far as the model is from the truth: a fifth of the colour, which is what the intervals allow
    assert np.allclose(table["schuler_growth"], schuler_growth(truth, rates), rtol=0.6)
    assert np.isnan(table["reversing_growth"].iloc[0])
    for k in (40, 80, 120):
        assert table["reversing_growth"][k] == pytest.approx(reversing_growth(truth, rates[k]), rel=0.6)


def test_rotation_does_not_change_white_noise() -> None:
    table = of(usual(), "modulation", "p")
    assert np.allclose(table["growth"], table["growth"][0], rtol=1e-12)
    assert np.allclose(table["reversing_growth"][1:], table["growth"][0], rtol=1e-12)
    assert figure(usual(), "p", "recommended_rate")["value"] == 0
    assert figure(usual(), "p", "suppression")["value"] == 1
    assert "white noise, which rotation does not change" in reason(usual(), "p")
    # without a recommended rate the growth is told at 3 deg/s
    assert np.allclose(of(usual(), "growth", "p")["rotation_rate"], 3 * DEG)


@pytest.mark.parametrize("channel", ["q", "r"])
def test_the_recommended_rate_is_that_of_the_truth_within_its_error(channel: str) -> None:
    row = figure(usual(), channel, "recommended_rate")
    truth = recommended_rate(NAMED[channel], 0.1) / DEG
    assert row["unit"] == "deg/s"
    assert row["standard_error"] < 0.3 * truth
    # one in 1000 errors is beyond 3.3 of them
    assert abs(row["value"] - truth) < 3.3 * row["standard_error"]
    suppression = figure(usual(), channel, "suppression")
    gained = growth(NAMED[channel], truth * DEG) / growth(NAMED[channel], 0.0)
    assert abs(suppression["value"] - gained) < 3.3 * suppression["standard_error"]
    table = of(usual(), "modulation", channel)
    assert (table["rotation_rate"] / DEG - row["value"]).abs().min() < 1e-9
    assert np.allclose(of(usual(), "growth", channel)["rotation_rate"], row["value"] * DEG)


def test_rates_at_which_rotation_is_worse_are_marked() -> None:
    table = of(usual(), "modulation", "r")
    assert table["worse"].any()
    assert not table["worse"].iloc[[0, -1]].any()
    worse, at_rest = table[table["worse"]], table["growth"][0]
    assert (worse["growth"] > at_rest).all()
    assert (table[~table["worse"]]["growth"] <= at_rest * (1 + 1e-12)).all()
    row = figure(usual(), "r", "worse_below")
    assert abs(row["value"] - worse_bands(PERIODIC)[0].high / DEG) < 3.3 * row["standard_error"]
    assert not of(usual(), "modulation", "q")["worse"].any()
    assert "outside 0 to" in reason(usual(), "r")
    said = of(usual(), "findings", "r")
    assert (said["kind"] == "worse with rotation").sum() == 1


@pytest.mark.parametrize("channel", CHANNELS)
def test_the_angle_grows_as_the_truth_says(channel: str) -> None:
    table, truth = of(usual(), "growth", channel), NAMED[channel]
    t = table["duration"].to_numpy()
    assert t[-1] == pytest.approx(8 * 3600)
    rate = float(table["rotation_rate"][0])
    turning = np.sqrt(variance(truth, t, rate))
    spread = np.log(table["upper"] / table["lower"]) / (2 * 1.96)
    assert (np.abs(np.log(table["with_rotation"] / turning)) < 3.5 * spread).all()
    # S(0) is known to a fifth at best, its root to a tenth: three times that
    assert np.allclose(table["without_rotation"], np.sqrt(variance(truth, t)), rtol=0.3)


def test_a_simulated_carousel_has_the_variance_that_is_told() -> None:
    """Angles integrated along the room's axes, of independent errors, against the table."""
    table = of(modulated(hours=0.5, rate_deg_s=3.0), "growth", "q")
    row = table.iloc[-1]
    n, count = 1800, 400
    turn = np.exp(1j * 3 * DEG * np.arange(n))
    rng = np.random.default_rng(1)
    turning, still = [], []
    for _ in range(count):
        error = COLOURED.generate(n, 1.0, rng)
        turning.append(abs(error @ turn) ** 2)
        still.append(error.sum() ** 2)
    # two components give the mean square a relative error of 1/sqrt(400), one sqrt(2) of it; and half of it
    # the root, and the model's own error from the table's interval
    own = np.log(row["upper"] / row["lower"]) / (2 * 1.96)
    error = np.sqrt(0.25 / count + own**2)
    assert abs(np.log(row["with_rotation"] / np.sqrt(np.mean(turning)))) < 3.3 * error
    assert row["without_rotation"] == pytest.approx(np.sqrt(np.mean(still)), rel=0.35)


def test_a_platform_that_is_too_slow_gets_no_rate() -> None:
    out = modulated(highest_rate_deg_s=0.5)
    row = figure(out, "q", "recommended_rate")
    assert np.isnan(row["value"])
    assert "at the highest rate, 0.5 deg/s" in reason(out, "q")
    said = of(out, "findings", "q")
    assert said[said["kind"] == "recommended rate"]["severity"].tolist() == ["warning"]


def test_colour_below_the_fraction_needs_no_rotation() -> None:
    out = modulated(fraction=1e4)
    assert figure(out, "q", "recommended_rate")["value"] == 0
    assert "no rotation needed" in reason(out, "q")


def test_schuler_is_left_out_where_the_plan_says_so() -> None:
    table = modulated(schuler=False)["modulation"]
    assert table.column("schuler_growth").null_count == table.num_rows


@pytest.mark.parametrize("channel", CHANNELS)
def test_far_above_the_colour_white_noise_is_left(channel: str) -> None:
    # known to 2 percent
    assert of(usual(), "modulation", channel)["growth"].iloc[-1] == pytest.approx(N, rel=0.1)


def test_a_colour_slower_than_the_mission_is_said_to_be() -> None:
    told = modulation.run(walking(), modulation.Settings(hours=0.25), Stand())
    said = of(told, "findings", "p")
    assert (said["kind"] == "slow colour").sum() == 1
    row = of(told, "growth", "p").iloc[-1]
    truth = variance(WALKING, np.array(row["duration"]), row["rotation_rate"])
    # K is known to a third at best, and a stationary colour begins with a bias, which adds as much again
    assert abs(np.log(row["with_rotation"] / np.sqrt(truth))) < 0.5 * np.log(2) + 0.5


def test_a_walk_has_no_bounded_growth_at_rest() -> None:
    out = modulation.run(walking("rate_random_walk"), modulation.Settings(hours=0.25), Stand())
    for name, table in out.items():
        assert not violations(name, table), name
    rows = of(out, "modulation", "p")
    assert rows["growth"].isna().tolist() == [True] + [False] * (len(rows) - 1)
    truth = growth(WALKING, rows["rotation_rate"].to_numpy()[1:])
    spread = np.log(rows["upper"] / rows["lower"])[1:] / (2 * 1.96)
    assert (np.abs(np.log(rows["growth"][1:] / truth)) < 3.5 * spread).all()
    assert (figure(out, "p", "recommended_rate")["value"]) > 0
    assert np.isnan(figure(out, "p", "suppression")["value"])
    assert "grows with the cube of time" in reason(out, "p")
    row = of(out, "growth", "p").iloc[-1]
    truth = variance(WALKING, np.array(row["duration"]))
    # K is known to a tenth
    assert abs(np.log(row["without_rotation"] / np.sqrt(truth))) < 0.35
    assert (of(out, "findings", "p")["kind"] != "slow colour").all()


def test_a_model_that_does_not_fit_gives_no_advice() -> None:
    second = Noise2(float(np.sqrt(N)), 0.01, 1.0)
    two = record({"p": RandomError((*PERIODIC.terms, second))})
    settings = noise.Settings(estimators=("allan",), added_terms=())
    out = modulation.run(noise.run(two, settings, Stand()), modulation.Settings(), Stand())
    assert np.isnan(figure(out, "p", "recommended_rate")["value"])
    assert np.isnan(figure(out, "p", "suppression")["value"])
    assert "does not describe the record" in reason(out, "p")
    said = of(out, "findings", "p")
    assert said[said["kind"] == "recommended rate"]["severity"].tolist() == ["warning"]
    assert (said["kind"] != "worse with rotation").all()


FAST = RandomError((Noise2(DEG, 0.3, 0.5 * np.pi), White(N)))
"""Of three samples in a time constant at steps of 1 s, and a period of four."""


def of_model(model: RandomError, step: float) -> dict[str, pa.Table]:
    """What is said of a noise of this model, of which the record has samples every step."""
    tables = noises()
    values = {"sigma": model.coloured[0].sigma, "mu": model.coloured[0].mu, "N": model.N}
    values["lambda"] = getattr(model.coloured[0], "lambda_", 0.0)
    rows = tables["noise_model"].to_pandas()
    mine = rows[(rows["channel"] == "r") & rows["chosen"]].copy()
    mine["value"] = [values[name] for name in mine["parameter"]]
    chosen = pa.Table.from_pandas(mine, schema=tables["noise_model"].schema, preserve_index=False)
    time = (np.arange(1000) * step * 1e9).astype(np.int64)
    given = {"noise_model": chosen, "noise_information": tables["noise_information"]}
    return modulation.run({**given, "gyro": pa.table({"time": time})}, modulation.Settings(), Stand())


def test_of_a_colour_as_fast_as_the_samples_nothing_is_advised() -> None:
    out = of_model(FAST, 1.5)  # two samples in a time constant
    assert "the colour is as fast as the samples, one every 1.5 s" in reason(out, "r")
    assert np.isnan(figure(out, "r", "recommended_rate")["value"])
    assert set(of(out, "findings", "r")["kind"]) == {"recommended rate"}
    assert "worse_below" not in set(of(out, "metrics", "r")["name"])
    assert not of(out, "modulation", "r")["worse"].any()


def test_nothing_is_told_beyond_nyquist_s_frequency() -> None:
    slower = of_model(FAST, 1.0)
    assert "beyond 180 deg/s only, which samples every 1 s do not show" in reason(slower, "r")
    (band,) = worse_bands(FAST)
    assert np.degrees(band.high) == pytest.approx(154, abs=1)  # sqrt(3 lambda^2 - mu^2): below 180 deg/s
    assert np.radians(figure(slower, "r", "worse_below")["value"]) == pytest.approx(band.high, rel=1e-9)
    edge = RandomError((Noise2(DEG, 0.3, 0.7 * np.pi), White(N)))  # its band ends at 217 deg/s
    out = of_model(edge, 1.0)
    assert "worse_below" not in set(of(out, "metrics", "r")["name"])
    told = of(out, "findings", "r")
    assert told[told["kind"] == "worse with rotation"]["detail"].iloc[0].endswith("from 0 to 180 deg/s")
    faster = of_model(edge, 0.1)
    assert np.degrees(worse_bands(edge)[0].high) == pytest.approx(figure(faster, "r", "worse_below")["value"])


def test_rates_that_fall_are_a_fault_of_the_plan() -> None:
    with pytest.raises(ValidationError):
        modulation.Settings(lowest_rate_deg_s=10, highest_rate_deg_s=1)
