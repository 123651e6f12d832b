"""Exact nests, outlines and gaps against scipy, shapely and brute force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rasterio
import rasterio.features
import scipy.ndimage
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from shapely.validation import explain_validity

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import GridGeometry
from swathe.nest import Nests, exact_nests, nest_graph, outlines
from swathe.rank import rank_metric
from worlds import mask

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def disk(radius: float) -> NDArray[np.bool_]:
    reach = math.floor(radius)
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside: NDArray[np.bool_] = np.hypot(row, column) <= radius
    return inside


ELEMENTS = {
    "cell": np.ones((1, 1), dtype=np.bool_),
    "von_neumann1": scipy.ndimage.generate_binary_structure(2, 1),
    "moore1": np.ones((3, 3), dtype=np.bool_),
    "disk:2": disk(2),
    "disk:2.5": disk(2.5),
    "disk:0": disk(0),
}
CONNECTIVITY = {"edge": 1, "corner": 2}

noise = st.builds(
    lambda seed, rows, columns, share: np.random.default_rng(seed).random((rows, columns)) < share,
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 24),
    columns=st.integers(1, 150),
    share=st.floats(0.3, 1.0),
)


def ranks_of(suitable: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.where(suitable, 8, 5).astype(np.uint8)


def opened(suitable: NDArray[np.bool_], element: NDArray[np.bool_], *, beyond: bool) -> NDArray[np.bool_]:
    """Return scipy's opening, with cells beyond the map suitable or not."""
    cores = scipy.ndimage.binary_erosion(suitable, element, border_value=int(beyond))
    dilated: NDArray[np.bool_] = scipy.ndimage.binary_dilation(cores, element)
    return dilated & suitable


