"""Which inertial samples are usable, how gaps are bridged, and integrals over steps.

Part of `pipeline.models.strapdown`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.models.navigation_errors import NavigationError

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

_GAP = 1.8
"""Median intervals from which on one is taken for a gap with a lost sample, not for jitter."""

_NEAR = 0.25
"""Of the step: what is found from a neighbour shorter than this would magnify noise."""


def instants(time: Float) -> Float:
    """The instants of samples, checked.

    Raises
    ------
    NavigationError
        If there are fewer than two, or they do not increase.
    """
    t = np.asarray(time, dtype=np.float64)
    if len(t) < 2:
        raise _too_few(2, len(t), len(t))
    wrong = np.flatnonzero(~(np.diff(t) > 0))
    if len(wrong):
        row = int(wrong[0])
        raise NavigationError(
            f"sample {row + 1} of the inertial sensors",
            expected="a later instant than that of the sample before",
            found=f"{t[row + 1]:.9g} s after {t[row]:.9g} s",
            remedy="leave out samples whose stamps do not advance, or choose another clock",
        )
    return t


def numbers(value: Float) -> Mask:
    """Samples, shape (n, 3), of which all components are numbers."""
    return np.asarray(np.isfinite(value).all(axis=1))


def usual_and_longest(t: Float, max_step: float | None) -> tuple[float, float]:
    """The median interval [s], and the longest that is not a gap."""
    usual = float(np.median(np.diff(t)))
    return usual, _GAP * usual if max_step is None else max_step


def between_usable(good: Mask, fewest: int) -> slice:
    """From the first usable sample to the last.

    Raises
    ------
    NavigationError
        If there are fewer than so many.
    """
    index = np.flatnonzero(good)
    if len(index) < fewest:
        raise _too_few(fewest, len(index), len(good))
    return slice(int(index[0]), int(index[-1]) + 1)


def _too_few(fewest: int, usable: int, count: int) -> NavigationError:
    return NavigationError(
        "the inertial sensors",
        expected=f"at least {fewest} samples with numbers of gyros and accelerometers",
        found=f"{usable} of {count}",
        remedy="look at the findings of the audit: a channel is empty, or the streams do not overlap",
    )


def refuse_gaps(name: str, last: Float, following: Float, max_coast: float) -> None:
    """Refuse gaps, each from a last usable instant to the following one [s], that are too long to bridge.

    Raises
    ------
    NavigationError
        Naming the first and how many there are.
    """
    length = following - last
    too_long = np.flatnonzero(length > max_coast)
    if len(too_long):
        first = too_long[0]
        raise NavigationError(
            f"{name} at {last[first]:.3f} s",
            expected=f"usable samples at most {max_coast:g} s apart",
            found=f"{length[first]:.3f} s without one"
            + (f", and {len(too_long)} such gaps" * (len(too_long) > 1)),
            remedy="navigate the stretches between the gaps by themselves, or coast for longer",
        )


def filled(t: Float, usual: float, longest: float) -> tuple[Float, Int]:
    """Instants with those that gaps lack, about as far apart as usual, and the places of the given ones."""
    h = np.diff(t)
    pieces = np.where(h > longest, np.maximum(np.rint(h / usual), 1), 1).astype(np.int64)
    index = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(pieces)])
    if index[-1] == len(h):
        return t, index
    return np.interp(np.arange(index[-1] + 1), index, t), index


def bridged(t: Float, known: Float, value: Float) -> Float:
    """Values, shape (m, 3), known at some instants, linearly at all."""
    if len(known) == len(t):
        return value
    return np.stack([np.interp(t, known, component) for component in value.T], axis=-1)


def of_samples(t: Float, value: Float, usable: Mask) -> tuple[Float, Float]:
    """Integrals of a vector over the intervals between its samples, and their first moments.

    Parameters
    ----------
    t : ndarray, shape (n + 1,)
        [s].
    value : ndarray, shape (n + 1, 3)
    usable : ndarray of bool, shape (n + 1,)
        False where the value is bridged, not measured: its kinks are no curvature.

    Returns
    -------
    integral : ndarray, shape (n, 3)
        h (w0 + w1)/2 - h³ κ/12, exact for a cubic through four samples.
    moment : ndarray, shape (n, 3)
        About the middle, divided by h: h (w1 - w0)/12.
    """
    h = np.diff(t)
    rise = np.diff(value, axis=0)
    curvature = np.diff(rise / h[:, np.newaxis], axis=0) * (2 / (h[1:] + h[:-1]))[:, np.newaxis]
    bend = usable[:-2] & usable[1:-1] & usable[2:]
    integral = (value[:-1] + value[1:]) * (h / 2)[:, np.newaxis]
    integral -= _from_both_sides(h, curvature, bend, bend) * (h**3 / 12)[:, np.newaxis]
    return integral, rise * (h / 12)[:, np.newaxis]


def slopes(h: Float, mean: Float, usable: Mask) -> Float:
    """Slope in the middle of steps of the parabola with the means over a step and both its neighbours.

    Parameters
    ----------
    h : ndarray, shape (n,)
        Lengths of the steps [s].
    mean : ndarray, shape (n, 3)
    usable : ndarray of bool, shape (n,)
        False where the mean is bridged: no slope is taken towards it from a step that is usable.

    Returns
    -------
    ndarray, shape (n, 3)
        By a line where there is but one neighbour; 0 where there is none.
    """
    slope = np.diff(mean, axis=0) * (2 / (h[1:] + h[:-1]))[:, np.newaxis]
    return _from_both_sides(h, slope, usable[:-1] | ~usable[1:], usable[1:] | ~usable[:-1])


def _from_both_sides(h: Float, between: Float, before: Mask, after: Mask) -> Float:
    """What holds in a step, from what was found between it (1) and its neighbours (0 and 2).

    ``(h1 + 2 h2)/(2 (h0 + h1 + h2))`` of the one before and ``(h1 + 2 h0)/(2 (h0 + h1 + h2))`` of the one
    after: so curvatures of parabolas make the integral of a cubic, slopes between means that of a parabola.

    Parameters
    ----------
    h : ndarray, shape (n,)
    between : ndarray, shape (n - 1, 3)
        Of each pair of steps.
    before, after : ndarray of bool, shape (n - 1,)
        Whether the pair is good for its later step, and for its earlier one.

    Returns
    -------
    ndarray, shape (n, 3)
        From one side where the other is not good; 0 where neither is.
    """
    first, second = np.zeros(len(h)), np.zeros(len(h))
    first[1:] = (h[1:] + 2 * np.append(h[2:], 0.0)) * (before & (h[:-1] >= _NEAR * h[1:]))
    second[:-1] = (h[:-1] + 2 * np.append(0.0, h[:-2])[: len(h) - 1]) * (after & (h[1:] >= _NEAR * h[:-1]))
    total = np.where(first + second > 0, first + second, 1.0)
    whole = np.zeros((len(h), 3))
    whole[1:] = (first / total)[1:, np.newaxis] * between
    whole[:-1] += (second / total)[:-1, np.newaxis] * between
    return whole
