"""The pictures of a recording, drawn from the recording itself and its truth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from rigcal.calibration import Calibration
from rigcal.errors import ConfigError
from rigcal.files import write_text
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.progress import Progress
from rigcal.recording import open_recording
from rigcal.rig import Rig
from rigcal.targets import Target
from rigcal.workers import in_order
from rigcal_sim.preview.frames import views
from rigcal_sim.preview.levelled import levelled_rotation
from rigcal_sim.preview.overview import write_overview
from rigcal_sim.preview.page import write_page
from rigcal_sim.preview.panels import Sensor
from rigcal_sim.sight import sensors_that_see

_BATCH = 4
_DOING = "drawing what was seen"


@dataclass(frozen=True, eq=False)
class _Setting:
    """What all pages share."""

    rig: Rig
    registry: Registry
    target: Target
    recording: Path
    truth: Calibration
    R_l_root: Array
    out: Path


def write_preview(
    rig: Rig,
    registry: Registry,
    target: Target,
    recording: Path | str,
    truth: Calibration,
    out: Path | str,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Path:
    """Write rig.png, a page for each exposure and an index.html into folder `out`; the index.

    `truth` is that of the recording (truth.yaml), with the times at which the board was held. Works
    for every sensor type that offers a `view`; the others are named on the pages. ConfigError for a
    truth without those times or with other sensors.
    """
    setting = _Setting(
        rig, registry, target, Path(recording), truth,
        levelled_rotation(truth.up), Path(out),
    )  # fmt: skip
    _check(setting)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("exposure_*.png"):
        old.unlink()
    names = list(truth.target_poses)
    tell = progress or (lambda *_: None)
    tell(_DOING, 0, len(names))
    _overview(setting)
    batches = [names[k : k + _BATCH] for k in range(0, len(names), _BATCH)]
    done = 0
    for count in in_order(
        _write_pages, setting, batches, min(jobs or os.cpu_count() or 1, len(batches))
    ):
        done += count
        tell(_DOING, done, len(names))
    write_text(out / "index.html", _index(rig.name, names))
    return out / "index.html"


def _check(setting: _Setting) -> None:
    truth, rig = setting.truth, setting.rig
    unknown = [name for name in rig.sensors if name not in truth.sensors]
    if unknown:
        raise ConfigError(
            f"the truth of {setting.recording} has no sensor '{unknown[0]}' "
            f"(has: {', '.join(truth.sensors)}); give the rig that it was simulated with"
        )
    missing = [name for name in truth.target_poses if name not in truth.holds_ns]
    if missing or not truth.target_poses:
        what = f"exposure '{missing[0]}'" if missing else "any exposure"
        raise ConfigError(
            f"the truth of {setting.recording} does not say when the board was held for {what}; "
            "expected a truth.yaml of `rigcal simulate`"
        )


def _overview(setting: _Setting) -> None:
    T_l_root = se3.transform(setting.R_l_root, np.zeros(3))
    sensors = {}
    for name, config in setting.rig.sensors.items():
        kind = setting.registry.sensor_type(config.type)
        sensors[name] = (kind, config, T_l_root @ setting.truth.T(setting.truth.root, name))
    outline = setting.target.outline_points
    boards = [se3.apply(T_l_root @ T, outline) for T in setting.truth.target_poses.values()]
    title = f"{setting.rig.name}: {len(sensors)} sensors, {len(boards)} exposures"
    write_overview(setting.out / "rig.png", title, sensors, np.array(boards))


def _write_pages(setting: _Setting, names: Sequence[str]) -> int:
    """The pages of some exposures (runs in a worker process); how many."""
    rig, registry = setting.rig, setting.registry
    columns = int(np.ceil(np.sqrt(len(rig.sensors))))
    root = setting.truth.root
    T_root_s = {name: setting.truth.T(root, name) for name in rig.sensors}
    with open_recording(setting.recording) as recording:
        for name in names:
            T_root_t = setting.truth.target_poses[name]
            seen = views(rig, registry, recording, setting.truth.holds_ns[name])
            in_view = sensors_that_see(rig, registry, setting.target, T_root_t, T_root_s)
            sensors = [
                (_sensor(setting, sensor, T_root_t, T), seen[sensor])
                for sensor, T in T_root_s.items()
            ]
            title = f"exposure {name}: the board is in view of {', '.join(in_view) or 'no sensor'}"
            write_page(setting.out / f"exposure_{name}.png", title, sensors, columns)
    return len(names)


def _sensor(setting: _Setting, name: str, T_root_t: Array, T_root_s: Array) -> Sensor:
    config = setting.rig.sensors[name]
    kind = setting.registry.sensor_type(config.type)
    T_s_t = se3.inverse(T_root_s) @ T_root_t
    R_l_s = setting.R_l_root @ T_root_s[:3, :3]
    return Sensor(name, kind, config, setting.target, T_s_t, R_l_s)


def _index(rig: str, names: Sequence[str]) -> str:
    """A page that shows all pictures, loaded as they are scrolled to."""
    style = "body{font:15px sans-serif;margin:1.5em;color:#222}img{max-width:100%;margin:.6em 0}"
    pages = "\n".join(
        f'<img id="{name}" src="exposure_{name}.png" loading="lazy" alt="exposure {name}">'
        for name in names
    )
    links = " ".join(f'<a href="#{name}">{name}</a>' for name in names)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(rig)}</title>'
        f"<style>{style}</style></head>\n<body><h1>{escape(rig)}</h1>\n"
        f'<img src="rig.png" alt="the rig among its boards">\n<p>{links}</p>\n{pages}\n'
        "</body></html>\n"
    )
