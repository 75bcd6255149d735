"""The figures of the procedure ``drift``: trajectory, residuals, parameters, and what the record can tell."""

from __future__ import annotations

from pipeline.report import (
    drift_correlation,
    drift_estimates,
    drift_observability,
    drift_parameters,
    drift_residuals,
    drift_trajectory,
)
from pipeline.report.base import Section, Tables


def figures(tables: Tables) -> list[Section]:
    """The sections of the page; each is left out where its tables are missing or empty."""
    sections = (
        drift_trajectory.trajectory(tables),
        drift_trajectory.sky_plane(tables),
        drift_residuals.residuals(tables),
        drift_parameters.drift(tables),
        drift_parameters.installation(tables),
        drift_estimates.estimates(tables),
        drift_observability.observability(tables),
        drift_correlation.correlation(tables),
    )
    return [section for section in sections if section is not None]
