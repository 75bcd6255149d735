"""The Allan family of variances of a rate, through gaps, from its integral alone.

With x the integral of the rate y at steps tau0, tau = m tau0, and the sum over M terms (W. J. Riley,
*Handbook of Frequency Stability Analysis*, NIST SP 1065, 2008, (11), (14), (20), (25))::

    allan      sum (x[i+2m] - 2 x[i+m] + x[i])^2 / (2 tau^2 M)
    modified   sum (sum_{j=i}^{i+m-1} (x[j+2m] - 2 x[j+m] + x[j]))^2 / (2 tau^2 m^2 M)
    hadamard   sum (x[i+3m] - 3 x[i+2m] + 3 x[i+m] - x[i])^2 / (6 tau^2 M)
    total      sum (x*[i+m] - 2 x[i] + x*[i-m])^2 / (2 tau^2 M),  x* is x and its images by its end points

All overlap. A gap is not filled: a term counts if every sample that it spans is there. Between gaps lies a
*run* of samples; the terms of all runs have equal weight. (For `total` each run has its own images, and takes
part from 2m samples on.)

x is the only array that is made, and none if x is given. Its digits are those of its largest value: the mean
rate is taken out before the sum, which is compensated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics import _kernels_allan as kernels

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]
Kind = Literal["allan", "modified", "hadamard", "total"]

KINDS: tuple[Kind, ...] = get_args(Kind)
"""The estimators."""


class UnusableRecordError(ValueError):
    """No record for the Allan family: too short for a tau, or a sample that is no number."""


@dataclass(frozen=True, slots=True)
class Record:
    """A rate as its integral, and where it has samples.

    Attributes
    ----------
    integral : ndarray, shape (n + 1,)
        x; sample k lies between x[k] and x[k + 1]. What it is within a gap has no meaning.
    step : float
        tau0 [s].
    starts, stops : ndarray of int64, shape (r,)
        Run k has the samples starts[k] to stops[k] - 1.
    """

    integral: Float
    step: float
    starts: Integer
    stops: Integer

    @property
    def samples(self) -> int:
        """N, samples and gaps."""
        return len(self.integral) - 1

    @property
    def runs(self) -> Integer:
        """Samples of each run."""
        return self.stops - self.starts


@dataclass(frozen=True, slots=True)
class Variances:
    """An Allan variance against tau.

    Attributes
    ----------
    kind : str
        Of `KINDS`.
    factor : ndarray of int64, shape (k,)
        m, ascending.
    tau : ndarray, shape (k,)
        [s].
    variance : ndarray, shape (k,)
        In the square of the rate's unit.
    terms, left_out : ndarray of int64, shape (k,)
        Terms of the sum, and those that a gap has cost.
    """

    kind: Kind
    factor: Integer
    tau: Float
    variance: Float
    terms: Integer
    left_out: Integer

    @property
    def deviation(self) -> Float:
        """Root of the variance, in the rate's unit."""
        return np.sqrt(self.variance)


def from_rates(rates: Float, step: float, present: Mask | None = None) -> Record:
    """A record from rates, which are means over a step (or increments over a step, divided by it).

    Parameters
    ----------
    rates : ndarray, shape (n,)
        At equal steps, gaps included.
    step : float
        tau0 [s].
    present : ndarray of bool, shape (n,), optional
        False where there is no sample, whatever stands there; by default all are.

    Raises
    ------
    UnusableRecordError
        If nothing is present, or a sample that is present is not finite.
    """
    starts, stops = _runs(present, len(rates))
    values = np.ascontiguousarray(rates, dtype=np.float64)
    bias = kernels.mean(values, starts, stops)
    _refuse_unless_finite(bias)
    integral = np.empty(len(values) + 1)
    kernels.integrate(values, starts, stops, bias, step, integral)
    return Record(integral, step, starts, stops)


