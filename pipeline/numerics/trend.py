"""The linear trend ``a t + b`` of a vibrating angle, by three methods, each with standard errors.

Source: Godorov & Lutmanov, *Problems of Mechanics and Control* 48 (2016), (4.1)-(4.3), for
`trend_by_extremes`; `harmonic` is the least-squares trend weighted by the residual's own noise
(`noise_model`).

An integrated rate has two kinds of noise: a random walk from the rate's noise, and white noise of the
angle. Their levels come from the record itself. The noise is taken to begin with the record, where the
integration began from a given attitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.noise_model import Fit, generalised_least_squares, ordinary_least_squares
from pipeline.numerics.vibration import harmonic_design

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FEWEST_BLOCKS = 8
"""Block means below which two noise levels cannot be told apart."""
_WEAKEST_COLUMN = 0.05
"""Root mean square of a block-averaged sinusoid below which its ordinary estimate is kept as it is."""


class TooFewRowsError(ValueError):
    """The record is too short for a trend and the two levels of its noise."""


@dataclass(frozen=True, slots=True)
class Trend:
    """A trend ``a t + b`` and the noise that was found around it.

    Attributes
    ----------
    a, b : float
        Slope, rad/s, and value at t = 0, rad.
    a_standard_error, b_standard_error : float
        Of a, rad/s, and of b, rad.
    white_angle_noise : float
        Standard deviation of the white noise of one row, rad.
    angle_random_walk : float
        Level of the random walk, rad/sqrt(s).
    left_out : int
        Rows that counted for nothing, as outlying.
    jumps : int
        Steps of the angle that counted for nothing, as outlying.
    """

    a: float
    b: float
    a_standard_error: float
    b_standard_error: float
    white_angle_noise: float
    angle_random_walk: float
    left_out: int = 0
    jumps: int = 0


@dataclass(frozen=True, slots=True)
class Extremes:
    """The three extremes (4.1) of an angle: first and second maximum, minimum; times [s], values [rad]."""

    t: tuple[float, float, float]
    y: tuple[float, float, float]

    @property
    def separation(self) -> float:
        """Time between the two maxima, s."""
        return abs(self.t[1] - self.t[0])


@dataclass(frozen=True, slots=True)
class Blocks:
    """Rows of a regression, averaged over blocks of equal length.

    Attributes
    ----------
    design : (m, p) array
        The averaged columns that are worth estimating; 1 and t first.
    residual : (m,) array
        The averaged residual of the ordinary solution, rad.
    ordinary : (2,) array
        Ordinary estimates of b, rad, and a, rad/s.
    observed : (m,) bool array
        False where a block has no row left, and in the first and the last.
    length : float
        Length of a block, s.
    rows : int
        Rows in a block.
    """

    design: Matrix
    residual: Vector
    ordinary: Vector
    observed: NDArray[np.bool_]
    length: float
    rows: int


def find_extremes(t: Vector, y: Vector) -> Extremes:
    """The maxima of the two halves of a record and its minimum, each refined by a parabola.

    Parameters
    ----------
    t : (n,) array
        Uniform times, s.
    y : (n,) array
        The angle, rad.

    Returns
    -------
    Extremes

    Notes
    -----
    ::

        t_max1 = argmax y on [t0, (t0+T)/2],  t_max2 = argmax y on [(t0+T)/2, T],  t_min = argmin y on [t0, T]

    An extreme at the border of its interval that is none of the record is taken as it stands.
    """
    middle = 0.5 * (t[0] + t[-1])
    last_of_first = int(np.searchsorted(t, middle, side="right"))
    first_of_second = int(np.searchsorted(t, middle, side="left"))
    places = (
        int(np.argmax(y[:last_of_first])),
        first_of_second + int(np.argmax(y[first_of_second:])),
        int(np.argmin(y)),
    )
    refined = [_vertex(t, y, i) for i in places]
    return Extremes(
        (refined[0][0], refined[1][0], refined[2][0]), (refined[0][1], refined[1][1], refined[2][1])
    )


def trend_by_extremes(extremes: Extremes, noise: Trend) -> Trend:
    """The trend (4.2), (4.3) through three extremes.

    Parameters
    ----------
    extremes : Extremes
    noise : Trend
        Of the same record by `harmonic` or `robust`: its noise levels give the standard errors.

    Returns
    -------
    Trend

    Notes
    -----
    ::

        a = (y_max1 - y_max2) / (t_max1 - t_max2)
        b = (y_max1 + y_min - a (t_max1 + t_min)) / 2

    Both are linear in the three values, whose noise has the covariance ``R δ_ij + q min(t_i, t_j)``.
    """
    t_max1, t_max2, t_min = extremes.t
    y_max1, y_max2, y_min = extremes.y
    a = (y_max1 - y_max2) / (t_max1 - t_max2)
    b = (y_max1 + y_min - a * (t_max1 + t_min)) / 2
    row_a = np.array([1.0, -1.0, 0.0]) / (t_max1 - t_max2)
    row_b = (np.array([1.0, 0.0, 1.0]) - row_a * (t_max1 + t_min)) / 2
    times = np.array(extremes.t)
    covariance = noise.white_angle_noise**2 * np.eye(3)
    covariance += noise.angle_random_walk**2 * np.minimum.outer(times, times)
    return Trend(
        a,
        b,
        float(np.sqrt(row_a @ covariance @ row_a)),
        float(np.sqrt(row_b @ covariance @ row_b)),
        noise.white_angle_noise,
        noise.angle_random_walk,
    )


def harmonic(t: Vector, y: Vector, frequency: float | None, harmonics: int, block: int) -> Trend:
    """The trend of least squares over 1, t, cos kwt, sin kwt, weighted by the residual's own noise.

    Parameters
    ----------
    t : (n,) array
        Uniform times from 0, s.
    y : (n,) array
        The angle, rad.
    frequency : float or None
        Fundamental of the vibration, Hz; None where there is none.
    harmonics : int
        Number K of harmonics, all below the Nyquist frequency of t.
    block : int
        Rows that are averaged before they are weighted: at least two sample intervals of the gyro, because
        rows that were interpolated between samples are no independent observations.

    Returns
    -------
    Trend

    Raises
    ------
    TooFewRowsError
        If fewer than eight blocks count, or no more than the coefficients need.
    """
    design = harmonic_design(t, frequency, harmonics)
    coefficients = ordinary_least_squares(design, y)
    blocks = average(design, y, coefficients, np.ones(t.size, dtype=np.bool_), block, t[1] - t[0])
    fit = generalised_least_squares(blocks.design, blocks.residual, observed=blocks.observed)
    return as_trend(blocks, fit)


def average(
    design: Matrix, y: Vector, coefficients: Vector, keep: NDArray[np.bool_], rows: int, step: float
) -> Blocks:
    """Average the columns and the residual of an ordinary solution over blocks.

    Averaging is linear, so that the averaged rows obey the same model. A sinusoid that the average
    extinguishes (e.g. of a whole number of periods in a block, or sampled at its zeros) keeps its ordinary
    estimate: its column is left out. The first and the last block do not count: the one-sided interpolation
    of the rates in a record's end intervals puts a step into the angle, by which the noise would be judged.

    Parameters
    ----------
    design : (n, p) array
        Columns 1, t, cos, sin …
    y : (n,) array
    coefficients : (p,) array
        The ordinary solution.
    keep : (n,) bool array
        False for rows to leave out.
    rows : int
        Rows in a block; an incomplete last block is left out.
    step : float
        Time between rows, s.

    Returns
    -------
    Blocks

    Raises
    ------
    TooFewRowsError
        As `harmonic`.
    """
    m = y.size // rows
    if m < FEWEST_BLOCKS:
        raise TooFewRowsError(f"too few block means for a trend and its noise: {m}")
    weights = keep[: m * rows].reshape(m, rows).astype(np.float64)
    count = weights.sum(axis=1)
    observed = count > 0
    observed[[0, -1]] = False
    weights /= np.maximum(count, 1.0)[:, None]
    averaged = np.einsum("br,brc->bc", weights, design[: m * rows].reshape(m, rows, -1))
    residual = np.einsum("br,br->b", weights, (y - design @ coefficients)[: m * rows].reshape(m, rows))
    worth = np.sqrt(np.mean(averaged[observed] ** 2, axis=0)) > _WEAKEST_COLUMN
    worth[:2] = True
    columns = _independent(averaged, observed, np.flatnonzero(worth))
    if np.count_nonzero(observed) < max(FEWEST_BLOCKS, columns.size + 3):
        raise TooFewRowsError(f"too few block means for a trend and its noise: {np.count_nonzero(observed)}")
    return Blocks(averaged[:, columns], residual, coefficients[:2], observed, rows * step, rows)


def as_trend(blocks: Blocks, fit: Fit, left_out: int = 0, jumps: int = 0) -> Trend:
    """The trend that a weighted fit of the block means comes to, with noise levels of rows and seconds."""
    b, a = blocks.ordinary + fit.coefficients[:2]
    errors = np.sqrt(np.diag(fit.covariance)[:2])
    return Trend(
        float(a),
        float(b),
        float(errors[1]),
        float(errors[0]),
        float(np.sqrt(max(fit.white, 0.0) * blocks.rows)),
        float(np.sqrt(fit.walk / blocks.length)),
        left_out,
        jumps,
    )


def _vertex(t: Vector, y: Vector, i: int) -> tuple[float, float]:
    """Vertex of the parabola through the rows i-1, i, i+1, where i is an extreme between them."""
    if i in (0, y.size - 1):
        return float(t[i]), float(y[i])
    left, right = y[i - 1] - y[i], y[i + 1] - y[i]
    curvature = left + right
    if left * right < 0 or curvature == 0:
        return float(t[i]), float(y[i])
    shift = 0.5 * (left - right) / curvature
    return float(t[i] + shift * (t[1] - t[0])), float(y[i] - 0.25 * (left - right) * shift)


def _independent(columns: Matrix, rows: NDArray[np.bool_], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the columns, in their order, that the ones before do not already make up."""
    chosen: list[int] = []
    basis: list[Vector] = []
    for j in order:
        left = columns[rows, j] / np.linalg.norm(columns[rows, j])
        for _ in range(2):  # twice is enough
            for q in basis:
                left = left - (q @ left) * q
        size = float(np.linalg.norm(left))
        if size > 1e-6:
            basis.append(left / size)
            chosen.append(int(j))
    return np.array(chosen, dtype=np.intp)
