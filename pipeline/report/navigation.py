"""The figures of the procedure ``navigation``: track, errors, biases, loops, innovations."""

from __future__ import annotations

from pipeline.report import (
    navigation_aids,
    navigation_biases,
    navigation_errors,
    navigation_innovations,
    navigation_poles,
    navigation_states,
    navigation_track,
)
from pipeline.report.base import Section, Tables


def figures(tables: Tables) -> list[Section]:
    """The sections of the page; each is left out where its tables are missing or empty."""
    sections = (
        navigation_track.track(tables),
        navigation_aids.aids(tables),
        navigation_errors.sizes(tables),
        navigation_errors.errors(tables),
        navigation_states.states(tables),
        navigation_biases.biases(tables),
        navigation_poles.poles(tables),
        navigation_innovations.innovations(tables),
    )
    return [section for section in sections if section is not None]
