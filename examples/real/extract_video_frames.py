"""Turn synchronised videos into a folder recording: one image per camera and common instant.

    uv run python examples/real/extract_video_frames.py SESSION OUT

SESSION is a folder with `cam_0.mp4`, `cam_1.mp4`, ... and `timestamps.csv`, as caliscope writes it,
with columns `sync_index, cam_id, frame_time`. Rows of one camera, in order of time, are
the frames of its video; frames with the same sync_index were taken at the same instant. OUT gets
`cam_<id>/frame_<sync_index>.png` in grey, so that the number in a file's name is its exposure.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def frames_by_camera(table: Path) -> dict[int, list[int]]:
    """The sync index of every frame of every camera's video, in the video's order."""
    rows: dict[int, list[tuple[float, int]]] = {}
    with table.open(newline="") as lines:
        for row in csv.DictReader(lines):
            entry = (float(row["frame_time"]), int(row["sync_index"]))
            rows.setdefault(int(row["cam_id"]), []).append(entry)
    if not rows:
        raise SystemExit(f"{table}: no frames listed, expected one row per frame")
    return {camera: [sync for _, sync in sorted(entries)] for camera, entries in rows.items()}


def grey_frames(video: Path) -> Iterator[NDArray[np.uint8]]:
    """The frames of a video as grey uint8 images (height, width)."""
    import cv2

    capture = cv2.VideoCapture(str(video))
    try:
        while True:
            ok, image = capture.read()
            if not ok:
                return
            yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    finally:
        capture.release()


def extract(video: Path, sync_indices: list[int], folder: Path) -> int:
    """Write the frames of one video, named by their sync index; returns how many.

    Raises SystemExit when the video and the table disagree on the number of frames: every frame
    after a missing one would be given to the wrong instant.
    """
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    for image in grey_frames(video):
        if count < len(sync_indices):
            cv2.imwrite(str(folder / f"frame_{sync_indices[count]:04d}.png"), image)
        count += 1
    if count != len(sync_indices):
        raise SystemExit(
            f"{video}: has {count} frames, timestamps.csv lists {len(sync_indices)}; "
            "use the table that was written with this video"
        )
    return count


def main() -> None:
    """Read the command line and extract every camera's frames."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, help="folder with cam_*.mp4 and timestamps.csv")
    parser.add_argument("out", type=Path, help="folder to write the images to")
    arguments = parser.parse_args()
    table = arguments.session / "timestamps.csv"
    if not table.is_file():
        raise SystemExit(f"{table}: no such file, expected the videos' timestamps.csv")
    for camera, sync_indices in sorted(frames_by_camera(table).items()):
        video = arguments.session / f"cam_{camera}.mp4"
        count = extract(video, sync_indices, arguments.out / f"cam_{camera}")
        sys.stdout.write(f"cam_{camera}: {count} frames\n")


if __name__ == "__main__":
    main()
