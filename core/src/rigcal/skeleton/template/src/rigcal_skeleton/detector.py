"""A frame becomes candidates for where the board is."""

import numpy as np

import rigcal.plugin as rp
from rigcal_skeleton.config import SkeletonConfig


def detect(frame: rp.Array, config: SkeletonConfig, target: rp.Target) -> rp.Detection:
    """Each point may be the reflector; at most one is, and the other sensors tell which.

    Geometry is in the sensor's frame. `measurement` keeps the raw data that a residual of your own
    would use. A detection without candidates says why, in words for the user.
    """
    known = np.array(config.reflector_m)
    covariance = config.sigma_m**2 * np.eye(3)
    candidates = tuple(
        rp.Candidate(rp.PointGeometry(point, covariance, known), {"point": point})
        for point in frame
    )
    return rp.Detection(candidates, "" if candidates else "no point in the frame")
