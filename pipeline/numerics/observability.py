"""What rows of a regression tell of its columns, and what not: directions, states, readable combinations.

The rows are of unit variance, so that they tell a vector v of parameters to 1 / |A v|. Each column has a
standard deviation w below which knowing it is useful, so that ``p = diag(w) x`` measures all in what matters:
a singular value s of ``A diag(w)`` is the useful standard deviation over that of the rows.
Parameters may be bound to each other, ``p = T q`` with q free.

A column is judged by the rows and by what each of the *others* may be, its extent: a term that cannot matter
within its extent does not keep a column from being determined. For the marginal precision P of a column after
the rows and before them, ``1 / (P_after - P_before)`` is the variance that the rows alone give it.

Columns that are not determined may be so in combination. Of these as many are kept, in the order given, as
are determined together with the rest held fixed; the rest appear beside them with the coefficients
``G = A_kept^+ A_rest`` of the combinations ``p_kept + G p_rest``, which the rows tell whatever the rest is.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.least_squares import triangular

Float = NDArray[np.float64]
Name = TypeVar("Name", bound=Hashable)
DirectionState = Literal["determined", "weak", "null"]
ColumnState = Literal["determined", "combined", "undetermined", "given"]

_ROUNDING = 1e5 * float(np.finfo(np.float64).eps)
"""Of the largest singular value: the rows are sums of up to 1e5 steps, each rounded."""
_EXACT = 1e2 * float(np.finfo(np.float64).eps)
"""The same of rows that are exact but for the decomposition itself."""
_IN_NULL = 1e-8
"""Component in a null vector that is not rounding: they are good to 1e-11 over the gap beside them."""
_INDEPENDENT = 0.5
"""Part of a bound column that others must leave for it to stand for a freedom of its own; of three components
across a unit vector at least two leave 0.57."""
_PIVOT = 0.1
"""Of the largest component: what may be a pivot, so that no vector in echelon form is much magnified."""
_NEGLIGIBLE = 1 / 3
"""Of the useful standard deviation: what all simplified coefficients of a combination may add together."""
_SIMPLE = np.array([0.0, 0.5, 1.0, 2.0])
"""Coefficients that read as such."""
_NEAR = 0.05
"""How near a coefficient is to one of them, other than 0, to be read as such where that does not matter."""


@dataclass(frozen=True, slots=True)
class Combination(Generic[Name]):
    """A sum of parameters that the rows determine, though not each of them.

    Attributes
    ----------
    terms : mapping of name to float
        Coefficients; that of the first is 1.
    standard_deviation : float
        By the rows, with what the simplified coefficients may add.
    """

    terms: Mapping[Name, float]
    standard_deviation: float

    def evaluate(self, names: Sequence[Name], value: Float, covariance: Float) -> tuple[float, float]:
        """Value and standard error from an estimate of the parameters and its covariance."""
        # Of the terms alone: the variance of others may be infinite.
        used = [k for k, name in enumerate(names) if name in self.terms]
        weights = np.array([self.terms[names[k]] for k in used])
        variance = float(weights @ covariance[np.ix_(used, used)] @ weights)
        return float(weights @ value[used]), max(variance, 0.0) ** 0.5

    def read(self, label: Callable[[Name], str] = str) -> str:
        """In words, such as ``mc1 - theta1 + 0.83 epsilon2``."""
        words = []
        for name, coefficient in self.terms.items():
            size = f"{abs(coefficient):.3g}"
            words += [
                "-" if coefficient < 0 else "+",
                label(name) if size == "1" else f"{size} {label(name)}",
            ]
        return " ".join(words[1:])  # the first has coefficient 1


@dataclass(frozen=True, slots=True)
class Observability(Generic[Name]):
    """What the rows tell of k columns with d freedoms.

    Attributes
    ----------
    names : tuple
        Of the columns.
    singular_values : ndarray, shape (d,)
        Falling: useful standard deviation over that of the rows, along each direction. 1 is just useful.
    directions : ndarray, shape (d, k)
        Unit vectors in the space of the parameters. Null vectors, of which any mixture would serve, in
        reduced row echelon form.
    standard_deviations : ndarray, shape (d,)
        Along each direction by the rows; infinite for a null vector.
    direction_states : tuple of {"determined", "weak", "null"}
        ``weak``: worse than useful. ``null``: not at all.
    standard_errors : ndarray, shape (k,)
        Of each column by the rows, the others within their extents; infinite where the rows tell nothing.
    states : tuple of {"determined", "combined", "undetermined", "given"}
        ``given`` is a column that is bound to be zero.
    combinations : tuple of Combination
    """

    names: tuple[Name, ...]
    singular_values: Float
    directions: Float
    standard_deviations: Float
    direction_states: tuple[DirectionState, ...]
    standard_errors: Float
    states: tuple[ColumnState, ...]
    combinations: tuple[Combination[Name], ...]

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where there is a null vector."""
        if "null" in self.direction_states:
            return float("inf")
        return float(self.singular_values[0] / self.singular_values[-1])


