from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigcal.printing.regions import visible_regions
from rigcal.targets import Patch


def square(x: float, y: float, size: float = 1.0) -> np.ndarray:
    return np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]], dtype=float)


def area(rings: list[np.ndarray]) -> float:
    """Signed: holes run clockwise and count negative."""
    total = 0.0
    for ring in rings:
        x, y = ring.T
        total += float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2
    return total


def test_cells_that_share_an_edge_become_one_region() -> None:
    third = 1 / 3
    cells = [Patch(square(i * third, 0, third), 0.0) for i in range(3)]
    ((grey, rings),) = visible_regions(cells)
    assert grey == 0.0
    assert len(rings) == 1
    assert area(rings) == pytest.approx(third)


def test_white_on_black_is_a_hole() -> None:
    ((_, rings),) = visible_regions([Patch(square(0, 0, 3), 0.0), Patch(square(1, 1), 1.0)])
    assert len(rings) == 2
    assert area(rings) == pytest.approx(8)


def test_what_is_white_at_the_end_is_paper() -> None:
    assert visible_regions([Patch(square(0, 0), 0.0), Patch(square(0, 0), 1.0)]) == []
    assert visible_regions([]) == []


@given(
    st.lists(
        st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(1, 4),
                  st.sampled_from([0.0, 0.5, 1.0])),
        max_size=12,
    )
)  # fmt: skip
def test_regions_are_what_painting_in_order_leaves(
    squares: list[tuple[int, int, int, float]],
) -> None:
    canvas = np.ones((10, 10))
    for x, y, size, grey in squares:
        canvas[y : y + size, x : x + size] = grey
    regions = visible_regions([Patch(square(x, y, s), grey) for x, y, s, grey in squares])
    for grey in (0.0, 0.5):
        expected = np.sum(canvas == grey)
        assert sum(area(rings) for g, rings in regions if g == grey) == pytest.approx(expected)
    assert all(grey < 1 for grey, _ in regions)
