"""The Allan family beside allantools, beside sums over single terms, and its intervals on simulated truth."""

import tracemalloc

import allantools
import numpy as np
import pytest
from allantools.ci import edf_greenhall
from power_law import PowerLaw

from pipeline.numerics.allan import (
    KINDS,
    UnusableRecordError,
    from_integral,
    from_rates,
    spaced_factors,
    variances,
)
from pipeline.numerics.allan_confidence import confidence, degrees_of_freedom, identify

PEERS = {
    "allan": allantools.oadev,
    "modified": allantools.mdev,
    "hadamard": allantools.ohdev,
    "total": allantools.totdev,
}
STEP = 0.01


def peer(kind, integral, factors):
    tau, deviation, _, _ = PEERS[kind](integral, 1 / STEP, "phase", factors * STEP)
    return np.round(tau / STEP).astype(int), deviation


@pytest.mark.parametrize("kind", KINDS)
def test_deviations_are_those_of_allantools(kind):
    rng = np.random.default_rng(1)
    rates = 0.3 + 1e-4 * rng.standard_normal(100_000) + 1e-6 * rng.standard_normal(100_000).cumsum()
    record = from_rates(rates, STEP)
    factors = spaced_factors(record, 40, kind)
    tau, deviation, _, _ = PEERS[kind](rates, 1 / STEP, "freq", factors * STEP)
    ours = variances(record, np.round(tau / STEP), kind)
    assert len(tau) >= len(factors) - 1  # the peer drops what has a single term
    # asked for; sums of 1e5 squares in another order differ by 1e-14
    np.testing.assert_allclose(ours.deviation, deviation, rtol=1e-12)
    assert not ours.left_out.any()


@pytest.mark.parametrize("kind", KINDS)
def test_an_integral_as_given_is_the_same_record(kind):
    x = np.random.default_rng(2).standard_normal(3001).cumsum() * 1e-3
    record = from_integral(x, STEP)
    assert record.integral is x
    m, deviation = peer(kind, x, np.array([1, 2, 7, 60, 900]))
    # asked for; the same numbers enter
    np.testing.assert_allclose(variances(record, m, kind).deviation, deviation, rtol=1e-12)


def one_by_one(kind, x, starts, stops, m):
    """Terms of the definitions (SP 1065), one after the other, run by run."""
    terms = []
    for s, e in zip(starts, stops, strict=True):
        run = x[s : e + 1].astype(np.longdouble)
        last = len(run) - 1
        if kind == "total":
            if last < 2 * m:
                continue
            image = np.concatenate([2 * run[0] - run[last:0:-1], run, 2 * run[-1] - run[last - 1 :: -1]])
            i = np.arange(last + 1, 2 * last)
            terms.append(image[i + m] - 2 * image[i] + image[i - m])
        elif kind == "hadamard" and last >= 3 * m:
            terms.append(run[3 * m :] - 3 * run[2 * m : -m] + 3 * run[m : -2 * m] - run[: -3 * m])
        elif kind in ("allan", "modified") and last >= 2 * m:
            second = run[2 * m :] - 2 * run[m:-m] + run[: -2 * m]
            if kind == "modified":
                second = np.array([second[i : i + m].sum() for i in range(len(second) - m + 1)]) / m
            terms.append(second)
    terms = np.concatenate(terms)
    return np.sum(terms**2) / ((6 if kind == "hadamard" else 2) * (m * STEP) ** 2 * len(terms)), len(terms)


@pytest.mark.parametrize("kind", KINDS)
def test_only_terms_that_span_no_gap_count(kind):
    rng = np.random.default_rng(3)
    rates = 5 + rng.standard_normal(1000)
    present = np.ones(1000, dtype=bool)
    for gap in (slice(0, 3), slice(100, 101), slice(103, 300), slice(990, 1000)):
        present[gap] = False
    rates[~present] = np.nan
    record = from_rates(rates, STEP, present)
    x = np.concatenate([[0], np.nan_to_num(rates).cumsum()]) * STEP
    assert list(zip(record.starts, record.stops, strict=True)) == [(3, 100), (101, 103), (300, 990)]
    found = variances(record, np.array([200, 1, 2, 40]), kind)
    whole = variances(from_rates(np.nan_to_num(rates), STEP), found.factor, kind)
    for k, m in enumerate((1, 2, 40, 200)):
        expected, terms = one_by_one(kind, x, record.starts, record.stops, m)
        assert found.terms[k] == terms
        assert found.left_out[k] == whole.terms[k] - terms
        # x reaches 50 with the bias and 1e-16 of that over single steps of 0.01 is 1e-12
        assert found.variance[k] == pytest.approx(float(expected), rel=1e-10)


