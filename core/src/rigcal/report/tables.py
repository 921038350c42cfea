"""The report's tables: plain rows of text, made from a calibration."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.calibration import Calibration, Rejection
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation

_NOTHING = "\N{EN DASH}"
_UNITS = {"m": (1000.0, "mm"), "rad": (float(np.degrees(1.0)), "deg")}


@dataclass(frozen=True)
class TransformRow:
    """One sensor in its parent: mm and deg; sigmas along the sensor's own axes."""

    sensor: str
    parent: str
    translation_mm: tuple[str, ...]
    rpy_deg: tuple[str, ...]
    sigma_mm: tuple[str, ...]
    sigma_deg: tuple[str, ...]


@dataclass(frozen=True)
class UncertaintyRow:
    """Standard deviations of one sensor along and about its own axes, and the verdict on it.

    By the noise as estimated from the residuals, and as configured.
    """

    sensor: str
    mm: tuple[str, ...]
    mm_configured: tuple[str, ...]
    deg: tuple[str, ...]
    deg_configured: tuple[str, ...]
    verdict: str

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as texts."""
        numbers = (self.mm, self.mm_configured, self.deg, self.deg_configured)
        return (self.sensor, *(" ".join(each) for each in numbers), self.verdict)


@dataclass(frozen=True)
class ResidualRow:
    """What one sensor contributed, and how well it fits."""

    sensor: str
    seen: str
    used: str
    rms: str
    count: str
    noise_scale: str


@dataclass(frozen=True)
class ExposureRow:
    """What became of one exposure, per sensor: (state, words), state a CSS class."""

    exposure: str
    cells: tuple[tuple[str, str], ...]


def natural_order(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that puts pose2 before pose10."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts)


def headline(calibration: Calibration) -> str:
    """The result in one sentence, after the verdict if that is that it is none."""
    sensors, verdict = calibration.sensors, calibration.verdict
    exposures = len(calibration.target_poses)
    text = f"{len(sensors)} sensors placed in the frame of {calibration.root}"
    text += f" from {exposures} exposure{'s' * (exposures != 1)}" if exposures else ""
    sigmas = {
        name: _worst_sigmas(sensor.covariance)
        for name, sensor in sensors.items()
        if sensor.covariance is not None
    }
    if sigmas:
        name = max(sigmas, key=lambda n: sigmas[n][0])
        millimetres, degrees = sigmas[name]
        text += (
            f"; least certain is {name}, to {millimetres:.3g} mm and {degrees:.2g} deg (1 sigma)"
        )
    text += "."
    return (
        f"{verdict.summary} Accepted all the same: {text}" if verdict and verdict.withheld else text
    )


def transform_rows(calibration: Calibration) -> list[TransformRow]:
    """One row per sensor but the root, in the order of the calibration."""
    rows = []
    for name, result in calibration.sensors.items():
        if name == calibration.root:
            continue
        T = result.T_parent_sensor
        sigma_deg, sigma_mm = _sigmas(result.covariance)
        rows.append(
            TransformRow(
                sensor=name,
                parent=result.parent,
                translation_mm=_numbers(T[:3, 3] * 1e3, "{:z.2f}"),
                rpy_deg=_numbers(np.degrees(se3.rpy_from_rotation(T[:3, :3])), "{:z.4f}"),
                sigma_mm=_spreads(sigma_mm),
                sigma_deg=_spreads(sigma_deg),
            )
        )
    return rows


def uncertainty_rows(calibration: Calibration) -> list[UncertaintyRow]:
    """One row per sensor whose standard deviations are known."""
    rows = []
    for name, result in calibration.sensors.items():
        if not result.sigmas and result.covariance is None:
            continue
        estimated, configured = (
            _in_deg_and_mm(result.sigmas[how])
            if how in result.sigmas
            else _sigmas(result.covariance)
            for how in ("estimated", "configured")
        )
        numbers = [_spreads(values) for values in (*estimated, *configured)]
        deg, mm, deg_configured, mm_configured = numbers
        rows.append(
            UncertaintyRow(name, mm, mm_configured, deg, deg_configured, _state(calibration, name))
        )
    return rows


def _state(calibration: Calibration, sensor: str) -> str:
    verdict = calibration.verdict
    if verdict is None or sensor not in verdict.sensors:
        return _NOTHING
    if sensor in verdict.withheld:
        return "not determined"
    return "weak" if sensor in verdict.weak else "determined"


def residual_rows(calibration: Calibration) -> list[ResidualRow]:
    """One row per sensor."""
    rows = []
    for name, result in calibration.sensors.items():
        residual, scale = result.residual, result.noise_scale
        factor, unit = _UNITS.get(residual.unit, (1.0, residual.unit)) if residual else (1.0, "")
        rows.append(
            ResidualRow(
                sensor=name,
                seen=_optional(result.observations),
                used=_optional(result.inliers),
                rms=f"{residual.rms * factor:.3g} {unit}" if residual else _NOTHING,
                count=_optional(residual.count if residual else None),
                noise_scale=_NOTHING if scale is None else f"{scale:.2f}",
            )
        )
    return rows


def refined_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """Owner, name, value, sigma and first value of everything that was refined."""
    owners = {s: result.refined for s, result in calibration.sensors.items()}
    return [
        (owner, name, *(_with_unit(v, n.unit) for v in (n.value, n.sigma, n.start)))
        for owner, numbers in (*owners.items(), *calibration.refined_targets.items())
        for name, n in numbers.items()
    ]


def _with_unit(value: float, unit: str) -> str:
    factor, unit = _UNITS.get(unit, (1.0, unit))
    return f"{value * factor:.6g} {unit}".strip()


def exposure_rows(
    calibration: Calibration, observations: Iterable[Observation]
) -> list[ExposureRow]:
    """One row per exposure, one cell per sensor: used, rejected, not found, or no data."""
    rejected = {(r.exposure, r.sensor): r.reason for r in calibration.rejected}
    cells: dict[str, dict[str, tuple[str, str]]] = {}
    for o in observations:
        reason = rejected.get((o.exposure, o.sensor), "")
        if not o.candidates:
            cell = ("none", o.reason or reason)
        elif reason or o.exposure not in calibration.target_poses:
            cell = ("rejected", reason or "the exposure is not part of the solution")
        else:
            cell = ("used", "")
        cells.setdefault(o.exposure, {})[o.sensor] = cell
    return [
        ExposureRow(
            exposure,
            tuple(cells[exposure].get(s, ("absent", "no data")) for s in calibration.sensors),
        )
        for exposure in sorted(cells, key=natural_order)
    ]


def rejections(calibration: Calibration, observations: Iterable[Observation]) -> list[Rejection]:
    """What the result does not rest on, found or not, by sensor and exposure."""
    rows = {(r.sensor, r.exposure): r for r in calibration.rejected}
    for o in observations:
        if not o.candidates:
            rows.setdefault(
                (o.sensor, o.exposure), Rejection(o.sensor, o.exposure, o.origin, o.reason)
            )
    return sorted(rows.values(), key=lambda r: (r.sensor, natural_order(r.exposure)))


def provenance_rows(provenance: Mapping[str, object], prefix: str = "") -> list[tuple[str, str]]:
    """Nested entries as dotted keys with their values as text."""
    rows: list[tuple[str, str]] = []
    for key, value in provenance.items():
        if isinstance(value, Mapping):
            rows += provenance_rows(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", str(value)))
    return rows


def _worst_sigmas(covariance: Array) -> tuple[float, float]:
    """Largest standard deviations along any direction, mm and deg."""
    rotation, translation = covariance[:3, :3], covariance[3:, 3:]
    return (
        float(1e3 * np.sqrt(np.linalg.eigvalsh(translation)[-1])),
        float(np.degrees(np.sqrt(np.linalg.eigvalsh(rotation)[-1]))),
    )


def _sigmas(covariance: Array | None) -> tuple[Array, Array]:
    """Per axis, deg (3,) and mm (3,); NaN where there is no covariance."""
    known = np.full(6, np.nan) if covariance is None else np.sqrt(np.diag(covariance))
    return _in_deg_and_mm(known)


def _in_deg_and_mm(sigma: Array) -> tuple[Array, Array]:
    """Standard deviations (6,) -> deg (3,), mm (3,)."""
    return np.degrees(sigma[:3]), sigma[3:] * 1e3


def _numbers(values: Array, form: str) -> tuple[str, ...]:
    return tuple(_NOTHING if np.isnan(v) else form.format(v) for v in values)


def _spreads(values: Array) -> tuple[str, ...]:
    return tuple(_NOTHING if np.isnan(v) else spread(float(v)) for v in values)


def spread(value: float) -> str:
    """A standard deviation to two digits, one of a hundred and more whole."""
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def _optional(value: int | None) -> str:
    return _NOTHING if value is None else str(value)
