"""Filter and smoother of navigation are as wrong as they say, where their model of errors is true."""

from __future__ import annotations

import numpy as np
import pytest
from navigation_filter_flights import drawn, flight

from pipeline.models.navigation_consistency import Truth, errors, mean_band, normalised_squares
from pipeline.models.navigation_filter import run
from pipeline.models.navigation_filter_settings import (
    ColouredErrors,
    FilterSettings,
    GaussMarkov,
    MeasurementNoise,
    StartDeviations,
)
from pipeline.models.navigation_smoother import run_back

AIDS = {"position": 1.0, "velocity": 1.0, "airspeed": 0.2, "altitude": 0.1, "magnetic_field": 0.1}
START = StartDeviations(tilt=0.01, yaw=0.01, wind=2.0)
"""Such that the second order stays below the noise: 0.01 rad squared is 1e-4, 2 m/s across 40 is 0.05 m/s."""
WHITE = FilterSettings(start=START, measurement=MeasurementNoise(airspeed=0.5))
COLOURED = FilterSettings(
    start=START,
    measurement=MeasurementNoise(
        position=0.3, velocity=0.05, airspeed=0.1, altitude=0.3, magnetic_field=0.2e-6
    ),
    coloured=ColouredErrors(position=GaussMarkov(0.5, 30.0), gust=GaussMarkov(1.06, 6.6), hard_iron=0.15e-6),
)
SEEDS = 20


@pytest.fixture(scope="module", params=[WHITE, COLOURED], ids=["white", "coloured"])
def studied(request):
    """NEES, errors over sigma, and NIS by aid of 20 records of 90 s with an outage of 30 s."""
    settings, truth = request.param, flight(90.0, 0.02, turns=0.3)
    squares, relative, nis = {"filter": [], "smoother": []}, {"filter": [], "smoother": []}, {}
    for seed in range(SEEDS):
        record = drawn(truth, settings, AIDS, np.random.default_rng(seed), outage=(40.0, 70.0))
        forward = run(record.problem, settings, keep_history=True)
        back = run_back(forward, keep_factors=True)
        true = Truth(
            truth.position, truth.velocity, truth.attitude, record.gyro_bias, record.accelerometer_bias
        )
        pick = np.arange(100, len(forward.rows), 100)
        for found, factor in ((forward, forward.history.factor), (back, back.factor)):
            error = errors(found.navigation, true)[forward.rows[pick]]
            method = found.navigation.method
            squares[method].append(normalised_squares(error, factor[pick]))
            relative[method].append(error / np.linalg.norm(factor[pick], axis=1)[:, -15:])
        for aid, found in forward.navigation.innovations.items():
            nis.setdefault(aid, []).append(found.normalised_squared)
    return squares, relative, nis


@pytest.mark.parametrize("method", ["filter", "smoother"])
def test_squared_errors_are_chi_squared(studied, method):
    squares, _, _ = studied
    # nine instants 10 s apart, correlated by what is constant: each within the band of 20 records at 99.9 %,
    # the mean of all within that at 99.9 % of no more than the 20
    at_once = np.mean(squares[method], axis=0)
    low, high = mean_band(15, SEEDS, 0.999)
    assert ((at_once > low) & (at_once < high)).all()


@pytest.mark.parametrize("method", ["filter", "smoother"])
def test_errors_over_their_deviations_are_of_size_one(studied, method):
    _, relative, _ = studied
    size = np.sqrt(np.mean(np.square(relative[method]), axis=(0, 1)))
    # 20 records tell a standard deviation to 16 % where an error is constant; of 15 states, 2.5 of those
    assert (size > 0.6).all()
    assert (size < 1.4).all()
    # all together: 300 numbers at least, 4 %; 2.5 of those
    assert np.sqrt(np.mean(np.square(size))) == pytest.approx(1.0, abs=0.1)


def test_squared_innovations_are_chi_squared(studied):
    _, _, nis = studied
    for aid, found in nis.items():
        values = np.concatenate(found)
        rows = 1 if aid in ("airspeed", "altitude") else 3
        low, high = mean_band(rows, len(values), 0.999)
        assert low < values.mean() < high, aid


def test_the_band_is_that_of_chi_squared():
    # Bar-Shalom, Li, Kirubarajan (2001), 5.4.2: 50 runs of 2 degrees of freedom, 95 %: [1.5, 2.6]
    low, high = mean_band(2, 50)
    assert low == pytest.approx(1.5, abs=0.05)
    assert high == pytest.approx(2.6, abs=0.05)


def test_squares_are_those_of_dense_algebra():
    rng = np.random.default_rng(0)
    factor = np.triu(rng.standard_normal((4, 18, 18))) + 3 * np.eye(18)
    error = rng.standard_normal((4, 15))
    covariance = (factor.transpose(0, 2, 1) @ factor)[:, -15:, -15:]
    wanted = [e @ np.linalg.solve(P, e) for e, P in zip(error, covariance, strict=True)]
    # condition of a few thousand, times an ulp
    np.testing.assert_allclose(normalised_squares(error, factor), wanted, rtol=1e-10)
