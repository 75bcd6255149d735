"""The figures of the procedure ``rate_table``: the record, residuals, the calibration, the input axes."""

from __future__ import annotations

from pipeline.report import rate_table_axes, rate_table_parameters, rate_table_record, rate_table_residuals
from pipeline.report.base import Section, Tables


def figures(tables: Tables) -> list[Section]:
    """The sections of the page; each is left out where its tables are missing or empty."""
    sections = (
        rate_table_record.record(tables),
        rate_table_residuals.by_rate(tables),
        rate_table_residuals.in_time(tables),
        rate_table_residuals.by_temperature(tables),
        rate_table_parameters.calibration(tables),
        rate_table_axes.axes(tables),
    )
    return [section for section in sections if section is not None]
