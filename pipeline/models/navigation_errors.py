"""The one error of the models of navigation."""

from __future__ import annotations

from pipeline.errors import ExitCode, GyrostandError


class NavigationError(GyrostandError):
    """What cannot be navigated: a gap too long to coast over, a pole, a start that is no number."""

    exit_code = ExitCode.NOT_MET
