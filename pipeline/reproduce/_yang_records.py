"""Identification of the noises from records: its error beside Cramér and Rao's bound, colour in white."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Noise, RandomError, White
from pipeline.models.random_error_fit import Candidate, fit_form, identify
from pipeline.models.random_error_forms import process
from pipeline.numerics import cosine_spectrum, whittle
from pipeline.reproduce._yang_noises import NOISES, RATE, RESONANT, SOURCE, title
from pipeline.reproduce.rows import Expected, Row, at_most, near

Float = NDArray[np.float64]

_SAMPLES, _STEP, _N = 14_400, 1.0, 1e-4
"""4 h at 1 Hz, white noise of N beside the coloured."""

_FITTED, _WHITE_RECORDS, _WHITE_SEED = 20, 20, 5000
"""Records of each noise, their seeds from 0 on; white records, and the seed of the first."""
_RMSE = at_most(1.15, 1.505)
"""Asked of 200 records; the root mean square of 20 reaches the root of chi-square's 99.9 % point, over 20."""
_COVERAGE = Expected(0.95, 15 / 20 / 0.95, 1 / 0.95)
"""Of 20 intervals of 95 % fewer than 15 hold the truth once in 1000 times."""
_COLOURED = at_most(1.0)
"""White records of 20 in which colour is seen; of 60 two are allowed."""


def records() -> Iterator[Row]:
    """Error and intervals of ln(S_colour + N) at 3 deg/s, and the choice by BIC on white records."""
    # two digits are given, the last of them to 1
    yield near(0.060, 1 / 60).beside(
        SOURCE, "4 h at 1 Hz, noise 1, N = 1e-4", "bound of ln(S + N) at 3 deg/s", _bound(NOISES[0])
    )
    for noise in (*NOISES, *RESONANT):
        item = f"{_FITTED} records of 4 h at 1 Hz, {title(noise)}, N = {_N:g}"
        error, held = _errors(noise)
        ratio = float(np.sqrt(np.mean(error**2))) / _bound(noise)
        yield _RMSE.beside(SOURCE, item, "RMSE of ln(S + N) at 3 deg/s over its bound, at most", ratio)
        yield _COVERAGE.beside(SOURCE, item, "share of 95 % intervals that hold it", held)
    yield _COLOURED.beside(
        SOURCE, f"{_WHITE_RECORDS} records of 4 h at 1 Hz, white", "colour seen, at most", _coloured()
    )


def _log_density(model: RandomError) -> Float:
    return np.asarray(np.log(model.psd(np.array(RATE))), dtype=np.float64)


def _theta(noise: Noise) -> Float:
    """Logarithms of the parameters, that of N the last."""
    return np.log([*noise.parameters.values(), _N])


def _bound(noise: Noise) -> float:
    """Least standard deviation of an unbiased ln(S + N)."""
    theta = _theta(noise)
    information = whittle.information(cosine_spectrum.grid(_SAMPLES), process(noise.name, theta, _STEP))
    true = Candidate(noise.name, theta, information, 0.0, 0.0, 1.0, False, True)
    return float(true.standard_error(_log_density))


def _errors(noise: Noise) -> tuple[Float, float]:
    """Errors of ln(S + N), one a record, and the share of them within 1.96 standard errors."""
    truth = RandomError((noise, White(_N)))
    error, standard_error = np.empty(_FITTED), np.empty(_FITTED)
    for seed in range(_FITTED):
        x = truth.generate(_SAMPLES, _STEP, np.random.default_rng(seed))
        fitted = fit_form(cosine_spectrum.periodogram(x), _STEP, noise.name)
        error[seed] = _log_density(fitted.model) - _log_density(truth)
        standard_error[seed] = fitted.standard_error(_log_density)
    return error, float(np.mean(np.abs(error) < 1.96 * standard_error))


def _coloured() -> float:
    """White records of which the least BIC is not that of white noise."""
    white = White(_N)
    chosen = (
        identify(white.generate(_SAMPLES, _STEP, np.random.default_rng(_WHITE_SEED + k)), _STEP).chosen
        for k in range(_WHITE_RECORDS)
    )
    return float(sum(one.form != "white" for one in chosen))
