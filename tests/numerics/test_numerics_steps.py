import numpy as np
import pytest

from pipeline.numerics.steps import (
    classify,
    detrended,
    noise_scale,
    running_median,
    stuck_runs,
    without_large_spikes,
)


def stands_out(values: np.ndarray, longest: int = 5) -> tuple[list[int], list[int]]:
    """Samples that spike and steps that jump, of a signal with noise of known scale."""
    steps = detrended(np.diff(values, axis=0), np.ones(len(values) - 1))
    found = classify(steps, 6 * noise_scale(steps), longest)
    return np.flatnonzero(found.spikes).tolist(), found.jumps.tolist()


def noisy(count: int, seed: int = 0) -> np.ndarray:
    """Two channels: a sinusoid of a thousand samples and a parabola, with white noise of 1."""
    t = np.arange(count)
    motion = np.stack([1e3 * np.sin(2 * np.pi * t / 1000), 1e-3 * t**2], axis=1)
    return motion + np.random.default_rng(seed).normal(size=(count, 2))


class TestClassify:
    @pytest.mark.parametrize("count", [8, 16, 40, 200, 5000])
    @pytest.mark.parametrize("seed", range(20))
    def test_noise(self, count: int, seed: int) -> None:
        noise = np.random.default_rng(seed).normal(size=(count, 2))
        assert stands_out(noise) == ([], [])
        if count >= 40:
            assert stands_out(noisy(count, seed)) == ([], [])

    @pytest.mark.parametrize("width", [1, 2, 5])
    @pytest.mark.parametrize("height", [30.0, -1e6])
    def test_a_spike_returns(self, width: int, height: float) -> None:
        values = noisy(500)
        values[200 : 200 + width, 1] += height
        assert stands_out(values) == (list(range(200, 200 + width)), [])

    @pytest.mark.parametrize("height", [30.0, -1e6])
    def test_a_jump_does_not(self, height: float) -> None:
        values = noisy(500)
        values[200:, 0] += height
        assert stands_out(values) == ([], [199])

    def test_what_lasts_longer_than_a_spike_jumps_twice(self) -> None:
        values = noisy(500)
        values[200:206, 0] += 100.0
        assert stands_out(values, longest=5) == ([], [199, 205])
        assert stands_out(values, longest=6) == ([200, 201, 202, 203, 204, 205], [])

    def test_a_spike_of_several_heights(self) -> None:
        values = noisy(500)
        values[200:204, 0] += [500.0, 40.0, 900.0, -300.0]
        assert stands_out(values) == ([200, 201, 202, 203], [])

    def test_a_spike_whose_first_step_is_small(self) -> None:
        """Only the way back stands out: it is looked for behind as well as ahead."""
        steps = np.zeros((20, 1))
        steps[[8, 9, 10, 12], 0] = [0.9, 0.9, 0.9, -2.7]  # sample 9 is within the threshold of the motion
        found = classify(steps, np.ones((20, 1)), 5)
        assert np.flatnonzero(found.spikes).tolist() == [10, 11, 12]
        assert found.jumps.size == 0

    def test_the_ends(self) -> None:
        values = noisy(500)
        values[:3] += 100.0
        values[-2:] -= 100.0
        assert stands_out(values) == ([0, 1, 2, 498, 499], [])

    def test_one_channel_does_not_excuse_the_other(self) -> None:
        """A spike in one channel at a jump of the other: the signal has not returned, before it or after."""
        values = noisy(500)
        values[200:, 0] += 100.0
        values[200, 1] += 100.0
        assert stands_out(values) == ([], [199, 200])


class TestScale:
    def test_of_white_noise(self) -> None:
        steps = np.random.default_rng(0).normal(size=(20_000, 1))
        # 6/129 more by the rule for few steps. The quantile of 129 steps scatters, its mean over the record
        # hardly does.
        assert noise_scale(steps).mean() == pytest.approx(1 + 6 / 129, rel=0.02)

    def test_of_few_steps_is_never_much_too_small(self) -> None:
        rng = np.random.default_rng(1)
        scales = [noise_scale(rng.normal(size=(12, 1))).mean() for _ in range(500)]
        assert np.quantile(scales, 0.01) > 0.7

    def test_a_smooth_rate_is_taken_off(self) -> None:
        t = np.linspace(0.0, 20.0, 400)
        steps = np.stack([np.sin(t), np.cos(t)], axis=1)
        left = detrended(steps, np.ones(400))
        # At a crest the median of 11 is the value three steps of 0.05 from it; elsewhere it is exact.
        assert np.abs(left[20:-20]).max() < 1.01 * 0.15**2 / 2
        assert np.median(np.abs(left[20:-20])) == 0
        # At the ends a line goes on: five steps of the bend that 16 steps have.
        assert np.abs(left).max() < (16 * 0.05) ** 2 / 2


class TestMedians:
    def test_running_median_by_its_definition(self) -> None:
        values = np.random.default_rng(2).normal(size=(50, 2))
        padded = np.pad(values, ((3, 3), (0, 0)), mode="symmetric")
        expected = [np.median(padded[k : k + 7], axis=0) for k in range(50)]
        assert np.array_equal(running_median(values, 7), expected)

    def test_without_large_spikes(self) -> None:
        values = np.stack([np.linspace(0, 10, 200), np.cos(np.linspace(0, 6, 200))], axis=1)
        spiking = values.copy()
        spiking[50:55, 0] += 1e3
        clean = without_large_spikes(spiking, 5)
        assert np.array_equal(
            np.delete(clean, slice(50, 55), axis=0), np.delete(values, slice(50, 55), axis=0)
        )
        assert np.abs(clean - values).max() < 0.5  # five samples of the motion


class TestStuckRuns:
    def test_a_coarse_slow_signal_is_sound(self) -> None:
        t = np.linspace(0, 6, 20_000)
        for quantum in (1e-4, 1e-2, 0.3):
            values = np.round(np.sin(t) / quantum) * quantum
            assert len(stuck_runs(values, 10)) == 0

    @pytest.mark.parametrize("quantum", [0.0, 1e-5])
    def test_a_stuck_one_is_not(self, quantum: float) -> None:
        values = np.sin(np.linspace(0, 6, 20_000)) + 1e-6 * np.random.default_rng(3).normal(size=20_000)
        if quantum:
            values = np.round(values / quantum) * quantum
        values[5000:5200] = values[5000]
        values[19_800:] = values[19_800]
        found = stuck_runs(values, 10)
        assert found.start.tolist() == [5000, 19_800]
        assert found.stop.tolist() == [5200, 20_000]

    def test_a_resting_signal_is_not_judged(self) -> None:
        """Dithering between two counts it may rest on one of them for long."""
        rng = np.random.default_rng(4)
        values = (rng.random(5000) < 0.5).astype(np.float64)
        values[2000:2200] = 1.0
        assert len(stuck_runs(values, 10)) == 0
