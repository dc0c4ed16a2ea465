# SPDX-License-Identifier: Apache-2.0
"""Reads trajectories in TUM format; imported, never run. Needs python3-numpy."""
import warnings

import numpy as np


class BadTrajectory(Exception):
    """One line that says what is wrong with a file."""


def read_trajectory(path, least=1):
    """Lines (n, 8) of stamp in s, position in m and quaternion x, y, z, w, in the order of time; `least` of them at least."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about an empty file, which is refused below
            rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise BadTrajectory(f"cannot read {path}: {error}; give a trajectory in TUM format") from error
    if rows.shape[0] < least or rows.shape[1] != 8:
        raise BadTrajectory(f"{path} holds no trajectory; expected lines of `timestamp tx ty tz qx qy qz qw`, at least {least}")
    return rows[np.argsort(rows[:, 0], kind="stable")]
