"""A frame that people can look at: z up, whatever the axes of the root sensor are."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array


def levelled_rotation(up: Array) -> Array:
    """`R_l_root` (3, 3) to axes whose z is `up` (3,), a unit vector in the root's frame.

    The root's own axis where that is within 20 degrees of it: a rig stands level more exactly than
    boards are held. x is the root's forward axis made level: x where its z is up, z where its y is
    down (a camera).
    """
    own = np.eye(3)[np.argmax(np.abs(up))] * np.sign(up[np.argmax(np.abs(up))])
    if own @ up > np.cos(np.radians(20.0)):
        up = own
    ahead = np.eye(3)[0 if np.argmax(np.abs(up)) == 2 else 2]
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    result: Array = np.stack([ahead, np.cross(up, ahead), up])
    return result
