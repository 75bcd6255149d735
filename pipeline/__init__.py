"""gyrostand: recordings from gyroscope test stands become checked tables and quality figures.

The conventions below hold in every module; a docstring repeats them only where it departs.

Time
    ``int64`` nanoseconds (``time``) until the numerical boundary; inside the mathematics ``float64``
    seconds from the record's first sample. Which clock is the test plan's choice.

Units
    SI and radians inside, always. Ingest converts once, from the unit the test plan states.

Axes and attitude
    Body axes are right-handed, 1 along the roll axis. The Euler-Krylov angles of Godorov & Lutmanov
    turn the reference axes into the body axes by psi about axis 2, then theta about axis 3, then gamma
    about axis 1, so that the body-to-reference matrix is ``R2(psi) R3(theta) R1(gamma)`` (active
    rotations) and the body rates are::

        p = gamma' + psi' sin(theta)
        q = psi' cos(gamma) cos(theta) + theta' sin(gamma)
        r = theta' cos(gamma) - psi' cos(theta) sin(gamma)

    A quaternion is ``(w, x, y, z)``, unit, and takes body components to reference components.

Symbols
    ``p, q, r``            angular rate about body axes 1, 2, 3 [rad/s]
    ``psi, theta, gamma``  Euler-Krylov angles [rad]
    ``a, b``               trend of an angle: ``a t + b`` [rad/s, rad]
    ``alpha1, alpha2``     angles of a two-axis gimbal, outer and inner [rad]
    ``m11 ... mc2``        drift of a non-contact gyro in units of the Earth rate [1]
    ``theta1, theta2``     tilt of its rotor [rad]
    ``K, b``               scale factor [1] and bias [rad/s] of a gyro on a rate table
    ``S``                  sensitivity matrix of a triad: row i is K times the unit vector of input axis i [1]
    ``epsilon``            misalignment of the base across the Earth's axis, ``u x Delta chi`` [rad]

Words
    A *recording* is one file or rosbag2 folder; a *test plan* (TOML) says what it holds; a *procedure* is
    a list of *stages*; a stage is a pure function from *tables* to tables; a *contract* in ``schemas/``
    states what a table holds; *findings* mark the data; *metrics* carry limits and a *verdict*. A recording
    of a gimbal or of a rate table holds one *run* of the gyro or several; an *arc* is an uninterrupted
    stretch of a run, and its *trajectory* the gimbal angles on an even grid; a *step* is a stretch in which
    the table turns at one rate. A *mounting* is how a base or a case is turned in a run; a *calibration* is
    what corrects the rates of a gyro, by itself or with two others as a *triad*.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import os

    import pandas as pd

try:
    __version__ = version("gyrostand")
except PackageNotFoundError:  # a bare checkout on sys.path
    __version__ = "0+unknown"

__all__ = ["__version__", "load"]


def load(output: str | os.PathLike[str], table: str) -> pd.DataFrame:
    """Read one table of every recording below an output folder.

    Parameters
    ----------
    output : path
        The folder given to ``gyrostand run --out``.
    table : str
        A table name, as in ``gyrostand schema list``.

    Returns
    -------
    pandas.DataFrame
        The rows of all recordings, with a ``recording`` column. ``.attrs["units"]`` maps each column to
        its unit and ``.attrs["long_name"]`` to its meaning.

    Raises
    ------
    pipeline.errors.GyrostandError
        If there is no such table, or a file fails its checksum.
    """
    from pipeline.storage import load as load_table

    return load_table(output, table)
