"""The project's sample recordings, in all formats, with their test plans and truth.

`write_samples` makes them anew, byte for byte. What each is for, of the procedure `coning`:

``godorov.mcap``
    The experiment of Godorov & Lutmanov (2016), sections 3 and 4, free of errors, processed as there.
``noisy_gap.bag``
    The same vibration by a real gyro: noise, bias, a jittered recorder, a gap, a stamp that goes back.
``onset``
    Their section 5: a smooth roll on which the vibration sets in half-way (ROS 2 bag folder, db3).
``vibration.csv``
    Another stand: a smaller and slower cone, a gyro of coarse resolution, degrees, harmonic interpolation.

Of the procedure `drift`, one in each mounting scheme of Gubarenko & Kuzmenko (1995), with noise of 1 arcsec:

``polar.mcap``
    A day that determines all that one run can.
``equatorial``
    Two runs of one gyro, half a day each from alpha2 = 0 and 0.8: what neither tells alone (db3 folder).
``horizontal.bag``
    A day with a gap, a burst of NaN and outliers.
``vertical.csv``
    Counts of encoders of one arcsec, which begin again at 0 after a turn.

Of the procedure `static`:

``static.mcap``
    Four hours of angle increments each 2 s, of each axis another noise, with a gap.

Of the procedure `rate_table`:

``table.mcap``
    Three gyros in a case, mounted on a rate table about each of its axes; an encoder that begins again at 0.
``table_axis.csv``
    One gyro against the table's rate, while it warms: asymmetry, non-linearity, sensitivities to temperature.

Of the procedure `navigation`:

``flight.mcap``
    Three minutes from a catapult through two turns and a climb, half a minute of them without satellites.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from types import MappingProxyType

from pipeline.models.gyro_drift import DRIFT
from pipeline.models.random_error import Noise1, Noise2, RateRandomWalk, White
from pipeline.simulate.coning import ConingSettings, simulate_coning
from pipeline.simulate.drift import simulate_drift
from pipeline.simulate.drift_settings import DriftRun, DriftSettings, Encoder
from pipeline.simulate.imperfections import EncoderErrors, GyroErrors, TimingErrors
from pipeline.simulate.navigation import simulate_navigation
from pipeline.simulate.navigation_scenarios import STRAIGHT, scenario
from pipeline.simulate.navigation_settings import FlightSettings, Manoeuvre, NavigationSettings
from pipeline.simulate.plan import Limit, Processing, paper_stages
from pipeline.simulate.rate_table import simulate_rate_table
from pipeline.simulate.rate_table_samples import CASE_OF_THREE, WARMING_GYRO, specified
from pipeline.simulate.rate_table_settings import RateTableSettings
from pipeline.simulate.static import simulate_static
from pipeline.simulate.static_settings import AxisErrors, StaticSettings
from pipeline.simulate.streams import AngleUnit


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample recording: what is simulated, with which seed, and how it is to be processed."""

    settings: ConingSettings | DriftSettings | StaticSettings | RateTableSettings | NavigationSettings
    processing: Processing
    seed: int = 0
    angle_unit: AngleUnit = "rad"

    def write(self, path: Path) -> None:
        """Write it, with its test plan and its truth."""
        if isinstance(self.settings, DriftSettings):
            simulate_drift(self.settings, self.seed).write(path, processing=self.processing)
        elif isinstance(self.settings, NavigationSettings):
            flown = simulate_navigation(self.settings, self.seed)
            flown.write(path, processing=self.processing, angle_unit=self.angle_unit)
        elif isinstance(self.settings, StaticSettings):
            record = simulate_static(self.settings, self.seed)
            record.write(path, processing=self.processing, angle_unit=self.angle_unit)
        elif isinstance(self.settings, RateTableSettings):
            on_table = simulate_rate_table(self.settings, self.seed)
            on_table.write(path, processing=self.processing, angle_unit=self.angle_unit)
        else:
            simulated = simulate_coning(self.settings, self.seed)
            simulated.write(path, processing=self.processing, angle_unit=self.angle_unit)


