"""A board pose as somebody is told it, from the sensor that sees it best."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.directions import facing
from rigcal.geometry.se3 import Array
from rigcal.planning.candidates import BoardPose
from rigcal.planning.site import Site, body_axes

LEGEND = (
    "Left, right, up and down are those of the sensor named. A board that faces it upright is "
    "turned left when its face then looks to that sensor's left, leans back when it looks up, and "
    "is rolled about its normal, clockwise as that sensor sees it."
)
_STEP_DEG = 5
# Nearer than a metre, places are told to half of 0.1 m.
_STEP_M, _NEAR_M = 0.1, 1.0
# A sensor this far from upright gives a poor sense of left and up (rad).
_UPRIGHT = np.radians(30.0)


def describe(site: Site, pose: BoardPose) -> str:
    """Where the board is held and how, to 0.1 m (0.05 m where it is near) and 5 degrees."""
    name = best_view(site, pose)
    R_s_b = body_axes(site.rig.sensors[name])
    T_b_t = se3.inverse(site.T_root_s[name] @ se3.transform(R_s_b, np.zeros(3))) @ pose.T_root_t
    what = "" if len(site.targets) == 1 else f"{pose.target}: "
    return f"{what}{_place(name, T_b_t[:3, 3])}; {_attitude(T_b_t)}"


def best_view(site: Site, pose: BoardPose) -> str:
    """The sensor that has the board most nearly ahead, of upright ones that are not flat if any."""

    def order(name: str) -> tuple[bool, bool, float]:
        R_root_b = site.T_root_s[name][:3, :3] @ body_axes(site.rig.sensors[name])
        to_board = pose.T_root_t[:3, 3] - site.T_root_s[name][:3, 3]
        leans = bool(R_root_b[:, 2] @ site.up < np.cos(_UPRIGHT))
        ahead = float(R_root_b[:, 0] @ to_board / np.linalg.norm(to_board))
        return leans, site.kinds[name].flat, -ahead

    return min(pose.seen_by, key=order)


def _place(name: str, p_b: Array) -> str:
    """A place (3,) forward, left, up of a sensor: along its main direction, and off that."""
    ways = (
        (f"in front of {name}", "forward"), (f"to the left of {name}", "to the left"),
        (f"above {name}", "up"),
        (f"behind {name}", "back"), (f"to the right of {name}", "to the right"),
        (f"below {name}", "down"),
    )  # fmt: skip
    level = float(np.linalg.norm(p_b[:2]))
    main = 2 if abs(p_b[2]) > 1.5 * level else int(np.argmax(np.abs(p_b[:2])))
    is_near = float(np.linalg.norm(p_b)) < _NEAR_M
    step, digits = (_STEP_M / 2, 2) if is_near else (_STEP_M, 1)
    parts = []
    for axis in (main, *(i for i in range(3) if i != main)):
        length = round(abs(float(p_b[axis])) / step) * step
        first, further = ways[axis + 3 * (p_b[axis] < 0)]
        if axis == main or length:
            parts.append(f"{length:.{digits}f} m {first if axis == main else further}")
    return ", ".join(parts)


def _attitude(T_b_t: Array) -> str:
    """How a board is turned that would else face the sensor upright."""
    away = T_b_t[:3, 3] / np.linalg.norm(T_b_t[:3, 3])
    D = facing(away, np.array([0.0, 0.0, 1.0]), np.zeros(3)).T @ T_b_t[:3, :3]
    n = D[:, 2]
    turn, lean = np.arctan2(n[0], n[2]), np.arcsin(np.clip(n[1], -1.0, 1.0))
    facing_n = se3.exp_so3(np.array([0.0, turn, 0.0])) @ se3.exp_so3(np.array([-lean, 0.0, 0.0]))
    x = facing_n.T @ D[:, 0]
    roll = np.arctan2(x[1], x[0])
    turned, leaned, rolled = (
        round(float(np.degrees(a)) / _STEP_DEG) * _STEP_DEG for a in (turn, lean, roll)
    )
    parts = []
    if turned:
        parts.append(f"turned {abs(turned)} degrees to the {'right' if turned > 0 else 'left'}")
    if leaned:
        parts.append(f"leaning {'back' if leaned > 0 else 'forward'} {abs(leaned)} degrees")
    if rolled:
        clockwise = "anticlockwise" if rolled > 0 else "clockwise"
        parts.append(f"rolled {abs(rolled)} degrees {clockwise}")
    return ", ".join(parts) or "upright, facing it"
