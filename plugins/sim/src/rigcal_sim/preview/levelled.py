"""A frame that people can look at: z up, whatever the axes of the root sensor are."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rigcal.geometry.se3 import Array


def levelled_rotation(T_root_t: Iterable[Array]) -> Array:
    """`R_l_root` (3, 3) to axes whose z is the boards' mean y: boards are held upright.

    The root's own axis where that is within 20 degrees of it: a rig stands level more exactly than
    boards are held. x is the root's forward axis made level: x where its z is up, z where its y is
    down (a camera).
    Boards turned all ways have no mean; then z is the root's.
    """
    up = np.sum([T[:3, 1] for T in T_root_t], axis=0)
    size = float(np.linalg.norm(up))
    up = np.array([0.0, 0.0, 1.0]) if size < 1e-3 else up / size
    own = np.eye(3)[np.argmax(np.abs(up))] * np.sign(up[np.argmax(np.abs(up))])
    if own @ up > np.cos(np.radians(20.0)):
        up = own
    ahead = np.eye(3)[0 if np.argmax(np.abs(up)) == 2 else 2]
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    result: Array = np.stack([ahead, np.cross(up, ahead), up])
    return result