def in_raster_order(labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """Renumber labels by their first cell, row by row from the north-west."""
    numbers, first = np.unique(labels[labels > 0], return_index=True)
    order = {int(numbers[place]): new for new, place in enumerate(np.argsort(first), start=1)}
    renumbered: NDArray[np.int64] = np.vectorize(lambda label: order.get(int(label), 0), otypes=[np.int64])(labels)
    return renumbered


@pytest.mark.parametrize("contact", CONNECTIVITY)
@pytest.mark.parametrize("vicinity", ELEMENTS)
@given(suitable=noise, beyond=st.booleans())
def test_nests_are_scipys_opening_and_labels(
    vicinity: str, contact: Any, suitable: NDArray[np.bool_], beyond: bool
) -> None:
    found = exact_nests(
        ranks_of(suitable), vicinity=vicinity, contact=contact, border="suitable" if beyond else "unsuitable"
    )
    ground = opened(suitable, ELEMENTS[vicinity], beyond=beyond)
    structure = scipy.ndimage.generate_binary_structure(2, CONNECTIVITY[contact])
    labels, count = scipy.ndimage.label(ground, structure)
    assert found.count == count
    assert np.array_equal(found.labels, in_raster_order(labels))
    assert np.array_equal(found.sizes, np.bincount(found.labels.ravel(), minlength=count + 1)[1:])


@given(suitable=noise)
def test_nests_overlap_where_the_vicinities_of_cores_share_a_cell(suitable: NDArray[np.bool_]) -> None:
    found = exact_nests(ranks_of(suitable), contact="overlap")
    cores = scipy.ndimage.binary_erosion(suitable, ELEMENTS["moore1"])
    # 3 x 3 cells share one exactly when their cores are at most two cells apart.
    groups, count = scipy.ndimage.label(scipy.ndimage.binary_dilation(cores, np.ones((3, 3))), np.ones((3, 3)))
    pairs = [np.argwhere(cores & (groups == group)) for group in range(1, count + 1)]
    expected = 0
    for cells in pairs:
        near = np.abs(cells[:, None, :] - cells[None, :, :]).max(axis=2) <= 2
        expected += scipy.sparse.csgraph.connected_components(near)[0]
    assert found.count == expected
    for row, column in np.argwhere(cores):
        assert len(np.unique(found.labels[row - 1 : row + 2, column - 1 : column + 2])) == 1


@pytest.mark.parametrize("name", ["ebergotzen/ebergotzen_dem_25m.tif", "spearfish/spearfish_elevation_dem_30m.tif"])
@pytest.mark.parametrize("contact", CONNECTIVITY)
def test_nests_of_real_ground_are_scipys(swathe_data: Path, name: str, contact: Any) -> None:
    with rasterio.open(swathe_data / name) as dataset:
        elevation_m = dataset.read(1, masked=True).astype(np.float32).filled(np.nan)
        cell_size_m = float(dataset.transform.a)
    rank = rank_metric(elevation_m, None, cell_size_m, "tractor").rank
    found = exact_nests(rank, contact=contact)
    structure = scipy.ndimage.generate_binary_structure(2, CONNECTIVITY[contact])
    labels, count = scipy.ndimage.label(opened(rank >= 6, ELEMENTS["moore1"], beyond=False), structure)
    assert count > 10
    assert np.array_equal(found.labels, in_raster_order(labels))


def test_narrow_ground_is_no_nest_and_a_corner_joins_only_by_choice() -> None:
    suitable = mask(
        [
            "###....",
            "###....",
            "####...",
            "...###.",
            "...###.",
            "...###.",
        ]
    )
    edge, corner = (exact_nests(ranks_of(suitable), contact=contact) for contact in ("edge", "corner"))
    assert edge.sizes.tolist() == [9, 9]
    assert edge.labels[2].tolist() == [1, 1, 1, 0, 0, 0, 0]
    assert corner.sizes.tolist() == [18]


@given(suitable=noise, rank_min=st.integers(2, 10), seed=st.integers(0, 1000))
def test_the_lowest_rank_decides_what_is_suitable(suitable: NDArray[np.bool_], rank_min: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    high, low = draw.integers(rank_min, 11, suitable.shape), draw.integers(0, rank_min, suitable.shape)
    found = exact_nests(np.where(suitable, high, low), rank_min=rank_min)
    assert np.array_equal(found.labels, exact_nests(ranks_of(suitable)).labels)


GEOMETRY = GridGeometry(24, 60, 2.5, 1000.0, 9000.0)


def transform_of(geometry: GridGeometry) -> Affine:
    size = geometry.cell_size_m
    return Affine(size, 0, geometry.west_m, 0, -size, geometry.north_m)


@pytest.mark.parametrize("contact", CONNECTIVITY)
@given(
    suitable=arrays.arrays(np.bool_, (24, 60), elements=st.sampled_from([True, True, False]), fill=st.nothing())
    | st.builds(
        lambda seed, share: np.random.default_rng(seed).random((24, 60)) < share, st.integers(0), st.floats(0, 1)
    )
)
def test_outlines_are_valid_polygons_that_give_the_cells_back(contact: Any, suitable: NDArray[np.bool_]) -> None:
    nests = exact_nests(ranks_of(suitable), vicinity="cell", contact=contact)
    found = outlines(nests, GEOMETRY)
    areas = np.zeros(nests.count + 1)
    shapes = []
    for outline in found:
        polygon = shapely.Polygon(outline.exterior, outline.holes)
        assert polygon.is_valid, explain_validity(polygon)
        assert polygon.exterior.is_ccw
        assert not any(hole.is_ccw for hole in polygon.interiors)
        areas[outline.nest] += polygon.area
        shapes.append((polygon, outline.nest))
    assert np.allclose(areas[1:], nests.sizes * GEOMETRY.cell_size_m**2)
    back = np.zeros(GEOMETRY.shape)
    if shapes:
        back = rasterio.features.rasterize(shapes, GEOMETRY.shape, transform=transform_of(GEOMETRY), dtype="uint32")
    assert np.array_equal(back, nests.labels)
    assert [outline.nest for outline in found] == sorted(outline.nest for outline in found)


@pytest.mark.parametrize(
    ("rows", "holes"),
    [
        (["####", "#.##", "##.#", "####"], [2]),
        (["###", "#.#", "##."], [1]),
        (["#####", "#...#", "#.#.#", "#...#", "#####"], [0, 1]),
        (["#####", "##.##", "#.#.#", "##.##", "#####"], [0, 1]),
    ],
)
def test_holes_that_touch_at_corners_are_holes_of_their_own(rows: list[str], holes: list[int]) -> None:
    suitable = mask(rows)
    geometry = GridGeometry(suitable.shape[0], suitable.shape[1], 1.0)
    found = outlines(exact_nests(ranks_of(suitable), vicinity="cell"), geometry)
    assert sorted(len(outline.holes) for outline in found) == holes
    assert all(shapely.Polygon(outline.exterior, outline.holes).is_valid for outline in found)


def test_small_nests_can_be_left_out() -> None:
    suitable = mask(["##.#", "##..", "...#", "...#"])
    nests = exact_nests(ranks_of(suitable), vicinity="cell")
    geometry = GridGeometry(4, 4, 1.0)
    assert [outline.nest for outline in outlines(nests, geometry)] == [1, 2, 3]
    assert [outline.nest for outline in outlines(nests, geometry, least_cells=2)] == [1, 3]
    assert outlines(nests, geometry, least_cells=5) == []


def nearest_pair_m(nests: Nests, a: int, b: int, cell_size_m: float) -> float:
    one, other = np.argwhere(nests.labels == a), np.argwhere(nests.labels == b)
    return float(np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min() * cell_size_m)


@given(
    st.builds(
        lambda seed, share: np.random.default_rng(seed).random((24, 60)) < share, st.integers(0), st.floats(0, 0.05)
    )
)
def test_gaps_are_the_nearest_pairs_within_what_growing_over_neighbours_can_miss(
    seeds: NDArray[np.bool_],
) -> None:
    suitable = scipy.ndimage.binary_dilation(seeds, np.ones((3, 3)))
    nests = exact_nests(ranks_of(suitable))
    gaps = nest_graph(nests, GEOMETRY)
    assert [(gap.from_nest, gap.to_nest) for gap in gaps] == sorted({(gap.from_nest, gap.to_nest) for gap in gaps})
    for gap in gaps:
        assert gap.from_nest < gap.to_nest
        assert nests.labels[gap.from_cell] == gap.from_nest
        assert nests.labels[gap.to_cell] == gap.to_nest
        assert gap.distance_m == pytest.approx(math.dist(gap.from_cell, gap.to_cell) * GEOMETRY.cell_size_m)
        assert gap.distance_m >= nearest_pair_m(nests, gap.from_nest, gap.to_nest, GEOMETRY.cell_size_m) - 1e-9
    if nests.count > 1:
        # Each nest's nearest neighbour of all is in the graph, and no farther than diagonal steps can bend it.
        for nest in range(1, nests.count + 1):
            others = [other for other in range(1, nests.count + 1) if other != nest]
            nearest_m = min(nearest_pair_m(nests, nest, other, GEOMETRY.cell_size_m) for other in others)
            mine = [gap.distance_m for gap in gaps if nest in (gap.from_nest, gap.to_nest)]
            assert min(mine) <= 1.1 * nearest_m + 1e-9


def test_the_graph_of_nests_is_connected() -> None:
    draw = np.random.default_rng(5)
    nests = exact_nests(ranks_of(draw.random(GEOMETRY.shape) < 0.75))
    gaps = nest_graph(nests, GEOMETRY)
    assert nests.count > 3
    graph = np.zeros((nests.count, nests.count))
    for gap in gaps:
        graph[gap.from_nest - 1, gap.to_nest - 1] = 1
    assert scipy.sparse.csgraph.connected_components(graph, directed=False)[0] == 1


def test_one_nest_has_no_gap_and_no_nest_has_no_outline() -> None:
    one = exact_nests(ranks_of(np.ones(GEOMETRY.shape, dtype=np.bool_)))
    assert (one.count, one.sizes.tolist(), nest_graph(one, GEOMETRY)) == (1, [24 * 60], [])
    none = exact_nests(ranks_of(np.zeros(GEOMETRY.shape, dtype=np.bool_)))
    assert (none.count, outlines(none, GEOMETRY), nest_graph(none, GEOMETRY)) == (0, [], [])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"rank_min": 1}, "rank of 1"),
        ({"rank_min": 11}, "rank of 11"),
        ({"vicinity": "moore2"}, "vicinity"),
        ({"vicinity": "disk:-1"}, "vicinity"),
        ({"vicinity": "disk:51"}, "vicinity"),
        ({"vicinity": "disk:wide"}, "vicinity"),
        ({"contact": "touch"}, "contact"),
        ({"border": "open"}, "border"),
    ],
)
def test_parameters_that_nobody_knows_are_refused(arguments: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        exact_nests(np.full((3, 3), 8), **arguments)


@pytest.mark.parametrize("bad", [11, 262, -250, 6.5, math.nan])
def test_ranks_that_are_none_are_refused(bad: float) -> None:
    rank = np.full((3, 3), 8.0)
    rank[1, 1] = bad
    with pytest.raises(InvalidParameterError, match=r"[Rr]ank"):
        exact_nests(rank)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="rank map"):
        exact_nests([8, 8, 8])
    nests = exact_nests(np.full((4, 6), 8))
    for geometry in (GridGeometry(6, 4, 1.0), GridGeometry(4, 7, 1.0)):
        with pytest.raises(ShapeMismatchError, match=r"\(4, 6\)"):
            outlines(nests, geometry)
        with pytest.raises(ShapeMismatchError, match=r"\(4, 6\)"):
            nest_graph(nests, geometry)
    with pytest.raises(InvalidParameterError, match="0 cells"):
        outlines(nests, GridGeometry(4, 6, 1.0), least_cells=0)
