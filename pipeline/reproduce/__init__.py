"""The published figures, computed by the pipeline and set beside the papers'."""

from __future__ import annotations

from pipeline.reproduce.godorov import godorov
from pipeline.reproduce.gubarenko import gubarenko
from pipeline.reproduce.panov import Panov, panov
from pipeline.reproduce.rows import Row, as_text
from pipeline.reproduce.yang import yang

__all__ = ["Panov", "Row", "as_text", "godorov", "gubarenko", "panov", "yang"]