def test_a_point_that_is_missing_is_two_samples():
    x = np.random.default_rng(4).standard_normal(50).cumsum()
    present = np.ones(50, dtype=bool)
    present[20] = False
    x[20] = np.nan
    record = from_integral(x, STEP, present)
    np.testing.assert_array_equal(record.runs, [19, 28])
    assert np.isfinite(variances(record, np.array([1, 10])).variance).all()


def test_digits_of_a_long_record_under_a_large_bias():
    rng = np.random.default_rng(5)
    rates = np.round(rng.standard_normal(1_000_000) * 2**20) / 2**20  # so that 1024 + rates is exact
    factors = np.array([1, 10, 1000, 300_000])
    plain = variances(from_rates(rates, STEP), factors).variance
    biased = variances(from_rates(rates + 1024, STEP), factors).variance
    # x of a million white samples reaches 1e3 steps: 1e-13 of one, squared and averaged far below 1e-12
    np.testing.assert_allclose(biased, plain, rtol=1e-12)
    x = np.concatenate([[0], (rates - rates.mean()).astype(np.longdouble).cumsum()])
    exact = [np.mean((x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]) ** 2) / (2.0 * m**2) for m in factors.tolist()]
    np.testing.assert_allclose(plain, np.array(exact, dtype=float), rtol=1e-12)


def test_a_ramp_has_its_own_slope_and_no_hadamard_variance():
    record = from_rates(0.5 * STEP * np.arange(1000), STEP)  # 0.5 per s^2
    found = variances(record, np.array([1, 10, 100]))
    np.testing.assert_allclose(found.variance, 0.5**2 * found.tau**2 / 2, rtol=1e-10)  # rounding
    assert np.all(variances(record, found.factor, "hadamard").variance < 1e-20 * found.variance)


def test_memory_is_that_of_one_integral():
    rates = np.random.default_rng(6).standard_normal(1_000_000)
    variances(from_rates(rates[:1000], STEP), np.array([1]))  # compiled or loaded before
    tracemalloc.start()
    record = from_rates(rates, STEP)
    variances(record, spaced_factors(record, 48))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak <= 1.2 * rates.nbytes  # asked for


def test_records_that_bear_no_variance_are_refused():
    rates = np.arange(10.0)
    with pytest.raises(
        UnusableRecordError, match="no allan variance over 6 samples: the longest run without a gap has 10"
    ):
        variances(from_rates(rates, STEP), np.array([6]))
    with pytest.raises(UnusableRecordError, match="over 0 samples"):
        variances(from_rates(rates, STEP), np.array([0, 2]))
    with pytest.raises(UnusableRecordError, match="no sample"):
        from_rates(rates, STEP, np.zeros(10, dtype=bool))
    with pytest.raises(UnusableRecordError, match="no sample"):
        from_rates(rates[:0], STEP)
    with pytest.raises(ValueError, match="a mask of 9 for 10 samples"):
        from_rates(rates, STEP, np.ones(9, dtype=bool))
    with pytest.raises(UnusableRecordError, match="finite"):
        from_rates(np.where(rates == 3, np.nan, rates), STEP)
    with pytest.raises(UnusableRecordError, match="no hadamard variance of 2"):
        spaced_factors(from_rates(rates[:2], STEP), 5, "hadamard")


@pytest.mark.parametrize(("kind", "order"), [("allan", 2), ("modified", 2), ("hadamard", 3)])
def test_degrees_of_freedom_are_those_of_greenhall_and_riley(kind, order):
    n = 20_000
    for alpha in (2, 1, -1, -2, *((-3, -4) if order == 3 else ())):
        for m in (20, 300, 4000):
            if (alpha == 2 and kind != "modified" and m == 4000) or (alpha == -4 and m == 300):
                continue  # not coded by the peer
            expected = edf_greenhall(alpha, order, m, n + 1, True, kind == "modified")
            found = degrees_of_freedom(np.array([n]), m, kind, alpha)
            # their tables have three digits, and flicker of the integral (alpha = 1) fits to 3 %
            assert found == pytest.approx(expected, rel=0.035 if alpha == 1 else 0.015), (alpha, m)


