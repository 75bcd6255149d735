import numpy as np
import pytest

from pipeline.numerics.sample_faults import clipped_runs, frozen_runs, spikes, usual_hold

COUNT = 100_000


def noise(seed: int, step: float = 0.0) -> np.ndarray:
    """White noise of standard deviation 1, rounded to multiples of a step."""
    values = np.random.default_rng(seed).normal(size=COUNT)
    return np.round(values / step) * step if step else values


def sinusoid(per_period: float, step: float = 0.0, phase: float = 0.0) -> np.ndarray:
    values = np.sin(2 * np.pi * np.arange(20_000) / per_period + phase)
    return np.round(values / step) * step if step else values


class TestSoundDataIsNotMarked:
    @pytest.mark.parametrize("step", [0.0, 0.1, 1.0, 2.0, 5.0])
    @pytest.mark.parametrize("seed", range(5))
    def test_noise_at_any_resolution(self, step: float, seed: int) -> None:
        values = noise(seed, step)
        assert len(frozen_runs(values, 10)) == 0
        assert len(clipped_runs(values, 3)) == 0
        assert not spikes(values, 4.0).any()

    @pytest.mark.parametrize("per_period", [2.5, 4, 4.5, 8, 10, 37.3, 400, 4000, 40_000])
    @pytest.mark.parametrize("step", [0.0, 1e-3, 1e-2, 0.1])
    @pytest.mark.parametrize("phase", [0.0, np.pi / 4, 1.0])
    def test_sinusoids_at_any_resolution(self, per_period: float, step: float, phase: float) -> None:
        """Among them 4 samples a period, the paper's coning, whose second differences equal the signal."""
        values = sinusoid(per_period, step, phase)
        assert len(frozen_runs(values, 10)) == 0
        assert len(clipped_runs(values, 3)) == 0
        assert not spikes(values, 4.0).any()

    def test_white_noise_makes_less_than_one_spike_in_a_million(self) -> None:
        """None in five million: were the rate 1e-6, that had a probability of exp(-5) = 0.7 %."""
        rng = np.random.default_rng(11)
        assert sum(int(spikes(rng.normal(size=1_000_000), 4.0).sum()) for _ in range(5)) == 0

    def test_a_step_a_kink_and_the_onset_of_a_vibration_are_no_spikes(self) -> None:
        still = np.zeros(1000)
        step = np.concatenate([still, still + 1])
        kink = np.concatenate([still, np.arange(1000.0)])
        onset = np.concatenate([still, sinusoid(4.0, phase=np.pi / 2)])
        for values in (step, kink, onset):
            assert not spikes(values, 4.0).any()

    def test_a_plateau_entered_by_a_step_is_not_clipped(self) -> None:
        """A roll of constant rate before a vibration: its rate is the extreme of the record."""
        values = np.concatenate([np.full(400, -0.05), np.full(400, -0.1457)])
        values[400:] += 1e-17 * np.arange(400)  # what rounding does to a computed constant
        assert len(clipped_runs(values, 3)) == 0

    @pytest.mark.parametrize("values", [np.empty(0), np.array([1.0]), np.ones(5), np.ones(1000)])
    def test_little_or_constant_data(self, values: np.ndarray) -> None:
        assert len(frozen_runs(values, 2)) == 0
        assert len(clipped_runs(values, 2)) == 0
        assert not spikes(values, 4.0).any()


class TestFrozen:
    @pytest.mark.parametrize("step", [0.0, 0.1, 1.0])
    def test_stretches_are_found_whole_and_one_by_one(self, step: float) -> None:
        values = noise(3, step)
        for start, stop in ((500, 560), (561, 630), (70_000, 70_080)):
            values[start:stop] = values[start]
            values[stop] = values[start] + 3  # so that the stretch ends where it is said to
            values[start - 1] = values[start] - 3
        found = frozen_runs(values, 10)
        assert found.start.tolist() == [500, 561, 70_000]
        assert found.stop.tolist() == [560, 630, 70_080]

    def test_all_channels_must_hold(self) -> None:
        values = np.stack([noise(1), noise(2)], axis=1)
        values[100:200, 0] = 1.0
        assert len(frozen_runs(values, 10)) == 0
        values[150:200, 1] = 1.0
        found = frozen_runs(values, 10)
        assert (found.start.tolist(), found.stop.tolist()) == ([150], [200])

    def test_held_values_are_the_signal_s_own_measure(self) -> None:
        """A sensor of 50 Hz recorded at 400 Hz repeats each value eight times, and is not frozen."""
        values = np.repeat(noise(4)[:5000], 8)
        assert usual_hold(values) == 8
        assert len(frozen_runs(values, 5)) == 0
        values[8000:8400] = values[8000]
        found = frozen_runs(values, 5)
        assert (found.start.tolist(), found.stop.tolist()) == ([8000], [8400])


class TestClipped:
    @pytest.mark.parametrize("per_period", [37.3, 400, 4000])
    @pytest.mark.parametrize("step", [0.0, 1e-3, 1e-2, 0.1])
    def test_a_cut_sinusoid_is_found_at_both_rails(self, per_period: float, step: float) -> None:
        values = np.clip(sinusoid(per_period, step), -0.7, 0.7)
        found = clipped_runs(values, 3)
        marked = np.concatenate([np.arange(a, b) for a, b in zip(found.start, found.stop, strict=True)])
        assert np.array_equal(np.unique(marked), marked)
        # Every sample at a rail belongs to a run of at least three, but for those cut by the record's end.
        assert np.count_nonzero(np.abs(values) == np.abs(values).max()) - len(marked) <= 2

    def test_one_rail_alone(self) -> None:
        values = np.minimum(sinusoid(400), 0.9)
        found = clipped_runs(values, 3)
        assert len(found) == 50  # 20,000 samples of 400 a period
        assert np.all(values[found.start] == 0.9)


class TestSpikes:
    @pytest.mark.parametrize("sign", [-1.0, 1.0])
    def test_tall_ones_are_found_where_they_are(self, sign: float) -> None:
        values = noise(6)
        at = np.arange(100, COUNT, 500)
        values[at] += 20 * sign
        # The threshold is about 9.2 sigma, and d has a noise of 1.2 sigma: 9 of them away.
        assert np.flatnonzero(spikes(values, 4.0)).tolist() == at.tolist()

    def test_on_a_vibration_of_a_quarter_of_the_rate(self) -> None:
        values = sinusoid(4.0)
        values[[1001, 5000]] += [6.0, -6.0]
        assert np.flatnonzero(spikes(values, 4.0)).tolist() == [1001, 5000]

    def test_on_a_coarse_signal_at_rest(self) -> None:
        """Single flips by one count are the signal's resolution; twenty counts are a spike."""
        values = np.zeros(10_000)
        values[::97] = 1.0
        values[5000] = 20.0
        assert np.flatnonzero(spikes(values, 4.0)).tolist() == [5000]