_ARCSEC, _ARCMIN = radians(1 / 3600), radians(1 / 60)
_DEG_H = radians(1 / 3600)
_ROOT_HOUR = 60.0
"""Square root of an hour's seconds: 1 deg/sqrt(h) is a degree over it, in rad/sqrt(s)."""
_GIMBAL_STAND = "simulated gimbal stand"
_RATE_TABLE = "simulated rate table"
_STANDING = (0.8 * _ARCMIN, -0.6 * _ARCMIN, 0.5 * _ARCMIN)
"""Misalignment Delta chi of the base."""


def _walk(degrees: float) -> White:
    """White noise of an angle random walk [deg/sqrt(h)]."""
    return White((radians(degrees) / _ROOT_HOUR) ** 2)


def _gyro(
    *runs: DriftRun,
    encoder: Encoder = Encoder(),  # noqa: B008 - it is immutable
    outlier_share: float = 0.0,
    timing: TimingErrors = TimingErrors(),  # noqa: B008 - it is immutable
) -> DriftSettings:
    """One gyro, the same in all samples, sampled each minute with noise of an arcsec."""
    return DriftSettings(
        m=(0.004, -0.002, 0.003, 0.0015, -0.001, 0.002),
        theta=(6 * _ARCMIN, -4 * _ARCMIN),
        runs=runs,
        interval=60.0,
        encoder=encoder,
        errors=EncoderErrors(white_noise=_ARCSEC, outlier_share=outlier_share, outlier_size=30 * _ARCSEC),
        timing=timing,
    )


def _acceptance(undetermined: float = 0.0) -> tuple[Limit, ...]:
    """Limits of a run: that the model holds, what is told, and what the gyro's specification may be."""
    method = "gauss_newton"
    return (
        Limit("noise_level", "gimbal", 1.2, None, "arcsec; that of the encoders is 1, of their counts 0.3"),
        Limit("residual_rms", method, 1.2, None, "arcsec"),
        Limit("hold_out_rms", method, 1.5, None, "arcsec; the last part of a run, from what came before"),
        Limit("undetermined_count", "gimbal", undetermined, None, "parameters that the runs cannot tell"),
        *(Limit(name, method, 0.1, None, "deg/h; the gyro's specification", lower=-0.1) for name in DRIFT),
    )


