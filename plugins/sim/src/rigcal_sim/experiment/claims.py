"""Which claims of MSG-Cal's study (Owens' dissertation, section 4.4.2) hold, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal_sim.experiment.run import Row, select

_FORMULATIONS = ("msgcal", "joint")
# Two starts are the same when their errors differ by less than this share.
_SAME = 0.01
# Without the filter the error is significantly larger from this factor on.
_LARGER = 1.5


def claims(rows: Sequence[Row]) -> list[str]:
    """One line per claim, formulation, source and share of outliers."""
    groups = list(dict.fromkeys((r.source, r.outliers) for r in rows))
    lines = []
    for source, outliers in groups:
        own = [r for r in rows if (r.source, r.outliers) == (source, outliers)]
        lines.append(
            f"{source}, {100 * outliers:.0f} % outliers, {len({r.seed for r in own})} runs"
        )
        has_truth = bool(np.isfinite(select(own, "mean_translation_m")).any())
        for formulation in _FORMULATIONS:
            solved, failed = _with_result(own, formulation)
            if failed:
                lines.append(
                    f"  {formulation}: runs that gave no result and do not count: {failed}"
                )
            scatters = [_graph_error] if not has_truth else [_variance, _graph_error]
            if len({r.seed for r in solved}) > 1:
                lines += [claim(solved, formulation) for claim in scatters]
            else:
                lines.append(
                    f"  {formulation}: scatter takes two runs or more (--runs, --raw-runs): it "
                    "cannot be told whether the variances fall"
                )
            lines.append(_initial(solved, formulation, has_truth=has_truth))
            if outliers or not has_truth:  # else there is nothing to filter
                lines.append(_filter(solved, formulation, has_truth=has_truth))
    for source in dict.fromkeys(source for source, _ in groups):
        lines += _against_clean([r for r in rows if r.source == source])
    return lines


def _with_result(rows: Sequence[Row], formulation: str) -> tuple[list[Row], int]:
    """The rows of runs in which a formulation solved the filtered data, and how many did not."""
    where = {"formulation": formulation, "filtered": True, "initial": "tree", "problem": ""}
    seeds = set(select(rows, "seed", **where))
    solved = [r for r in rows if r.seed in seeds]
    return solved, len({r.seed for r in rows} - seeds)


def _values(rows: Sequence[Row], column: str, **where: Any) -> Array:
    values = np.array(select(rows, column, **where))
    result: Array = values[np.isfinite(values)]
    return result


def _of(rows: Sequence[Row], formulation: str, column: str, **where: Any) -> Array:
    where = {"filtered": True, "initial": "tree", **where}
    return _values(rows, column, formulation=formulation, **where)


def _verdict(claim: str, formulation: str, holds: bool, numbers: str) -> str:
    return f"  ({claim}) {formulation}: {'holds' if holds else 'DOES NOT HOLD'}: {numbers}"


def _variance(rows: Sequence[Row], formulation: str) -> str:
    pairs, graph = (1e3 * _of(rows, f, "mean_translation_m") for f in ("pairwise", formulation))
    pairs_deg, graph_deg = (
        np.degrees(_of(rows, f, "mean_axis_rad")) for f in ("pairwise", formulation)
    )
    holds = _std(graph) < _std(pairs) and _std(graph_deg) < _std(pairs_deg)
    return _verdict(
        "i", formulation, holds,
        f"pairwise {_spread(pairs)} mm and {_spread(pairs_deg, 4)} deg, "
        f"graph {_spread(graph)} mm and {_spread(graph_deg, 4)} deg",
    )  # fmt: skip


def _graph_error(rows: Sequence[Row], formulation: str) -> str:
    pairs, graph = (1e6 * _of(rows, f, "graph_error_m2") for f in ("pairwise", formulation))
    holds = _mean(graph) < _mean(pairs) and _std(graph) < _std(pairs)
    numbers = f"pairwise {_spread(pairs, 1)} mm^2, graph {_spread(graph, 1)} mm^2"
    return _verdict("ii", formulation, holds, numbers)


def _initial(rows: Sequence[Row], formulation: str, *, has_truth: bool) -> str:
    column = "mean_translation_m" if has_truth else "graph_error_m2"
    where = {"formulation": formulation, "filtered": True}
    tree, identity = (
        np.array(select(rows, column, initial=i, **where)) for i in ("tree", "identity")
    )
    failed = np.count_nonzero(~np.isfinite(identity))
    if failed == len(identity):
        return _verdict("iii", formulation, False, f"from the identity none of {failed} converged")
    share = float(np.nanmax(np.abs(identity / tree - 1)))
    numbers = f"errors differ by {100 * share:.2g} % at most"
    if failed:
        numbers += f"; {failed} of {len(identity)} did not converge from the identity, and said so"
    return _verdict("iii", formulation, not failed and share < _SAME, numbers)


def _filter(rows: Sequence[Row], formulation: str, *, has_truth: bool) -> str:
    column, factor, unit = (
        ("mean_translation_m", 1e3, "mm") if has_truth else ("graph_error_m2", 1e6, "mm^2")
    )
    kept, everything = (factor * _of(rows, formulation, column, filtered=f) for f in (True, False))
    numbers = f"filtered {_spread(kept)} {unit}, unfiltered "
    failed = len({r.seed for r in rows}) - len(everything)
    if not len(everything):
        return _verdict("iv", formulation, True, f"{numbers}none of {failed} converged")
    ratio = _mean(everything) / _mean(kept)
    numbers += f"{_spread(everything)} {unit} ({ratio:.3g} times)"
    if failed:
        numbers += f"; {failed} did not converge without the filter"
    return _verdict("iv", formulation, ratio > _LARGER, numbers)


def _against_clean(rows: Sequence[Row]) -> list[str]:
    """The filtered and unfiltered error with outliers, over the filtered one without."""
    lines: list[str] = []
    if not np.isfinite(select(rows, "mean_translation_m", outliers=0.0)).any():
        return lines
    for share in sorted({r.outliers for r in rows if r.outliers}):
        for formulation in _FORMULATIONS:
            clean = _mean(_of(rows, formulation, "mean_translation_m", outliers=0.0))
            kept, everything = (
                _mean(_of(rows, formulation, "mean_translation_m", outliers=share, filtered=f))
                for f in (True, False)
            )
            unfiltered = f"{everything / clean:.3g} times" if everything > 0 else "none converged"
            lines.append(
                f"{rows[0].source}, {100 * share:.0f} % outliers over none, {formulation}: "
                f"filtered {kept / clean:.3g} times, unfiltered {unfiltered}"
            )
    return lines


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _std(values: Array) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else float("nan")


def _spread(values: Array, digits: int = 3) -> str:
    if len(values) < 2:
        return f"{_mean(values):.{digits}f}"
    return f"{_mean(values):.{digits}f} +- {_std(values):.{digits}f}"
