"""The stages: pure functions from tables to tables, one module each."""
