"""The texts of a begun test plan: what stands in it for the engineer to confirm, take up or remove."""

from __future__ import annotations

DEFINED = {
    ("Imu", "angular rate"): "rad/s",
    ("Imu", "acceleration"): "m/s^2",
    ("JointState", "angle"): "rad",
    ("NavSatFix", "angle"): "deg",
    ("NavSatFix", "length"): "m",
    ("MagneticField", "magnetic flux density"): "T",
    ("FluidPressure", "pressure"): "Pa",
}
"""Units that the definition of a message states, where the file does not, by what they measure."""

USUAL = {
    "angular rate": "rad/s or deg/s",
    "angle": "rad or deg",
    "time": "s, ms, us or ns",
    "acceleration": "m/s^2 or g",
    "length": "m or ft",
    "magnetic flux density": "T, uT or G",
    "pressure": "Pa or hPa",
}
"""Units that a blank may be filled in with."""

NAVIGATE = (
    "[navigate]",
    'start_attitude = ""    # FILL IN: levelled (at rest), external_attitude; or plan, and state it below',
    '# start_velocity = "rest"    # without a stream gnss_velocity: at rest, or plan',
    "# [navigate.start]",
    "# yaw_deg = 0.0    # and pitch_deg, roll_deg, latitude_deg, longitude_deg, height_m, velocity_m_s",
    "",
)
EARTH_FIELD = (
    "[navigate.earth_field]    # FILL IN: numbers without quotes; see ngdc.noaa.gov/geomag",
    'strength_ut = ""',
    'dip_deg = ""    # positive down',
    'declination_deg = ""    # positive to the east',
    "",
)

STAND = {
    "coning": (
        "# returns_to_start = true    # the stand ends the record in the attitude in which it began it",
    ),
    "static": (
        "# latitude_deg = 0.0    # for rate_table: degrees north",
        "# table_tilt_deg = 0.0    # for rate_table: angle of the table's axis of rotation from the vertical",
    ),
    "navigation": (),
    "drift": (
        'latitude_deg = ""    # FILL IN: degrees north, a number without quotes',
        'scheme = ""    # FILL IN: polar, equatorial, horizontal, vertical; or chi_deg = [chi1, chi2, chi3]',
    ),
}
"""What [stand] holds, by procedure."""

GYRO_ALONE = (
    '# "coning": the attitude of a gyro on a vibration stand. "static": the noise of a gyro in a long record',
    '# at rest, or on a table that turns evenly. "rate_table": scale factor, bias and misalignment of a gyro',
    '# on a table that steps from rate to rate, or in turns by known angles. "navigation": where a vehicle',
    "# went; its further streams are in docs/navigation.md.",
)
"""What is said of the procedures of a gyro without a reference."""

ROTATION = "# rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # rows: from the sensor's axes to the body axes"

PART = "# The procedure rate_table or static does with any of p, q and r: remove the others."

TABLE = (
    "# wraps_at = 360    # in the channel of an angle: the raw value at which it begins again at 0",
    "",
    "# For the procedure rate_table: how the case of the gyro is mounted on the table, run by run.",
    "# [[runs]]",
    '# name = "upright"',
    '# axis = "r"    # which axis of the case lies along the table\'s: p, q, r or -p, -q, -r',
    '# recording = "run8.mcap"    # a further recording beside this one',
    "# start = 0.0    # s from the first gyro sample of its recording",
    "# stop = 600.0",
    "",
    "# What its calibration is made of.",
    "# [calibrate]",
    '# methods = ["rates"]    # also "turns" and "positions", by hand',
    "# asymmetry = true    # false where the table turned one way only",
)
GIMBAL = (
    "# alpha1 is the outer angle, alpha2 the inner one. Of an encoder of 2^20 counts a turn:",
    '# unit = "deg", scale = 0.00034332275390625, wraps_at = 1048576',
    "",
    "# Several runs of the gyro; without them the whole recording is one run.",
    "# [[runs]]",
    '# name = "second"',
    '# recording = "run8.mcap"    # a further recording beside this one',
    "# start = 0.0    # s from the first sample of its recording",
    "# stop = 43200.0",
    '# scheme = "equatorial"    # in place of the stand\'s',
)

LIMIT = {
    "coning": (
        'metric = "relative_rms_error_corrected"',
        'channel = "gamma"',
        "upper = 0.2",
        "marginal_upper = 0.15",
    ),
    "navigation": ('metric = "horizontal_residual_rms"', 'channel = "filter"', "upper = 5.0"),
    "static": ('metric = "lost_count"', 'channel = "gyro"', "upper = 0"),
    "rate_table": ('metric = "residual_rms"', 'channel = "p"', "upper = 100.0    # ppm"),
    "drift": ('metric = "residual_rms"', 'channel = "gauss_newton"', "upper = 1.0", "marginal_upper = 0.8"),
}
"""A limit that stands as a comment in the plan of each procedure."""