def test_white_samples_have_their_known_degrees_of_freedom():
    # y2 - y1 of successive terms correlates by -1/2: nu = M/(1 + 2/4 (1 - 1/M))
    M = 999
    assert degrees_of_freedom(np.array([1000]), 1, "allan", 0) == pytest.approx(
        M / (1 + (1 - 1 / M) / 2), rel=1e-12
    )
    # two runs of equal length know twice as much as one
    both = degrees_of_freedom(np.array([500, 500]), 20, "allan", 0)
    assert both == pytest.approx(2 * degrees_of_freedom(np.array([500]), 20, "allan", 0), rel=1e-12)


TRUE_VARIANCE = {  # of unit coefficients
    2: lambda tau: 3 / tau**2,
    0: lambda tau: 1 / tau,
    -1: lambda tau: np.full_like(tau, 2 * np.log(2) / np.pi),
    -2: lambda tau: tau / 3,
}
SEEDS = 400
FACTORS = np.array([1, 4, 30, 150])
GAPPY = np.ones(1001, dtype=bool)
GAPPY[450:470] = False


@pytest.fixture(scope="module", params=[2, 0, -1, -2])
def records(request):
    law = PowerLaw(request.param, 1000)
    return request.param, [law.draw(np.random.default_rng([7, seed])) for seed in range(SEEDS)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("present", [None, GAPPY])
def test_intervals_hold_the_truth_as_often_as_they_say(records, kind, present):
    alpha, drawn = records
    law = np.full(len(FACTORS), alpha)
    values, bounds = [], []
    for x in drawn:
        record = from_integral(x, 1.0, present)
        found = variances(record, FACTORS, kind)
        known = confidence(record, found, level=0.9, alpha=law)
        values.append(found.variance / known.bias)
        bounds.append([known.lower**2, known.upper**2])
    mean = np.mean(values, axis=0)
    if kind in ("allan", "total"):
        truth = TRUE_VARIANCE[alpha](FACTORS.astype(float))
        # 4 sigma of a mean over the seeds
        assert np.all(np.abs(mean / truth - 1) < 4 * np.sqrt(2 / known.degrees_of_freedom / SEEDS))
    else:  # of other constants; the mean knows its own to a twentieth of the width of an interval
        truth = mean
    low, high = np.moveaxis(bounds, 1, 0)
    coverage = np.mean((low < truth) & (truth < high), axis=0)
    # 400 seeds know 0.9 to 0.015; the chi-square law itself is off by up to 0.02 at 3 degrees of freedom
    assert np.all(np.abs(coverage - 0.9) < 3 * 0.015 + 0.02), coverage


def test_the_power_law_is_found(records):
    alpha, drawn = records
    found = np.array([identify(from_integral(x, 1.0), np.array([1, 3, 200])) for x in drawn[:100]])
    # r is known to 0.03 and 0.055 from 1000 and 333 averages. Two laws are 0.24 or more of r apart, but for
    # noise of the integral: alpha = 2 is r = -0.5 and 1.5 is -0.43, two sigma for 333 averages; means of that
    # over 3 samples are such noise again.
    assert np.mean(found[:, :2] == alpha) >= 0.9
    # of 5 averages there is nothing to tell: what was found before holds on
    np.testing.assert_array_equal(found[:, 2], found[:, 1])


def test_the_power_law_is_not_given_up_for_chance(records):
    """Of 40 averages r is known to 0.16, and the nearest law alone would be another of up to 30 %."""
    alpha, drawn = records
    factors = np.unique(np.round(np.geomspace(1, (len(drawn[0]) - 1) / 40, 12)).astype(int))
    found = np.array([identify(from_integral(x, 1.0), factors)[-1] for x in drawn[:100]])
    # 0.95 of them hold what the shorter tau told, and a few miss there; 100 seeds know that to 0.02
    assert np.mean(found == alpha) >= 0.88


def test_power_laws_beyond_the_random_walk_are_for_hadamard():
    x = PowerLaw(-2, 2000).draw(np.random.default_rng(8)).cumsum()
    record = from_integral(x, 1.0)
    assert identify(record, np.array([1])).tolist() == [-2]
    assert identify(record, np.array([1]), -4).tolist() == [-4]
    found = variances(record, np.array([1, 20]), "hadamard")
    assert confidence(record, found).alpha.tolist() == [-4, -4]
