"""The project's sample recordings, one in each format, with their test plans and truth.

`write_samples` makes them anew, byte for byte. What each is for:

``godorov.mcap``
    The experiment of Godorov & Lutmanov (2016), sections 3 and 4, free of errors, processed as there.
``noisy_gap.bag``
    The same vibration by a real gyro: noise, bias, a jittered recorder, a gap, a stamp that goes back.
``onset``
    Their section 5: a smooth roll on which the vibration sets in half-way (ROS 2 bag folder, db3).
``vibration.csv``
    Another stand: a smaller and slower cone, a gyro of coarse resolution, degrees, harmonic interpolation.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from pathlib import Path
from types import MappingProxyType

from pipeline.simulate.coning import ConingSettings, simulate_coning
from pipeline.simulate.imperfections import GyroErrors, TimingErrors
from pipeline.simulate.plan import Limit, Processing, paper_stages
from pipeline.simulate.streams import AngleUnit


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample recording: what is simulated, with which seed, and how it is to be processed."""

    settings: ConingSettings
    processing: Processing
    seed: int = 0
    angle_unit: AngleUnit = "rad"


SAMPLES: Mapping[str, Sample] = MappingProxyType(
    {
        "godorov.mcap": Sample(
            ConingSettings(),
            Processing(
                title="Godorov & Lutmanov (2016), sections 3 and 4",
                stages=paper_stages(50),
                limits=(
                    Limit("relative_rms_error_corrected", "gamma", 0.2, 0.15, "the paper's figure is 0.1238"),
                    Limit("relative_rms_error", "psi", 0.3, None, "0.2619 by local cubic interpolation"),
                    Limit("relative_rms_error", "theta", 0.1, None, "0.07429 by local cubic interpolation"),
                ),
            ),
        ),
        "noisy_gap.bag": Sample(
            ConingSettings(
                duration=2.0,
                gyro=GyroErrors(white_noise=1e-3, bias=(2e-4, -1e-4, 3e-4)),
                timing=TimingErrors(
                    gaps=((1.2, 0.02),), backward_stamps=(0.5,), log_delay=2e-3, log_jitter=2e-4
                ),
            ),
            Processing(
                title="Noise, a gap and a stamp that goes back",
                stages={
                    "interpolate": {"method": "harmonic", "oversampling": 50},
                    "detrend": {"method": "harmonic"},
                },
                limits=(
                    Limit("relative_rms_error", "psi", 0.02, None, "noise and bias leave 0.002 to 0.009"),
                    Limit("relative_rms_error", "theta", 0.04, None, "noise and bias leave 0.009 to 0.017"),
                    Limit(
                        "peak_error_corrected",
                        "gamma",
                        2e-4,
                        8e-5,
                        "rad; the noise's random walk leaves 4e-5 to 1e-4, here 9.7e-5: marginal",
                    ),
                ),
            ),
            seed=7,
        ),
        "onset": Sample(
            ConingSettings(
                duration=2.0,
                first_time=-1.0,
                onset=0.0,
                smooth_slope=-0.05,
                smooth_offset=0.5,
                reference_rate=8000.0,
            ),
            Processing(
                title="Godorov & Lutmanov (2016), section 5",
                stages=paper_stages(50) | {"detrend": {"method": "extremes", "onset": "auto"}},
                limits=(
                    Limit(
                        "relative_rms_error_corrected",
                        "gamma",
                        1e-3,
                        5e-4,
                        "2.2e-4 is reached; printed 0.00474",
                    ),
                ),
            ),
        ),
        "vibration.csv": Sample(
            ConingSettings(
                cone_angle=radians(0.5),
                frequency=40.0,
                rate=500.0,
                reference_rate=4000.0,
                gyro=GyroErrors(quantum=radians(0.01)),
            ),
            Processing(
                title="Half a degree at 40 Hz, resolution 0.01 deg/s",
                stages={
                    "interpolate": {"method": "harmonic", "oversampling": 8},
                    "detrend": {"method": "harmonic"},
                },
                limits=(
                    Limit("relative_rms_error", "psi", 0.005, None, "the resolution leaves 3e-5"),
                    Limit("relative_rms_error", "theta", 0.005, None, "the resolution leaves 1.3e-3"),
                    Limit("peak_error_corrected", "gamma", 1e-6, None, "rad; the resolution leaves 2e-7"),
                ),
            ),
            angle_unit="deg",
        ),
    }
)
"""The sample recordings, by the recording's name."""


def write_samples(folder: Path) -> list[Path]:
    """Write all sample recordings with their test plans and truth; those that are there are replaced.

    Parameters
    ----------
    folder : Path
        Made if it is not there.

    Returns
    -------
    list of Path
        The recordings.
    """
    written = []
    for name, sample in SAMPLES.items():
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        simulated = simulate_coning(sample.settings, sample.seed)
        simulated.write(path, processing=sample.processing, angle_unit=sample.angle_unit)
        written.append(path)
    return written
