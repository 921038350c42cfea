"""The picture in the README, from the folder that `rigcal demo --out DIR` wrote.

uv run python docs/images/draw_demo.py DIR docs/images/rig.png
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import rigcal
from rigcal.geometry import se3
from rigcal.recording import open_recording
from rigcal.recording.message import Source
from rigcal.rig import build_targets

CAMERA, EXPOSURE = "cam0", 2
COLOURS = {"camera": "#2464b4", "lrf2d": "#c0392b", "lrf3d": "#222222"}


def draw_rig(axes: Any, rig: rigcal.Rig, calibration: rigcal.Calibration, outline: Any) -> None:
    """The sensors with their names, among the boards."""
    boards = [se3.apply(T, outline) for T in list(calibration.target_poses.values())[::2]]
    axes.add_collection3d(
        Poly3DCollection(
            boards, facecolor="#dfe7ee", edgecolor="#8fa1b3", linewidth=0.7, alpha=0.35
        )
    )
    for name, config in rig.sensors.items():
        T, colour = calibration.T(rig.root, name), COLOURS[config.type]
        if config.type == "camera":
            corners = 0.3 * np.array([[-1, -0.8, 1], [1, -0.8, 1], [1, 0.8, 1], [-1, 0.8, 1]])
            tips = se3.apply(T, corners)
            faces = [[T[:3, 3], tips[i], tips[(i + 1) % 4]] for i in range(4)]
            axes.add_collection3d(Poly3DCollection(faces, color=colour, alpha=0.18, linewidth=0.6))
        elif config.type == "lrf2d":
            angles = np.radians(np.linspace(config.angle_min_deg, config.angle_max_deg, 80))
            rim = 0.8 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
            fan = np.vstack([T[:3, 3], se3.apply(T, rim)])
            axes.add_collection3d(Poly3DCollection([fan], color=colour, alpha=0.18))
        axes.plot(*T[:3, 3], "o", color=colour, markersize=3)
    axes.set(xlim=(-2.4, 2.4), ylim=(-2.4, 2.4), zlim=(-1.2, 1.2))
    axes.set_box_aspect((2, 2, 1), zoom=1.45)
    axes.view_init(elev=48, azim=-62)
    axes.set_axis_off()


def draw_image(axes: Any, folder: Path, rig: rigcal.Rig) -> None:
    """One image of the recording with the corners that were found in it."""
    observations, _ = rigcal.load_observations(folder / "observations.npz")
    seen = [o for o in observations if o.sensor == CAMERA and o.candidates][EXPOSURE]
    source = Source(topic=rig.sensors[CAMERA].topic)
    with open_recording(folder / "recording.mcap") as recording:
        message = next(m for m in recording.read(source) if m.stamp_ns == seen.stamp_ns)
    registry = rigcal.Registry.from_entry_points()
    image = registry.sensor_type("camera").decode(message, rig.sensors[CAMERA])
    axes.imshow(np.asarray(image), cmap="gray", vmin=0, vmax=255)
    axes.plot(*seen.candidates[0].measurement["uv"].T, ".", color="#f2a900", markersize=2.5)
    axes.set_axis_off()


def main() -> None:
    """Draw both and save them side by side."""
    folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    registry = rigcal.Registry.from_entry_points()
    rig = rigcal.load_rig(folder / "rig.yaml", registry)
    calibration = rigcal.load_calibration(folder / "calibration.yaml")
    figure = Figure(figsize=(10, 4))
    draw_image(figure.add_axes((0.0, 0.02, 0.48, 0.96)), folder, rig)
    outline = next(iter(build_targets(rig, registry).values())).outline_points
    draw_rig(figure.add_axes((0.5, 0.0, 0.5, 1.0), projection="3d"), rig, calibration, outline)
    figure.savefig(out, dpi=90, metadata={"Software": None})


if __name__ == "__main__":
    main()
