"""The installed plugins, collected once and checked: an explicit, immutable, picklable object."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points, version
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from rigcal.errors import PluginError
from rigcal.plugin.hookspecs import hookimpl
from rigcal.plugin.offer import HOOKS, KINDS, OWN_NAMES, Offer, collect, in_words

if TYPE_CHECKING:
    from rigcal.exporting.exporter import Exporter
    from rigcal.importing.importer import Importer
    from rigcal.plugin.contract import SensorType
    from rigcal.recording.format import RecordingFormat
    from rigcal.recording.message import Definitions
    from rigcal.targets.target import TargetType

GROUP = DISTRIBUTION = "rigcal"
_T = TypeVar("_T")


class _Owner(NamedTuple):
    """Whose an offer is; in a message: 'radar' of acme-radar 1.2."""

    name: str
    distribution: str
    version: str

    def __str__(self) -> str:
        label = f"{self.distribution} {self.version}".strip() or "this program"
        return f"'{self.name}' of {label}"


_CORE = _Owner("built in", DISTRIBUTION, version(DISTRIBUTION))


@dataclass(frozen=True)
class Plugin:
    """A plugin that works. `offers` reads "sensor type camera, command demo"."""

    name: str
    distribution: str
    version: str
    offers: str


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that is left out, and why."""

    name: str
    distribution: str
    version: str
    error: str
    remedy: str = ""

    def __str__(self) -> str:
        owner = _Owner(self.name, self.distribution, self.version)
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"plugin {owner} is left out: {self.error}{remedy}"


@dataclass(frozen=True)
class _Installed:
    owner: _Owner
    load: Callable[[], object]


class _Builtin:
    """What core itself offers comes through the same door."""

    @hookimpl
    def rigcal_target_types(self) -> tuple[TargetType, ...]:
        from rigcal.targets import BUILTIN_TARGETS

        return BUILTIN_TARGETS

    @hookimpl
    def rigcal_recording_formats(self) -> tuple[RecordingFormat, ...]:
        from rigcal.recording.open import BUILTIN_FORMATS

        return BUILTIN_FORMATS

    @hookimpl
    def rigcal_exporters(self) -> tuple[Exporter, ...]:
        from rigcal.exporting import BUILTIN_EXPORTERS

        return BUILTIN_EXPORTERS

    @hookimpl
    def rigcal_importers(self) -> tuple[Importer, ...]:
        from rigcal.importing import BUILTIN_IMPORTERS

        return BUILTIN_IMPORTERS


class _Table(Generic[_T]):
    """Named offers of one kind; a name that two plugins offer belongs to neither.

    One of rigcal's own (`own`, and what core offers) stays rigcal's.
    """

    def __init__(self, kind: str, own: Iterable[str]) -> None:
        self.kind = kind
        self.entries: dict[str, _T] = {}
        self.owners: dict[str, list[_Owner]] = {name: [_CORE] for name in own}

    def add(self, name: str, value: _T, owner: _Owner) -> tuple[str, str] | None:
        """The complaint if the name is taken, and the remedy."""
        owners = self.owners.setdefault(name, [])
        if _CORE in owners:
            return f"{self.kind} '{name}' is rigcal's own", ""
        owners.append(owner)
        if len(owners) == 1:
            self.entries[name] = value
            return None
        self.entries.pop(name, None)
        return self.conflict(name)

    def conflict(self, name: str) -> tuple[str, str] | None:
        owners = self.owners.get(name, [])
        if len(owners) < 2:
            return None
        installed = dict.fromkeys(o.distribution for o in owners if o.distribution)
        commands = ", ".join(f"pip uninstall {distribution}" for distribution in installed)
        return (
            f"{self.kind} '{name}' is offered by {' and by '.join(map(str, owners))}",
            "uninstall all but one of them" + (f": {commands}" if commands else ""),
        )


