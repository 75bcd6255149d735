"""Figures of merit of an angle against its reference.

Source: Godorov & Lutmanov, *Problems of Mechanics and Control* 48 (2016), (2.5).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def relative_rms_error(
    t: Vector, difference: Vector, reference: Vector, segment: NDArray[np.integer] | None = None
) -> float | None:
    """The criterion (2.5), by the trapezoid rule.

    ::

        I_x = sqrt( ∫ (x⁰ - x_ref)² dt / ∫ x_ref² dt )

    Parameters
    ----------
    t : (n,) array
        Times, strictly increasing, s.
    difference : (n,) array
        x⁰ - x_ref, rad.
    reference : (n,) array
        x_ref, rad.
    segment : (n,) array of int, optional
        Number of the uninterrupted stretch; nothing is integrated from one into the next.

    Returns
    -------
    float or None
        None where the reference is zero throughout, or no stretch has two samples: the criterion is then
        not defined.
    """
    step = np.diff(t)
    if segment is not None:
        step = np.where(np.diff(segment) == 0, step, 0.0)
    power = _integral(reference, step)
    return float(np.sqrt(_integral(difference, step) / power)) if power > 0 else None


def _integral(x: Vector, step: Vector) -> float:
    """Integral of x² by the trapezoid rule."""
    return float(0.5 * step @ (x[1:] ** 2 + x[:-1] ** 2))
