"""The rig: sensors, targets and how their data belong together, as rig.yaml says it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, create_model

from rigcal.document import Document, Problems, check_format, describe, read_document
from rigcal.errors import ConfigError, PluginError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import PoseConfig, SensorConfig
from rigcal.plugin.registry import Registry
from rigcal.targets.target import Target, TargetConfig
from rigcal.validation import nearest_of

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_FRAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_./-]*")
_C = TypeVar("_C", bound=BaseModel)
Association = Literal["still", "nearest", "same_index"]
Noise = Literal["estimated", "configured"]


@dataclass(frozen=True)
class Rig:
    """A validated rig: `root` is one of `sensors`; every sensor looks at one of `targets`.

    `association` says what makes an exposure: the target standing still for `hold_s` or longer
    ("still"), stamps within `tolerance_s` of each other ("nearest"), or equal positions in each
    sensor's stream ("same_index"). None: "still" where the recording shows the target held still
    again and again, else "nearest". `noise`: observations
    weigh by their sensors' noise as estimated from the residuals, or as configured. `base` is the
    pose of the root in a frame of the robot, its `parent`: exports hang the sensors from it.
    """

    name: str
    root: str
    targets: Mapping[str, TargetConfig]
    sensors: Mapping[str, SensorConfig]
    association: Association | None = None
    tolerance_s: float = 0.05
    hold_s: float = 1.0
    noise: Noise = "estimated"
    version: int = 1
    base: PoseConfig | None = None

    def target_of(self, sensor: str) -> str:
        """Name of the target that a sensor looks at."""
        return self.sensors[sensor].target or next(iter(self.targets))


class _RigFile(BaseModel):
    """What rig.yaml holds; the sensors and targets are validated by their types."""

    model_config = ConfigDict(extra="forbid", frozen=True, title="rigcal rig")

    version: Literal[1] = Field(description="version of this file format")
    name: str = Field(default="rig", description="what the rig is called in reports")
    root: str = Field(description="sensor that the tree of transforms hangs from")
    targets: dict[str, Any] = Field(min_length=1, description="the boards, by name")
    sensors: dict[str, Any] = Field(min_length=1, description="the sensors, by name")
    association: Association | None = Field(
        default=None,
        description="an exposure is: the target held still, stamps within tolerance_s, or equal "
        "positions in the streams; without it, what the recording shows",
    )
    tolerance_s: float = Field(
        default=0.05, gt=0, allow_inf_nan=False, description="for `nearest`, between two stamps"
    )
    hold_s: float = Field(
        default=1.0, gt=0, allow_inf_nan=False, description="for `still`, the shortest exposure"
    )
    noise: Noise = Field(
        default="estimated",
        description="sensors weigh by the noise estimated from the residuals, or as configured",
    )
    base: PoseConfig | None = Field(
        default=None,
        description="pose of the root sensor in a frame of the robot (its `parent`: base_link), "
        "for exports",
    )


def load_rig(path: Path | str, registry: Registry) -> Rig:
    """The rig in a YAML file; ConfigError with file, line and key for all that is wrong in it."""
    return _parse(_read(path), registry)


def load_targets(path: Path | str, registry: Registry) -> dict[str, Target]:
    """The targets of a rig file by name, whose sensors need not be of types that are installed.

    ConfigError with file, line and key for all that is wrong with the file and its targets.
    """
    problems = Problems(_read(path))
    problems.validate(_RigFile, problems.document.data)
    targets = _targets(problems, registry)
    problems.raise_if_any()
    return _built(targets, registry)


def parse_rig(mapping: Mapping[str, Any], registry: Registry) -> Rig:
    """The rig in a mapping laid out like rig.yaml; ConfigError for all that is wrong in it."""
    return _parse(Document("rig", dict(mapping)), registry)


def rig_schema(registry: Registry) -> dict[str, Any]:
    """JSON Schema of rig.yaml for the types in the registry."""
    members: dict[str, Any] = {
        "sensors": _union([s.config for s in registry.sensor_types.values()], SensorConfig),
        "targets": _union([t.config for t in registry.target_types.values()], TargetConfig),
    }
    fields: dict[str, Any] = {
        key: (dict.__class_getitem__((str, union)), _RigFile.model_fields[key])
        for key, union in members.items()
    }
    model = create_model("RigFile", __base__=_RigFile, **fields)
    schema = model.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def build_targets(rig: Rig, registry: Registry) -> dict[str, Target]:
    """The rig's targets by name; ConfigError for dimensions that do not make a board."""
    return _built(rig.targets, registry)