def from_integral(integral: Float, step: float, present: Mask | None = None) -> Record:
    """A record from the integral of a rate, as an integrating sensor gives it; it is not copied.

    Parameters
    ----------
    integral : ndarray, shape (n + 1,)
        At equal steps, gaps included.
    step : float
        tau0 [s].
    present : ndarray of bool, shape (n + 1,), optional
        False where there is no point; by default all are there.

    Raises
    ------
    UnusableRecordError
        If no two successive points are there, or a point that is there is not finite.
    """
    both = None if present is None else present[1:] & present[:-1]
    starts, stops = _runs(both, len(integral) - 1)
    x = np.ascontiguousarray(integral, dtype=np.float64)
    _refuse_unless_finite(kernels.mean(x, starts, stops + 1))
    return Record(x, step, starts, stops)


def spaced_factors(record: Record, count: int = 48, kind: Kind = "allan") -> Integer:
    """Factors m evenly spaced in their logarithm, from 1 to the longest that a run has a term for.

    Parameters
    ----------
    record : Record
    count : int
        At most so many: the smallest coincide as whole numbers.
    kind : str
        Of `KINDS`.

    Raises
    ------
    UnusableRecordError
        If no run has a term.
    """
    longest = int(record.runs.max())
    largest = longest // 2 if kind in ("allan", "total") else (longest + (kind == "modified")) // 3
    if largest < 1:
        raise UnusableRecordError(f"no {kind} variance of {longest} samples without a gap")
    return np.unique(np.round(np.geomspace(1, largest, count)).astype(np.int64))


def variances(record: Record, factors: Integer, kind: Kind = "allan") -> Variances:
    """The variance of one kind at each factor.

    Parameters
    ----------
    record : Record
    factors : ndarray of int, shape (k,)
        m = tau / tau0, at least 1, in any order.
    kind : str
        Of `KINDS`.

    Raises
    ------
    UnusableRecordError
        If a factor has no term: no run is long enough.
    """
    m = np.unique(np.asarray(factors, dtype=np.int64))
    terms = np.array([int(terms_of_runs(record.runs, int(f), kind).sum()) for f in m])
    if m[0] < 1 or not terms.all():
        wrong = m[0] if m[0] < 1 else m[terms == 0][0]
        raise UnusableRecordError(
            f"no {kind} variance over {wrong} samples: the longest run without a gap has {record.runs.max()}"
        )
    whole = np.array([int(terms_of_runs(np.array([record.samples]), int(f), kind).sum()) for f in m])
    sums = np.zeros(len(m))
    arguments = (record.integral, record.starts, record.stops, m, sums)
    if kind == "modified":
        kernels.averaged_differences(*arguments)
    elif kind == "hadamard":
        kernels.third_differences(*arguments)
    else:
        kernels.second_differences(*arguments)
    if kind == "total":
        kernels.reflected_differences(*arguments)
    tau = m * record.step
    scale = (6.0 if kind == "hadamard" else 2.0) * tau**2 * terms
    if kind == "modified":
        scale *= m.astype(np.float64) ** 2
    return Variances(kind, m, np.asarray(tau, dtype=np.float64), sums / scale, terms, whole - terms)


def terms_of_runs(runs: Integer, m: int, kind: Kind) -> Integer:
    """Terms that runs of so many samples have at a factor, shape as ``runs``."""
    if kind == "total":
        return np.where(runs >= 2 * m, runs - 1, 0)
    span = {"allan": 2 * m, "hadamard": 3 * m, "modified": 3 * m - 1}[kind]
    return np.maximum(runs - span + 1, 0)


def _runs(present: Mask | None, samples: int) -> tuple[Integer, Integer]:
    """First samples of the runs, and those after their last."""
    if present is None:
        present = np.ones(max(samples, 0), dtype=np.bool_)
    if len(present) != max(samples, 0):
        raise ValueError(f"a mask of {len(present)} for {samples} samples")
    if not present.any():
        raise UnusableRecordError("no sample is there")
    edges = np.flatnonzero(present[1:] != present[:-1]) + 1
    bounds = np.concatenate([[0], edges, [samples]]).astype(np.int64)
    first = 0 if present[0] else 1
    return np.ascontiguousarray(bounds[first:-1:2]), np.ascontiguousarray(bounds[first + 1 :: 2])


def _refuse_unless_finite(mean: float) -> None:
    if not np.isfinite(mean):
        raise UnusableRecordError("a sample that is counted as there is not a finite number")
