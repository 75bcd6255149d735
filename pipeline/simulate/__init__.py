"""Recordings with known truth, in every format."""
