"""The methods of a navigation, side by side on one problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models import correction_loops, navigation_filter, navigation_smoother, strapdown
from pipeline.models.correction_response import Analysis
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_problem import Navigation, Problem
from pipeline.stages._navigation_settings import Method, Settings
from pipeline.stages.base import StageError

Float = NDArray[np.float64]


def analyses_of(problem: Problem, settings: Settings) -> tuple[Analysis, ...]:
    """What is known of the loops before they run; none where they are not among the methods.

    Raises
    ------
    CorrectionGainsError
        If one of them is not stable; with the limit.
    StageError
        If they are to take their attitude from a reference that is not there.
    """
    if "loops" not in settings.methods:
        return ()
    told = settings.loops.settings(settings.stale)
    if told.attitude == "X" and "attitude" not in problem.aids:
        raise StageError(
            "test plan, key navigate.loops.attitude_reference",
            expected="a usable external attitude, which the reference 'X' is",
            found="none",
            remedy="add [streams.external_attitude], or choose 'A', 'M' or 'none'",
            exit_code=ExitCode.USAGE,
        )
    correction_loops.check_problem(problem, told)
    return correction_loops.analyses(problem, told)


@dataclass(frozen=True, slots=True)
class Done:
    """What a method makes of a problem.

    Attributes
    ----------
    navigation : Navigation
    nodes : ndarray of int, shape (K,)
        Instants of which the covariance is known.
    factor : ndarray, shape (K, n, 9), or None
        Of the covariance of attitude, velocity and position there: its columns are those of the factor of
        all n states. None where nobody asked for it, or the method has none.
    """

    navigation: Navigation
    nodes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    factor: Float | None = None


def navigations_of(
    problem: Problem, settings: Settings, *, judged: bool
) -> tuple[list[Done], dict[Method, str]]:
    """What each method makes of the problem, in their usual order; and why another could not.

    Parameters
    ----------
    problem : Problem
    settings : Settings
    judged : bool
        Whether the covariances of filter and smoother are to be kept.

    Raises
    ------
    NavigationError
        The first, if none could.
    """
    found: list[Done] = []
    failed: dict[Method, str] = {}
    first: NavigationError | None = None
    for methods, navigate in _jobs(settings):
        try:
            done = navigate(problem, settings, judged)
            found += [one for one in done if one.navigation.method in methods]
        except NavigationError as error:
            first = first or error
            failed |= dict.fromkeys(methods, str(error))
    if not found:
        assert first is not None, "a plan has at least one method"
        raise first
    return found, failed


Job = Callable[[Problem, Settings, bool], list[Done]]


def _jobs(settings: Settings) -> list[tuple[tuple[Method, ...], Job]]:
    """What is to be computed: the smoother goes back over what the filter found."""
    jobs: list[tuple[tuple[Method, ...], Job]] = [
        (("strapdown",), _strapdown),
        (("loops",), _loops),
        (("filter", "smoother"), _filter),
    ]
    wanted = ((tuple(m for m in methods if m in settings.methods), job) for methods, job in jobs)
    return [(methods, job) for methods, job in wanted if methods]


def _strapdown(problem: Problem, settings: Settings, judged: bool) -> list[Done]:  # noqa: ARG001
    return [Done(strapdown.navigate(problem))]


def _loops(problem: Problem, settings: Settings, judged: bool) -> list[Done]:  # noqa: ARG001
    return [Done(correction_loops.navigate(problem, settings.loops.settings(settings.stale)))]


def _filter(problem: Problem, settings: Settings, judged: bool) -> list[Done]:
    told = settings.filter.settings(settings.stale)
    back = "smoother" in settings.methods
    filtered = navigation_filter.run(problem, told, keep_history=back or judged)
    factor = _last(filtered.history.factor) if judged and filtered.history is not None else None
    done = [Done(filtered.navigation, filtered.rows, factor)]
    if back:
        smoothed = navigation_smoother.run_back(filtered, keep_factors=judged)
        # What it carries of innovations is the filter's.
        navigation = replace(smoothed.navigation, innovations={})
        done.append(Done(navigation, smoothed.rows, _last(smoothed.factor) if judged else None))
    return done


def _last(factor: Float) -> Float:
    """The columns of attitude, velocity and position alone, so that the others need not be kept."""
    return factor[:, :, -9:].copy()