def _built(targets: Mapping[str, TargetConfig], registry: Registry) -> dict[str, Target]:
    built = {}
    for name, config in targets.items():
        try:
            built[name] = registry.target_type(config.type).build(name, config)
        except ValueError as error:
            raise ConfigError(f"targets.{name}: {error}") from error
    return built


def T_root_sensors(rig: Rig) -> dict[str, Array]:
    """`T_root_s` (4, 4) of every sensor, composed from the `pose` entries of the rig.

    ConfigError names the sensors whose poses do not connect them to the root.
    """
    root_top, T_top_root = _to_top(rig, rig.root)
    result, loose = {}, []
    for name in rig.sensors:
        top, T_top_s = _to_top(rig, name)
        if top != root_top:
            loose.append(name)
        result[name] = se3.inverse(T_top_root) @ T_top_s
    if loose:
        raise ConfigError(
            f"no pose connects {', '.join(loose)} to the root '{rig.root}': "
            f"add `pose: {{parent: {rig.root}, translation_m: [...], rpy_deg: [...]}}`"
        )
    return result


def _to_top(rig: Rig, name: str) -> tuple[str, Array]:
    """The first ancestor without a pose, and `T_top_s`."""
    T = np.eye(4)
    while (pose := rig.sensors[name].pose) is not None:
        T = pose.T_parent_sensor @ T
        name = pose.parent
    return name, T


def _read(path: Path | str) -> Document:
    document = read_document(path, "a rig")
    check_format(document, None, "a rig file, which names no format")
    return document


def _parse(document: Document, registry: Registry) -> Rig:
    problems = Problems(document)
    header = problems.validate(_RigFile, document.data)
    targets = _targets(problems, registry)
    sensors = _members(problems, "sensors", lambda kind: registry.sensor_type(kind).config)
    _check_names(problems, sensors, targets)
    _check_poses(problems, sensors)
    _check_base(problems, header)
    _check_refine(problems, sensors, registry)
    _check_bend(problems, sensors, targets, registry)
    problems.raise_if_any()
    assert header is not None  # it is None only with a problem noted
    values = {name: getattr(header, name) for name in _RigFile.model_fields}
    return Rig(**values | {"targets": targets, "sensors": sensors})


def _targets(problems: Problems, registry: Registry) -> dict[str, TargetConfig]:
    return _members(problems, "targets", lambda kind: registry.target_type(kind).config)


def _members(
    problems: Problems, section: str, config_of: Callable[[str], type[_C]]
) -> dict[str, _C]:
    """The valid entries of a section; what is wrong with the others is noted."""
    entries = problems.document.data.get(section)
    members = {}
    for name, data in entries.items() if isinstance(entries, dict) else ():
        path = (section, name)
        if not _NAME.fullmatch(str(name)):
            problems.add(path, f"name {name!r}: use letters, digits, '_', '.' and '-'")
        elif not isinstance(data, dict):
            problems.add(path, f"found {describe(data)}, expected a mapping with a `type`")
        elif "type" not in data:
            problems.add(path, "key 'type' is missing, expected the name of an installed type")
        elif not isinstance(data["type"], str):
            found = f"found {describe(data['type'])}, expected the name of an installed type"
            problems.add((*path, "type"), found)
        else:
            try:
                config = problems.validate(config_of(data["type"]), data, path)
            except PluginError as error:
                problems.add((*path, "type"), str(error))
            else:
                members.update({name: config} if config is not None else {})
    return members


def _names(problems: Problems, section: str) -> list[str]:
    """Of all entries of a section, valid or not."""
    entries = problems.document.data.get(section)
    return [str(name) for name in entries] if isinstance(entries, dict) else []