def _flight() -> NavigationSettings:
    """Three minutes with the errors of *diff*, at half its rates."""
    flight: FlightSettings = replace(
        STRAIGHT,
        duration=180.0,
        manoeuvres=(
            Manoeuvre(kind="turn", start=30.0, length=30.0, amount=radians(90)),
            Manoeuvre(kind="climb", start=50.0, length=40.0, amount=60.0),
            Manoeuvre(kind="turn", start=75.0, length=30.0, amount=radians(-90)),
        ),
    )
    full = scenario("diff", flight=flight, outages=((120.0, 30.0),))
    slower = {name: replace(aid, rate=min(aid.rate, 10.0)) for name, aid in full.aids.items()}
    del slower["attitude"]
    return replace(full, rate=50.0, aids=slower)


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
        "polar.mcap": Sample(
            _gyro(DriftRun(scheme="polar", start=(0.6, 0.5), misalignment=_STANDING)),
            Processing("Polar scheme, a day", _GIMBAL_STAND, {}, _acceptance()),
            seed=1,
        ),
        "equatorial": Sample(
            _gyro(
                DriftRun(
                    name="inner axis at 0", scheme="equatorial", misalignment=_STANDING, duration=43_200.0
                ),
                DriftRun(
                    name="inner axis at 0.8 rad",
                    scheme="equatorial",
                    start=(0.0, 0.8),
                    misalignment=(-0.4 * _ARCMIN, 0.9 * _ARCMIN, -0.7 * _ARCMIN),
                    duration=43_200.0,
                ),
            ),
            Processing("Equatorial scheme, two runs", _GIMBAL_STAND, {}, _acceptance(undetermined=2.0)),
            seed=2,
        ),
        "horizontal.bag": Sample(
            _gyro(
                DriftRun(scheme="horizontal", misalignment=_STANDING),
                outlier_share=0.005,
                timing=TimingErrors(
                    gaps=((30_000.0, 1200.0),),
                    nan_bursts=((60_000.0, 300.0),),
                    log_delay=0.1,
                    log_jitter=0.02,
                ),
            ),
            Processing("Horizontal scheme, with a gap and outliers", _GIMBAL_STAND, {}, _acceptance()),
            seed=3,
        ),
        "vertical.csv": Sample(
            _gyro(
                DriftRun(scheme="vertical", start=(0.5, -0.5), misalignment=_STANDING),
                encoder=Encoder(counts=1_296_000, as_counts=True, unit="deg", wrapped=True),
            ),
            Processing("Vertical scheme, encoder counts", _GIMBAL_STAND, {}, _acceptance()),
            seed=4,
        ),
        "static.mcap": Sample(
            StaticSettings(
                errors={
                    "p": AxisErrors(terms=(_walk(0.02), Noise1(1.0 * _DEG_H, 0.01)), bias=3 * _DEG_H),
                    "q": AxisErrors(terms=(_walk(0.02), Noise2(1.0 * _DEG_H, 0.01, 0.05)), bias=-2 * _DEG_H),
                    "r": AxisErrors(
                        terms=(_walk(0.01), RateRandomWalk(1.0 * _DEG_H / _ROOT_HOUR)),
                        quantisation=1.0 * _ARCSEC,
                    ),
                },
                rate=0.5,
                duration=14_400.0,
                timing=TimingErrors(gaps=((4000.0, 60.0),)),
            ),
            Processing(
                "Four hours at rest",
                "simulated pier",
                limits=(
                    Limit("lost_count", "gyro_increments", 30.0, None, "samples; a minute was lost"),
                    Limit("longest_gap", "gyro_increments", 63.0, None, "s"),
                    Limit("model_N", "p", 0.022, None, "deg/sqrt(h); the gyro's specification"),
                    Limit("model_N", "q", 0.022, None, "deg/sqrt(h); by Allan it has some of the colour"),
                    Limit("model_N", "r", 0.012, None, "deg/sqrt(h)"),
                    Limit("model_K", "r", 1.3, None, "deg/h/sqrt(h)"),
                    Limit("model_Q", "r", 1.2, None, "arcsec"),
                    Limit("N", "r", 0.012, None, "deg/sqrt(h), by the Allan variance"),
                    Limit("K", "r", 1.3, None, "deg/h/sqrt(h), by the Allan variance"),
                    Limit("Q", "r", 1.2, None, "arcsec, by the Allan variance"),
                ),
            ),
            seed=10,
        ),
        "table.mcap": Sample(
            CASE_OF_THREE,
            Processing("Three mountings on a rate table", _RATE_TABLE, {}, specified("pqr")),
            seed=11,
        ),
        "table_axis.csv": Sample(
            WARMING_GYRO,
            Processing("One gyro that warms, asymmetric and not linear", _RATE_TABLE, {}, specified("p")),
            seed=12,
            angle_unit="deg",
        ),
        "flight.mcap": Sample(
            _flight(),
            Processing(
                "Three minutes of flight, half a minute without satellites",
                "simulated aircraft",
                limits=(
                    Limit("horizontal_position_rms", "filter.aided", 1.5, None, "m; GNSS of 0.5 m"),
                    Limit("velocity_rms", "filter.aided", 0.1, None, "m/s"),
                    Limit("outage_drift", "filter", 15.0, None, "m; half a minute without satellites"),
                    Limit("gyro_bias_error", "filter", 0.01, None, "deg/s; the bias is 0.045"),
                    Limit("accelerometer_bias_error", "filter", 0.03, None, "m/s^2; the bias is 0.21"),
                    Limit("horizontal_position_rms", "loops.aided", 3.0, None, "m"),
                    Limit("outage_drift", "loops", 150.0, None, "m; the loops follow gusts and sideslip"),
                ),
            ),
            seed=1,
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
        sample.write(path)
        written.append(path)
    return written
