"""The stage score_static on records with known truth."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from static_records import COLOURED, DEG, PERIODIC, WALKING, WHITE, record

from pipeline.models.random_error import Noise2
from pipeline.stages import noise, score_static
from pipeline.stages.base import Stand
from pipeline.storage.contract_check import violations

DEG_H = DEG / 3600


@cache
def scored() -> pa.Table:
    walking = record({"p": WHITE, "q": PERIODIC, "r": WALKING}, seed=2)
    out = noise.run(walking, noise.Settings(estimators=("allan",)), Stand())
    return score_static.run(out, score_static.Settings(), Stand())["metrics"]


def figures(channel: str) -> pd.DataFrame:
    rows = scored().to_pandas()
    return rows[rows["channel"] == channel].set_index("name")


def test_every_channel_has_every_figure_and_no_other() -> None:
    assert not violations("metrics", scored())
    for channel in "pqr":
        assert sorted(figures(channel).index) == sorted(score_static.METRICS)


def test_white_noise_has_nothing_but_its_angle_random_walk() -> None:
    told = figures("p")
    assert told.loc["N", "unit"] == "deg/sqrt(h)"
    assert abs(told.loc["N", "value"] - 0.05) < 4 * told.loc["N", "standard_error"]
    assert abs(told.loc["model_N", "value"] - 0.05) < 4 * told.loc["model_N", "standard_error"]
    others = told.drop(["N", "model_N"])
    assert others["value"].isna().all()
    assert others["standard_error"].isna().all()


def test_a_random_walk_is_told_in_deg_h_sqrt_h() -> None:
    truth = WALKING.K / DEG_H * 60
    for name in ("K", "model_K"):
        told = figures("r").loc[name]
        assert told["unit"] == "deg/h/sqrt(h)"
        assert abs(told["value"] - truth) < 4 * told["standard_error"]


def test_colour_is_told_by_size_time_and_period() -> None:
    colour = next(term for term in PERIODIC.coloured if isinstance(term, Noise2))
    truth = {
        "colour_sigma": colour.sigma / DEG_H,
        "colour_time": 1 / colour.mu,
        "colour_period": 2 * np.pi / colour.lambda_,
    }
    told = figures("q")
    for name, value in truth.items():
        # of three one beyond 3.5 standard errors of its logarithm comes once in 700 records
        relative = told.loc[name, "standard_error"] / told.loc[name, "value"]
        assert abs(np.log(told.loc[name, "value"] / value)) < 3.5 * relative, name


@pytest.mark.parametrize("seed", range(3))
def test_noise_1_has_no_period(seed: int) -> None:
    out = noise.run(record({"p": COLOURED}, seed=seed), noise.Settings(estimators=("allan",)), Stand())
    rows = score_static.run(out, score_static.Settings(), Stand())["metrics"].to_pandas().set_index("name")
    assert np.isnan(rows.loc["colour_period", "value"])
    relative = rows.loc["colour_time", "standard_error"] / rows.loc["colour_time", "value"]
    assert abs(np.log(rows.loc["colour_time", "value"] / 100)) < 3.5 * relative