def _check_names(
    problems: Problems, sensors: Mapping[str, SensorConfig], targets: Mapping[str, TargetConfig]
) -> None:
    """References by name: the root, and the target of each sensor."""
    root, known = problems.document.data.get("root"), _names(problems, "sensors")
    if isinstance(root, str) and known and root not in known:
        problems.add(("root",), f"no sensor '{root}'{nearest_of(root, known)}")
    known = _names(problems, "targets")
    for name, sensor in sensors.items():
        path = ("sensors", name)
        if sensor.target is None and len(known) > 1:
            problems.add(path, f"add `target: NAME`, one of several ({', '.join(known)})")
        elif sensor.target is not None and sensor.target not in known:
            found = f"no target '{sensor.target}'{nearest_of(sensor.target, known)}"
            problems.add((*path, "target"), found)


def _check_poses(problems: Problems, sensors: Mapping[str, SensorConfig]) -> None:
    """Every parent is another sensor, and no chain of parents comes back to itself."""
    known = _names(problems, "sensors")
    parents = {name: s.pose.parent for name, s in sensors.items() if s.pose is not None}
    for name, parent in parents.items():
        path = ("sensors", name, "pose", "parent")
        if parent not in known:
            problems.add(path, f"no sensor '{parent}'{nearest_of(parent, known)}")
        chain = [name]
        while chain[-1] in parents and parents[chain[-1]] not in chain:
            chain.append(parents[chain[-1]])
        if parents.get(chain[-1]) == name == min(chain):
            problems.add(path, f"the poses go in a circle: {' -> '.join([*chain, name])}")


def _check_base(problems: Problems, header: _RigFile | None) -> None:
    """The robot's frame has a name that other programs take, and is no sensor."""
    if header is None or header.base is None:
        return
    frame, path = header.base.parent, ("base", "parent")
    if frame in header.sensors:
        found = f"'{frame}' is a sensor, expected the name of a frame of the robot (base_link)"
        problems.add(path, found)
    elif not _FRAME.fullmatch(frame):
        problems.add(path, f"name {frame!r}: use letters, digits, '_', '.', '-' and '/'")


def _check_refine(
    problems: Problems, sensors: Mapping[str, SensorConfig], registry: Registry
) -> None:
    """What a sensor is to refine is offered by its type."""
    for name, sensor in sensors.items():
        offered = list(registry.sensor_type(sensor.type).refinable)
        for i, asked in enumerate(sensor.refine):
            path = ("sensors", name, "refine", i)
            if not offered:
                problems.add(path, f"a sensor of type {sensor.type} has nothing to refine")
            elif asked not in offered:
                found = f"{sensor.type} does not offer '{asked}'{nearest_of(asked, offered)}"
                problems.add(path, found)
            elif asked in sensor.refine[:i]:
                problems.add(path, f"'{asked}' stands twice")


def _check_bend(
    problems: Problems,
    sensors: Mapping[str, SensorConfig],
    targets: Mapping[str, TargetConfig],
    registry: Registry,
) -> None:
    """What a target is to refine stands once; all that look at one that bends can tell."""
    for name, target in targets.items():
        path = ("targets", name, "refine")
        for i, asked in enumerate(target.refine):
            if asked in target.refine[:i]:
                problems.add((*path, i), f"'{asked}' stands twice")
        looking = [s for s, c in sensors.items() if c.target == name or len(targets) == 1]
        blind = [s for s in looking if not registry.sensor_type(sensors[s].type).bends]
        if "bend" in target.refine and blind:
            types = ", ".join(dict.fromkeys(sensors[s].type for s in blind))
            found = f"{', '.join(blind)} cannot tell a bent board from a flat one (type {types})"
            problems.add(path, f"{found}: take `bend` out, or give it a target of its own")


def _union(configs: list[type[_C]], base: type[_C]) -> Any:
    if not configs:
        return base
    union = reduce(or_, configs)
    return Annotated[union, Field(discriminator="type")] if len(configs) > 1 else union
