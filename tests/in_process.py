"""What the command line called within the tests' own process gives back."""

from __future__ import annotations

import subprocess

Completed = subprocess.CompletedProcess[str]
