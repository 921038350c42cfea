"""Where a sensor sees something at rest, and what of it never moves at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.association.place import Places, places_of
from rigcal.geometry.se3 import Array
from rigcal.observation import Detection
from rigcal.targets.target import Target

STILL_M = 0.01
"""What hands that hold a board still may move it by."""
BACKGROUND = "its candidates are found in the same place throughout the recording: background"
_SLICES = 10
_LEAST_SLICES = 6
_SLICE_FRAMES = 12
_BACKGROUND_SLIDE_M = 0.3
_CHUNK = 400
_LEAST_FRAMES = 3
_SETTLED = 3.0
_SETTLED_M = 0.0005


@dataclass(frozen=True)
class Rest:
    """A sensor sees something in one place from `start_s` to `end_s`.

    `certain`: it is known to be the target, and no mere surface that could be.
    """

    sensor: str
    start_s: float
    end_s: float
    certain: bool

    @property
    def length_s(self) -> float:
        """How long."""
        return self.end_s - self.start_s


@dataclass(frozen=True, eq=False)
class Sightings:
    """All detections of one sensor: times (F,) s, ascending, and the candidates' places.

    `frame` (N,) is the frame of each of the N candidates, in order, `number` (N,) its place among
    the frame's own; `is_background` (N,).
    """

    sensor: str
    times_s: Array
    places: Places
    frame: NDArray[np.intp]
    number: NDArray[np.intp]
    is_background: NDArray[np.bool_]

    def foreground(self, frame: int) -> NDArray[np.intp]:
        """Candidates (among N) of a frame that are no background."""
        low, high = np.searchsorted(self.frame, [frame, frame + 1])
        return np.arange(low, high)[~self.is_background[low:high]]


def sightings_of(
    sensor: str, times_s: Array, detections: Sequence[Detection], target: Target
) -> Sightings:
    """The sightings of a sensor's detections at times (F,) s, ascending."""
    candidates = [c for d in detections for c in d.candidates]
    counts = [len(d.candidates) for d in detections]
    frame = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(frame)) - np.repeat(np.cumsum(counts) - counts, counts).astype(np.intp)
    places = places_of([c.geometry for c in candidates], target)
    return Sightings(sensor, times_s, places, frame, number, background(places, frame, times_s))


def background(places: Places, frame: NDArray[np.intp], times_s: Array) -> NDArray[np.bool_]:
    """(N,) which candidates are found in the same place nearly all the time.

    The recording is cut into ten parts of equal length: a surface that is seen in six of them is
    background, since a board is held in one place for a part or two. Only where other candidates
    move: else it may be a board that was not carried on. An identified target is none either way.
    """
    result = np.zeros(len(places), dtype=bool)
    span = float(np.ptp(times_s)) if len(times_s) else 0.0
    if span == 0 or not len(places):
        return result
    part = np.minimum(((times_s - times_s[0]) / span * _SLICES).astype(int), _SLICES - 1)[frame]
    sample = np.flatnonzero(_sampled(frame, part))
    for first in range(0, len(places), _CHUNK):
        own = np.arange(first, min(first + _CHUNK, len(places)))
        same = places.same(own, sample, STILL_M, _BACKGROUND_SLIDE_M)
        seen = np.stack([same[:, part[sample] == s].any(axis=1) for s in range(_SLICES)])
        result[own] = seen.sum(axis=0) >= _LEAST_SLICES
    result &= ~places.is_pose
    moving = np.unique(frame[~result]).size
    return result if moving >= _LEAST_FRAMES else np.zeros(len(places), dtype=bool)


def _sampled(frame: NDArray[np.intp], part: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(N,) which candidates lie in the few frames of each part that stand for it."""
    chosen: NDArray[np.bool_] = np.zeros(len(frame), dtype=bool)
    for s in np.unique(part):
        frames = np.unique(frame[part == s])
        step = max(1, len(frames) // _SLICE_FRAMES)
        chosen |= np.isin(frame, frames[::step])
    return chosen


@dataclass(eq=False)
class _Track:
    """Candidates (among N) of different frames, all in the place of the first."""

    candidates: list[int]
    last_s: float


def rests(sightings: Sightings, hold_s: float) -> list[Rest]:
    """Where a candidate stays within noise and tremor of where it was first seen for `hold_s`.

    Frames that miss it are bridged for a while: detectors flicker.
    """
    times_s, places = sightings.times_s, sightings.places
    period = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    patience = max(2.5 * period, 0.6 * hold_s)
    open_tracks: list[_Track] = []
    done: list[_Track] = []
    for f, now in enumerate(times_s):
        done += [t for t in open_tracks if now - t.last_s > patience]
        open_tracks = [t for t in open_tracks if now - t.last_s <= patience]
        own = sightings.foreground(f)
        if not len(own):
            continue
        anchors = np.array([t.candidates[0] for t in open_tracks], dtype=np.intp)
        same = places.same(own, anchors, STILL_M)
        for i in np.flatnonzero(same.any(axis=0)):
            open_tracks[i].candidates.append(int(own[np.argmax(same[:, i])]))
            open_tracks[i].last_s = float(now)
        open_tracks += [_Track([int(c)], float(now)) for c in own[~same.any(axis=1)]]
    least = _LEAST_FRAMES if 2 * period < hold_s else 2
    found = []
    for track in done + open_tracks:
        still = _settled(places, np.array(track.candidates, dtype=np.intp))
        start, end = times_s[sightings.frame[still[[0, -1]]]]
        if end - start >= 0.9 * hold_s and len(still) >= least:
            certain = bool(places.is_pose[still[0]])
            found.append(Rest(sightings.sensor, float(start), float(end), certain))
    return sorted(found, key=lambda r: (r.start_s, r.end_s))


def _settled(places: Places, track: NDArray[np.intp]) -> NDArray[np.intp]:
    """A track without its ends where they are farther off than noise and tremor make the rest.

    Hands set a board down, and take it up, slowly: the first and last centimetre look still.
    """
    middle = len(track) // 2
    apart = places.apart(track, track[middle : middle + 1])[:, 0]
    others = np.delete(apart, middle)
    spread = float(np.median(others)) if len(others) else 0.0
    still = np.flatnonzero(apart <= max(_SETTLED * spread, _SETTLED_M))
    return track[still[0] : still[-1] + 1]
