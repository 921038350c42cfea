"""A fused moment as files: the cloud, its picture, and the overlays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigcal.files import replacing
from rigcal.fusing.colour import Image
from rigcal.fusing.fuse import Fused
from rigcal.fusing.picture import oblique


def write_fused(folder: Path | str, fused: Fused) -> dict[str, Path]:
    """Write cloud.ply, cloud.png, overlay_CAMERA.png into a folder; the paths by what they are.

    The cloud is binary PLY: x, y, z (m, in the root's frame), red, green, blue, and `sensor`, whose
    names stand in the comments. InputError when the place cannot be written to.
    """
    folder = Path(folder)
    paths = {"cloud": folder / "cloud.ply", "picture": folder / "cloud.png"}
    _write_ply(paths["cloud"], fused)
    _write_png(paths["picture"], oblique(fused))
    for camera, picture in fused.overlays.items():
        paths[f"overlay {camera}"] = folder / f"overlay_{camera}.png"
        _write_png(paths[f"overlay {camera}"], picture)
    return paths


def _write_ply(path: Path, fused: Fused) -> None:
    from plyfile import PlyData, PlyElement

    fields = [(n, "<f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue", "sensor")]
    vertices = np.empty(len(fused.points), fields)
    for i, name in enumerate("xyz"):
        vertices[name] = fused.points[:, i]
    for i, name in enumerate(("red", "green", "blue")):
        vertices[name] = fused.colours[:, i]
    vertices["sensor"] = fused.sensor
    comments = [f"sensor {i} is {name}" for i, name in enumerate(fused.sensors)]
    data = PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<", comments=comments)
    with replacing(path) as temporary:
        data.write(str(temporary))


def _write_png(path: Path, picture: Image) -> None:
    import cv2

    _, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
