"""``python -m pipeline`` is ``gyrostand``."""

from pipeline.cli import main

main()
