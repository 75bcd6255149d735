"""Test plans: TOML to typed, checked settings; errors with file, line, key and what was probably meant.

`load` reads and checks a plan, `errors` words what is wrong with it, `locate` finds a key's line, `initial`
begins a plan from what a recording holds.
"""

from pipeline.testplan.errors import PlanError
from pipeline.testplan.load import (
    TestPlan,
    find_plan,
    load_plan,
    named_calibration,
    named_recordings,
    own_plan,
)

__all__ = [
    "PlanError",
    "TestPlan",
    "find_plan",
    "load_plan",
    "named_calibration",
    "named_recordings",
    "own_plan",
]
