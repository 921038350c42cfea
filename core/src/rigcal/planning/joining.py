"""What joins sensors that nothing links yet, which comes before what makes them better known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable

from rigcal.planning.candidates import BoardPose

# Pairs of sensors that an exposure does not fix at once are linked by so many that they share.
_NEEDED = 5


class Joining:
    """Sensors that are `joined`, and groups that are not."""

    def __init__(self, joined: Iterable[str], groups: Iterable[Collection[str]]) -> None:
        self._joined = set(joined)
        self._loose = [frozenset(group) for group in groups]
        self._shared: Counter[tuple[str, str]] = Counter()

    def is_wanted(self, pose: BoardPose) -> bool:
        """Whether a pose brings a loose group nearer to being joined.

        Exposures must be shared with one and the same partner: a pair that has begun is pursued.
        """
        for group in self._loose:
            counts = {link: n for link, n in self._shared.items() if link[0] in group}
            leading = {link for link, n in counts.items() if n == max(counts.values())}
            links = self._links(group, pose)
            if links and (not leading or links & leading):
                return True
        return False

    def add(self, pose: BoardPose, firm: Collection[str]) -> None:
        """A pose is recorded; it alone fixes the sensors named in `firm` to each other."""
        for group in self._loose:
            links = self._links(group, pose)
            self._shared.update(links)
            if any({s, p} <= {*firm} or self._shared[s, p] >= _NEEDED for s, p in links):
                self._joined |= group
        self._loose = [group for group in self._loose if not group <= self._joined]

    def _links(self, group: frozenset[str], pose: BoardPose) -> set[tuple[str, str]]:
        return {
            (s, p) for s in pose.seen_by for p in pose.seen_by if s in group and p in self._joined
        }
