"""The figures of the procedure ``static``: noise of each channel, its models, what rotation does to it."""

from __future__ import annotations

from pipeline.report import static_allan, static_models, static_rotation
from pipeline.report.base import Section, Tables


def figures(tables: Tables) -> list[Section]:
    """The sections of the page; each is left out where its tables are missing or empty."""
    sections = (
        static_allan.deviations(tables),
        static_allan.coefficients(tables),
        static_models.spectrum(tables),
        static_models.models(tables),
        static_rotation.growth_by_rate(tables),
        static_rotation.angle_error(tables),
    )
    return [section for section in sections if section is not None]
