"""Reading recordings through `pipeline.formats.read`, beside the libraries as their user calls them.

MCAP, ROS 1 bag
    100,000 ``sensor_msgs/Imu`` messages: three rates and the header's stamp of each. The peers deserialise
    every message by rosbags, from the container's own reader (`mcap` with its checksums on, rosbags), and
    list the same four numbers.
CSV
    1,000,000 rows of time and three rates. The peer is ``pandas.read_csv``; its times are doubles, ours are
    exact nanoseconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from _timing import Candidate, by_turns, machine, show, wants_json
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from pipeline import formats
from pipeline.formats.base import Request, Series, TimeField

MESSAGES = 100_000
ROWS = 1_000_000
ROUNDS = 3
TOPIC = "/gyro"
IMU = "sensor_msgs/msg/Imu"
FIELDS = tuple(f"angular_velocity.{axis}" for axis in "xyz")
COLUMNS = ("p (rad/s)", "q (rad/s)", "r (rad/s)")
Row = tuple[int, float, float, float]


def main() -> None:
    as_json = wants_json("speed of reading recordings beside mcap, rosbags and pandas")
    with TemporaryDirectory() as folder:
        mcap, bag, text = (Path(folder) / f"run.{suffix}" for suffix in ("mcap", "bag", "csv"))
        for path, count, names in ((mcap, MESSAGES, FIELDS), (bag, MESSAGES, FIELDS), (text, ROWS, COLUMNS)):
            formats.write(path, [samples(count, names)])
        of_messages = Request(TOPIC, FIELDS)
        of_rows = Request("", ("p", "q", "r"), (TimeField("time", "s"),))
        candidates = {
            "MCAP": Candidate(ours(mcap, of_messages), MESSAGES),
            "MCAP by mcap and rosbags": Candidate(lambda: mcap_and_rosbags(mcap), MESSAGES),
            "bag": Candidate(ours(bag, of_messages), MESSAGES),
            "bag by rosbags": Candidate(lambda: rosbags_alone(bag), MESSAGES),
            "CSV": Candidate(ours(text, of_rows), ROWS),
            "CSV by pandas": Candidate(lambda: pd.read_csv(text), ROWS),
        }
        timings = by_turns(candidates, ROUNDS)
    pairs = [("MCAP by mcap and rosbags", "MCAP"), ("bag by rosbags", "bag"), ("CSV by pandas", "CSV")]
    show(
        {
            "machine": machine("mcap", "rosbags", "pandas", "pyarrow"),
            "ns a message or row": {name: timings.nanoseconds(name) for name in candidates},
            "times quicker than its peer": {quick: timings.ratio(slow, quick) for slow, quick in pairs},
        },
        as_json,
    )


def samples(count: int, names: Sequence[str]) -> Series:
    """White rates at 400 Hz, under the names of the fields or columns that hold p, q, r."""
    stamp = 1_700_000_000_000_000_000 + np.arange(count, dtype=np.int64) * 2_500_000
    rates = np.random.default_rng(0).normal(size=(3, count))
    return Series(TOPIC, IMU, stamp, stamp, dict(zip(names, rates, strict=True)))


def ours(path: Path, request: Request) -> Callable[[], object]:
    return lambda: formats.read(path, [request])


def mcap_and_rosbags(path: Path) -> list[Row]:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages(topics=[TOPIC])
        return [row(store.deserialize_cdr(message.data, IMU)) for _, _, message in messages]


def rosbags_alone(path: Path) -> list[Row]:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as reader:
        return [row(store.deserialize_ros1(data, IMU)) for _, _, data in reader.messages()]


def row(imu: Any) -> Row:
    rate, stamp = imu.angular_velocity, imu.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec, rate.x, rate.y, rate.z


if __name__ == "__main__":
    main()
