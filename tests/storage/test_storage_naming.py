"""Ids of recordings: safe whatever the file is called, readable where its name already is."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.storage.naming import is_safe, recording_id


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("run7.mcap", "run7"),
        ("Run7.MCAP", "Run7"),
        ("run7.csv.gz", "run7"),
        ("run7.TSV.ZST", "run7"),
        ("run.7", "run.7"),
        ("run7.log", "run7.log"),
        ("007.bag", "rec-007"),
        ("2026-11-22.db3", "rec-2026-11-22"),
        (".mcap", "rec-.mcap"),
        ("-rf.csv", "rec--rf"),
    ],
)
def test_recording_id_of_a_sound_name(name: str, expected: str) -> None:
    assert recording_id(Path("folder") / name) == expected


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("2026-11-22T10:30:00.mcap", "rec-2026-11-22T10_30_00-"),
        ("run 7.csv", "run_7-"),
        ("a$(rm -rf ~)`b`.csv", "a__rm_-rf____b_-"),
        ("стенд.csv", "rec-_____-"),
        ("run=7%2F.csv", "run_7_2F-"),
        ("x" * 300 + ".csv", "x" * 91 + "-"),
        ("\udcff.csv", "rec-_-"),
    ],
)
def test_recording_id_of_a_hostile_name_ends_with_its_hash(name: str, begins: str) -> None:
    made = recording_id(Path(name))
    assert made.startswith(begins)
    assert re.fullmatch("[0-9a-f]{8}", made.removeprefix(begins))


def test_names_that_differ_only_in_replaced_characters_stay_apart() -> None:
    assert len({recording_id(Path(f"run{c}7.csv")) for c in " :;#%&"}) == 6


@given(st.binary(min_size=1).filter(lambda name: not {0, 0x2F} & set(name)).map(os.fsdecode))
@example("..")
@example(".")
@example(".csv")
@example(".csv.gz")
@example("rec-" + "1" * 97)
def test_recording_id_is_safe_whatever_the_name(name: str) -> None:
    made = recording_id(Path(name))
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]{0,99}", made)
    assert is_safe(made)
    assert recording_id(Path(name)) == made