def analyse(
    rows: Float,
    names: Sequence[Name],
    useful: Float,
    *,
    extent: Float | None = None,
    basis: Float | None = None,
) -> Observability[Name]:
    """Say what rows determine.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Of unit variance, without priors; a triangular factor serves as well.
    names : sequence of k hashables
        Those that combinations are to be of stand first.
    useful : ndarray, shape (k,)
        Standard deviation above which a parameter is not worth to be called determined.
    extent : ndarray, shape (k,), optional
        Standard deviation of each about what is assumed, before the rows; infinite, the default: anything.
    basis : ndarray, shape (k, d), optional
        T of ``p = T q``, of rank d; without it all columns are free.
    """
    T = np.eye(len(names)) if basis is None else basis
    known = np.full(len(names), np.inf) if extent is None else extent
    R = triangular(rows)
    Q = np.linalg.qr(T / useful[:, np.newaxis]).Q
    values, V = _spectrum((R * useful) @ Q)
    null = values <= _ROUNDING * values[0]
    x = np.vstack([_signed((V @ Q.T)[~null]), _echelon((V @ Q.T)[null])])
    length = np.linalg.norm(x * useful, axis=1)
    deviation = np.where(null, np.inf, length / np.where(null, 1.0, values))
    kinds: list[DirectionState] = [
        "determined" if s >= 1 else "null" if n else "weak" for s, n in zip(values, null, strict=True)
    ]
    errors = standard_deviations(R, useful, extent=known, basis=T)
    combinations, states = _judged(R, tuple(names), useful, known, T, errors)
    return Observability(
        tuple(names),
        values,
        x * useful / length[:, np.newaxis],
        deviation,
        tuple(kinds),
        errors,
        states,
        combinations,
    )


def standard_deviations(rows: Float, useful: Float, *, extent: Float, basis: Float) -> Float:
    """Standard deviation of each column by the rows, the others within their extents, shape (k,).

    Parameters as of `analyse`; infinite where the rows tell nothing, 0 where a column is bound to be zero.
    """
    Q = np.linalg.qr(basis / useful[:, np.newaxis]).Q
    before = (useful / extent)[:, np.newaxis] * Q
    values, V = _spectrum((rows * useful) @ Q)
    # rounding of precise rows would pass for knowledge beside wide extents
    kept = values > _ROUNDING * values[0]
    after = np.vstack([values[kept, np.newaxis] * V[kept], before])
    told = _precision(after, Q) - _precision(before, Q)
    bound = np.linalg.norm(Q, axis=1) < _IN_NULL
    # what the difference leaves of two equal precisions is rounding
    some = told > _ROUNDING * _precision(after, Q)
    deviation = useful / np.sqrt(np.where(some, told, 1.0))
    return np.where(bound, 0.0, np.where(some, deviation, np.inf))


def correlation(covariance: Float) -> Float:
    """Correlation matrix of a covariance, shape (k, k); 0 beside one of no or infinite variance."""
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    finite = np.isfinite(errors)
    covariance = np.where(np.outer(finite, finite), covariance, 0.0)
    scale = np.where(errors > 0, errors, np.inf)
    # One after the other: the product of two errors of a record without noise may be too small for a float.
    return np.asarray(np.clip(covariance / scale / scale[:, np.newaxis], -1.0, 1.0), dtype=np.float64)


def _spectrum(rows: Float) -> tuple[Float, Float]:
    """All d singular values of rows (n, d), falling, and their right vectors, one a row, shape (d, d)."""
    _, values, V = np.linalg.svd(rows, full_matrices=len(rows) < rows.shape[1])
    return np.pad(values, (0, rows.shape[1] - len(values))), V


def _precision(rows: Float, Q: Float) -> Float:
    """1 over the variance of each of ``x = Q y`` by rows of y, shape (k,); 0 where they leave it open."""
    values, V = _spectrum(rows)
    null = values <= _EXACT * values[0]
    parts = Q @ V.T
    variance = np.sum((parts[:, ~null] / values[~null]) ** 2, axis=1)
    open_ = np.abs(parts[:, null]).max(axis=1, initial=0.0) > _IN_NULL
    return np.where(open_ | (variance == 0), 0.0, 1 / np.where(variance > 0, variance, 1.0))


def _signed(vectors: Float) -> Float:
    """Vectors, one a row, with their largest component positive."""
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=1)[:, np.newaxis], axis=1)
    return vectors * np.sign(largest)


