"""The methods of a navigation, side by side on one problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pipeline.errors import ExitCode
from pipeline.models import correction_loops, navigation_filter, navigation_smoother, strapdown
from pipeline.models.correction_response import Analysis
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_problem import Navigation, Problem
from pipeline.stages._navigation_settings import Method, Settings
from pipeline.stages.base import StageError


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


def navigations_of(problem: Problem, settings: Settings) -> tuple[list[Navigation], dict[Method, str]]:
    """What each method makes of the problem, in their usual order; and why another could not.

    Raises
    ------
    NavigationError
        The first, if none could.
    """
    found: list[Navigation] = []
    failed: dict[Method, str] = {}
    first: NavigationError | None = None
    for methods, navigate in _jobs(settings):
        try:
            found += [one for one in navigate(problem, settings) if one.method in methods]
        except NavigationError as error:
            first = first or error
            failed |= dict.fromkeys(methods, str(error))
    if not found:
        assert first is not None, "a plan has at least one method"
        raise first
    return found, failed


Job = Callable[[Problem, Settings], list[Navigation]]


def _jobs(settings: Settings) -> list[tuple[tuple[Method, ...], Job]]:
    """What is to be computed: the smoother goes back over what the filter found."""
    jobs: list[tuple[tuple[Method, ...], Job]] = [
        (("strapdown",), _strapdown),
        (("loops",), _loops),
        (("filter", "smoother"), _filter),
    ]
    wanted = ((tuple(m for m in methods if m in settings.methods), job) for methods, job in jobs)
    return [(methods, job) for methods, job in wanted if methods]


def _strapdown(problem: Problem, settings: Settings) -> list[Navigation]:  # noqa: ARG001
    return [strapdown.navigate(problem)]


def _loops(problem: Problem, settings: Settings) -> list[Navigation]:
    return [correction_loops.navigate(problem, settings.loops.settings(settings.stale))]


def _filter(problem: Problem, settings: Settings) -> list[Navigation]:
    told = settings.filter.settings(settings.stale)
    if "smoother" not in settings.methods:
        return [navigation_filter.navigate(problem, told)]
    filtered = navigation_filter.run(problem, told, keep_history=True)
    smoothed = navigation_smoother.run_back(filtered, keep_factors=False)
    # What it carries of innovations is the filter's.
    return [filtered.navigation, replace(smoothed.navigation, innovations={})]