class Registry:
    """What the installed plugins offer: sensor and target types, recording formats, exporters, ...

    `Registry(plugins)` takes modules or objects with hooks and raises PluginError if one is
    wrong. `Registry.from_entry_points()` takes what is installed; a plugin that is wrong is left
    out, listed in `broken`, and named when something is asked for that it may have offered.
    What core itself offers is always there. Threads and processes may share it.
    """

    def __init__(self, plugins: Iterable[object] = ()) -> None:
        self._collect([_given(plugin) for plugin in plugins], HOOKS)
        if self._broken:
            raise PluginError("\n".join(map(str, self._broken)))

    @classmethod
    def from_entry_points(cls, hooks: Collection[str] = HOOKS) -> Registry:
        """What is installed in entry point group `rigcal`; never raises for a bad plugin.

        `hooks` limits what plugins are asked for; one that does not mention any is not imported
        (commands alone load no numerical library, and the command line starts at once).
        """
        registry = cls.__new__(cls)
        found = sorted(entry_points(group=GROUP), key=lambda e: (e.name, _owner_of(e)))
        asked = [entry for entry in found if hooks is HOOKS or _mentions(entry, hooks)]
        registry._collect([_installed(entry) for entry in asked], hooks)
        return registry

    def _collect(self, installed: list[_Installed], hooks: Collection[str]) -> None:
        self._tables: dict[str, _Table[Any]] = {
            hook: _Table(kind, OWN_NAMES.get(hook, ())) for hook, kind in KINDS.items()
        }
        self._broken: list[BrokenPlugin] = []
        offers: list[tuple[_Owner, Offer]] = []
        for one in [_Installed(_CORE, _Builtin), *installed]:
            # A plugin may fail in any way, sys.exit included: what does not use it goes on.
            try:
                offer = collect(one.load(), hooks)
            except PluginError as error:
                self._leave_out(one.owner, str(error))
            except (Exception, SystemExit) as error:
                text = " ".join(str(error).split())
                found = f"importing it failed with {type(error).__name__}: {text}"
                self._leave_out(one.owner, found)
            else:
                self._take(one.owner, offer)
                offers.append((one.owner, offer))
        self._plugins = [Plugin(*o, in_words(self._without_clashes(offer))) for o, offer in offers]

    def _leave_out(self, owner: _Owner, error: str, remedy: str = "") -> None:
        if not remedy and owner.distribution:
            remedy = f"mend it or remove it: pip uninstall {owner.distribution}"
        self._broken.append(BrokenPlugin(*owner, error, remedy))

    def _take(self, owner: _Owner, offer: Offer) -> None:
        complaints = [
            self._tables[hook].add(item.name, item, owner)
            for hook, items in offer.items()
            for item in items
        ]
        for complaint in filter(None, complaints):
            self._leave_out(owner, *complaint)

    def _without_clashes(self, offer: Offer) -> Offer:
        """What of an offer is the plugin's alone."""
        return {
            hook: tuple(i for i in items if self._tables[hook].entries.get(i.name) is i)
            for hook, items in offer.items()
        }

    @property
    def sensor_types(self) -> Mapping[str, SensorType]:
        """By name."""
        return dict(self._tables["rigcal_sensor_types"].entries)

    @property
    def message_definitions(self) -> Definitions:
        """Text of the .msg files that sensor types bring, by ROS name."""
        return {
            name: text
            for kind in self.sensor_types.values()
            for name, text in kind.message_definitions.items()
        }

    @property
    def target_types(self) -> Mapping[str, TargetType]:
        """By name."""
        return dict(self._tables["rigcal_target_types"].entries)

    @property
    def recording_formats(self) -> Mapping[str, RecordingFormat]:
        """By name, the built-in ones first."""
        return dict(self._tables["rigcal_recording_formats"].entries)

    @property
    def exporters(self) -> Mapping[str, Exporter]:
        """By name, the built-in ones first."""
        return dict(self._tables["rigcal_exporters"].entries)

    @property
    def importers(self) -> Mapping[str, Importer]:
        """By name, the built-in ones first."""
        return dict(self._tables["rigcal_importers"].entries)

    @property
    def commands(self) -> Mapping[str, Callable[..., Any]]:
        """Functions with typer annotations, by the command's name."""
        return {c.name: c.run for c in self._tables["rigcal_commands"].entries.values()}

    def command_owner(self, name: str) -> str | None:
        """Whose a command is, as "'radar' of acme-radar 1.2"; None where no plugin offers it."""
        table = self._tables["rigcal_commands"]
        return str(table.owners[name][0]) if name in table.entries else None

    @property
    def schemas(self) -> Mapping[str, Callable[..., dict[str, Any]]]:
        """Functions (registry) -> JSON Schema, by the name of the file described."""
        return {s.name: s.make for s in self._tables["rigcal_schemas"].entries.values()}

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins that work, core's own part first."""
        return tuple(self._plugins)

    @property
    def broken(self) -> tuple[BrokenPlugin, ...]:
        """The plugins that are left out, or whose names clash with another's."""
        return tuple(self._broken)

    def sensor_type(self, name: str) -> SensorType:
        """The sensor type of that name; PluginError with what is installed and the nearest name."""
        found: SensorType = self._get("rigcal_sensor_types", name)
        return found

    def target_type(self, name: str) -> TargetType:
        """The target type of that name; PluginError with what is installed and the nearest name."""
        found: TargetType = self._get("rigcal_target_types", name)
        return found

    def exporter(self, name: str) -> Exporter:
        """The exporter of that name; PluginError with what is installed and the nearest name."""
        found: Exporter = self._get("rigcal_exporters", name)
        return found

    def _get(self, hook: str, name: str) -> Any:
        table = self._tables[hook]
        if name in table.entries:
            return table.entries[name]
        if conflict := table.conflict(name):
            raise PluginError("; ".join(conflict))
        nearest = difflib.get_close_matches(str(name), table.entries, 1)
        guess, otherwise = (f", did you mean '{nearest[0]}'?", "else ") if nearest else ("", "")
        installed = ", ".join(sorted(table.entries)) or "none"
        remedies = self._suspects(str(name)) or [f"{otherwise}install the plugin that offers it"]
        raise PluginError(
            "; ".join([f"no {table.kind} '{name}'{guess} (installed: {installed})", *remedies])
        )

    def _suspects(self, name: str) -> list[str]:
        """Broken plugins that may have offered a name: in full those that are called like it."""
        likely = [b for b in self._broken if name in f"{b.name} {b.distribution}"]
        others = [b for b in self._broken if b not in likely]
        texts = [str(broken) for broken in likely]
        if others and not likely:
            names = ", ".join(sorted({b.distribution or b.name for b in others}))
            texts.append(f"a broken plugin may have offered it: {names} (see `rigcal plugins`)")
        return texts


def _given(plugin: object) -> _Installed:
    name = getattr(plugin, "__name__", type(plugin).__name__)
    return _Installed(_Owner(str(name), "", ""), lambda: plugin)


def _installed(entry: EntryPoint) -> _Installed:
    dist = entry.dist
    owner = _Owner(entry.name, dist.name if dist else "", dist.version if dist else "")
    return _Installed(owner, entry.load)


def _mentions(entry: EntryPoint, hooks: Collection[str]) -> bool:
    """Whether a plugin may implement a hook, by the text of its module; True when in doubt."""
    try:
        # The spec of a dotted name would import its package.
        if entry.attr or "." in entry.module:
            return True
        loader = getattr(find_spec(entry.module), "loader", None)
        source = loader.get_source(entry.module) if loader else None
    except Exception:
        return True
    return source is None or any(word in source for word in (*hooks, "import *"))


def _owner_of(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else ""