def _echelon(vectors: Float) -> Float:
    """Reduced row echelon form of vectors, one a row, of unit length; pivots in the order of the columns."""
    left = vectors.copy()
    for row in range(len(left)):
        size = np.abs(left[row:]).max(axis=0)
        column = int(np.flatnonzero(size > _PIVOT * size.max())[0])
        best = row + int(np.abs(left[row:, column]).argmax())
        left[[row, best]] = left[[best, row]]
        left[row] /= left[row, column]
        others = np.arange(len(left)) != row
        left[others] -= np.outer(left[others, column], left[row])
    left[np.abs(left) < _IN_NULL] = 0.0
    return left / np.linalg.norm(left, axis=1)[:, np.newaxis] if len(left) else left


def _judged(
    R: Float, names: tuple[Name, ...], useful: Float, extent: Float, T: Float, errors: Float
) -> tuple[tuple[Combination[Name], ...], tuple[ColumnState, ...]]:
    """Combinations of what is not determined, and the state of each column."""
    given = np.linalg.norm(T, axis=1) < _IN_NULL
    determined = (errors <= useful) & ~given
    free = _free_columns(T)
    # p of all columns by those of the free ones, and the rows of these, in what is useful of each
    by_free = np.linalg.solve(T[free].T, T.T).T
    rows = (R @ by_free) * useful[free]
    kept: list[int] = []
    for j in sorted(range(len(free)), key=lambda j: not determined[free[j]]):
        if _all_useful(rows[:, [*kept, j]]):
            kept.append(j)
    rest = [j for j in range(len(free)) if j not in kept]
    G, own = _beside(rows[:, kept], rows[:, rest])
    found = []
    for i, j in enumerate(kept):
        if determined[free[j]] or not rest:
            continue
        others = [free[n] for n in rest]
        g, added = _simplified(G[i] * useful[free[j]] / useful[others], useful[free[j]], extent[others])
        terms = {names[free[j]]: 1.0} | {names[n]: float(c) for n, c in zip(others, g, strict=True) if c}
        found.append(Combination(terms, float(np.hypot(own[i] * useful[free[j]], added))))
    named = np.array([any(name in c.terms for c in found) for name in names])
    combined = (np.abs(by_free) > _IN_NULL) @ named[free]
    states: list[ColumnState] = [
        "given"
        if given[k]
        else "determined"
        if determined[k]
        else "combined"
        if combined[k]
        else "undetermined"
        for k in range(len(names))
    ]
    return tuple(found), tuple(states)


def _free_columns(T: Float) -> list[int]:
    """As many columns as there are freedoms, that take all of them: the first that others leave enough of."""
    left = np.linalg.qr(T).Q.copy()
    free: list[int] = []
    for _ in range(T.shape[1]):
        size = np.linalg.norm(left, axis=1)
        column = int(np.flatnonzero(size > _INDEPENDENT * size.max())[0])
        unit = left[column] / size[column]
        left -= np.outer(left @ unit, unit)
        free.append(column)
    return sorted(free)


def _all_useful(rows: Float) -> bool:
    """Whether each column of rows (n, k), in units of its useful deviation, is told to 1 or better."""
    values, V = _spectrum(rows)
    if values[-1] <= _ROUNDING * values[0]:
        return False
    return bool(np.sum((V / values[:, np.newaxis]) ** 2, axis=0).max() <= 1)


def _beside(kept: Float, rest: Float) -> tuple[Float, Float]:
    """G of ``kept + G rest``, shape (k, r), and the standard deviations of these sums, shape (k,)."""
    values, V = _spectrum(kept)
    G = np.asarray(np.linalg.lstsq(kept, rest, rcond=None)[0], dtype=np.float64)
    return G, np.sqrt(np.sum((V / values[:, np.newaxis]) ** 2, axis=0))


def _simplified(g: Float, useful: float, extent: Float) -> tuple[Float, float]:
    """Coefficients as simple numbers, or none, where it does not matter; and the deviation this may add."""
    nearest = _SIMPLE[np.abs(np.abs(g)[:, np.newaxis] - _SIMPLE).argmin(axis=1)] * np.sign(g)
    change = np.abs(nearest - g)
    exact = change <= _IN_NULL
    may_add = np.where(exact, 0.0, np.where(exact, 1.0, change) * extent)
    near = (change <= _NEAR) | (nearest == 0)
    simple = near & (may_add <= _NEGLIGIBLE * useful / np.sqrt(len(g)))
    # without any term it would be a parameter that is determined, which it is not
    if not nearest[simple].any() and simple.all():
        simple[np.argmax(np.abs(g) * np.where(np.isfinite(extent), extent, 1.0))] = False
    return np.where(simple, nearest, g), float(np.linalg.norm(may_add[simple]))
