"""Poses of sensors from trees of frames: /tf_static, and what was imported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.importing.importer import Frames

BASE = "base_link"
_DIGITS = 12
"""Far below what a pose is known to, and enough that none of a file's digits is lost."""


@dataclass(frozen=True, eq=False)
class Forest:
    """Frames of one source, and the sensor whose own frame each of some is."""

    source: str
    frames: Frames
    sensor_of: Mapping[str, str]

    def up(self, frame: str) -> tuple[list[str], Array]:
        """The frames from this one to its uppermost, and its pose in that one."""
        way, T = [frame], np.eye(4)
        while way[-1] in self.frames:
            parent, T_parent_frame = self.frames[way[-1]]
            if parent in way:
                break
            way.append(parent)
            T = T_parent_frame @ T
        return way, T


def poses_of(
    forests: Sequence[Forest], root: str
) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """`pose` of sensors for rig.yaml, and the source of each; the first source that has one counts.

    A pose is in the root, or where a source does not know the root, in its first sensor.
    """
    poses, sources = dict[str, dict[str, Any]](), dict[str, str]()
    parents = dict[str, str]()
    for forest in sorted(forests, key=lambda f: root not in f.sensor_of.values()):
        for tree in _trees(forest):
            reference = root if root in tree else next(iter(tree))
            for name, T_top_s in tree.items():
                if name in (reference, root) or name in poses:
                    continue
                if name in _ancestors(parents, reference):
                    continue
                parents[name] = reference
                poses[name] = pose(reference, se3.inverse(tree[reference]) @ T_top_s)
                sources[name] = forest.source
    return poses, sources


def base_of(forests: Sequence[Forest], root: str) -> tuple[dict[str, Any], str] | None:
    """`base` for rig.yaml and its source: the root in base_link, or in the uppermost frame."""
    for forest in forests:
        own = [frame for frame, name in forest.sensor_of.items() if name == root]
        for frame in own:
            way, T_top_root = forest.up(frame)
            above = [f for f in way[1:] if f not in forest.sensor_of]
            if not above or (BASE not in above and way[-1] in forest.sensor_of):
                continue
            base = BASE if BASE in above else way[-1]
            T_top_base = forest.up(base)[1]
            return pose(base, se3.inverse(T_top_base) @ T_top_root), forest.source
    return None


def pose(parent: str, T: Array) -> dict[str, Any]:
    """A pose as rig.yaml has it."""
    rpy = np.degrees(se3.rpy_from_rotation(T[:3, :3]))
    return {
        "parent": parent,
        "translation_m": (np.round(T[:3, 3], _DIGITS) + 0.0).tolist(),
        "rpy_deg": (np.round(rpy, _DIGITS) + 0.0).tolist(),
    }


def _trees(forest: Forest) -> list[dict[str, Array]]:
    """`T_top_s` of sensors by name, one mapping for each uppermost frame."""
    trees = dict[str, dict[str, Array]]()
    for frame, name in forest.sensor_of.items():
        way, T = forest.up(frame)
        trees.setdefault(way[-1], {}).setdefault(name, T)
    return list(trees.values())


def _ancestors(parents: Mapping[str, str], name: str) -> list[str]:
    way = [name]
    while way[-1] in parents:
        way.append(parents[way[-1]])
    return way
