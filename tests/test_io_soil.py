"""Laying soil maps over the terrain: polygons and rasters, legends, overlaps, and what is not understood."""

from __future__ import annotations

import json
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio.raw
import pyproj
import pytest
import shapely
from affine import Affine

from raster_files import UTM16, write
from swathe.errors import (
    InputError,
    MissingCrsError,
    MissingFileError,
    NoOverlapError,
    SoilFieldError,
    UnreadableFileError,
)
from swathe.grid import GridGeometry, Window
from swathe.io.crs import Frame
from swathe.io.elevation import open_elevation
from swathe.io.soil import SoilLayer, read_soil
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

UNKNOWN, GRAVEL, SAND, CLAY, SILT, ROCK, NONE = SoilClass
WEST, NORTH = 740_000.0, 4_050_000.0
# Ten by ten cells of 10 m.
FRAME = Frame(GridGeometry(10, 10, 10.0, WEST, NORTH), pyproj.CRS(UTM16).to_wkt())
LOCAL = Frame(GridGeometry(10, 10, 10.0, 0.0, 100.0))


def block(west: float, north: float, east: float, south: float) -> shapely.Polygon:
    """A box by metres from the north-west corner of the frame, southward positive."""
    return shapely.box(WEST + west, NORTH - south, WEST + east, NORTH - north)


def write_vector(
    path: Path, shapes: Sequence[Any], fields: dict[str, Sequence[Any]], crs: str | None = UTM16, layer: str = "soils"
) -> str:
    columns = [np.array(values, dtype=object if isinstance(values[0], str) else None) for values in fields.values()]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")
        pyogrio.raw.write(
            path,
            shapely.to_wkb(np.array(shapes, dtype=object)),
            columns,
            np.array(list(fields), dtype=object),
            layer=layer,
            crs=crs,
            geometry_type="Unknown",
            driver={".gpkg": "GPKG", ".geojson": "GeoJSON", ".shp": "ESRI Shapefile"}[path.suffix],
            append=path.exists(),
        )
    return str(path)


def halves(path: Path, **fields: Sequence[Any]) -> str:
    """Write the west half and the east half of the frame as two polygons."""
    return write_vector(path, [block(0, 0, 50, 100), block(50, 0, 100, 100)], fields)


def drawn(layer: SoilLayer) -> list[str]:
    """The layer as rows of letters."""
    return ["".join("?gsciRN"[code] for code in row) for row in layer.codes]


@pytest.mark.parametrize("name", ["soil.gpkg", "soil.geojson"])
def test_polygons_are_burnt_at_cell_centres(tmp_path: Path, name: str) -> None:
    # The first polygon ends beyond the centre of column 4, the second begins there; row 9 is left out.
    shapes = [block(0, 0, 46, 90), block(46, 0, 100, 90)]
    layer = read_soil(write_vector(tmp_path / name, shapes, {"label": ["sand", "clay loam"]}), FRAME)
    assert drawn(layer) == ["sssssccccc"] * 9 + ["??????????"]
    assert layer.codes.dtype == np.uint8
    assert layer.report.field == "label"
    assert layer.report.covered_fraction == 0.9
    assert [(entry.value, entry.soil_class, entry.cells) for entry in layer.report.entries] == [
        ("clay loam", CLAY, 45),
        ("sand", SAND, 45),
    ]


def test_where_polygons_overlap_the_worse_soil_wins_in_any_order(tmp_path: Path) -> None:
    whole, pond = block(0, 0, 100, 100), block(20, 20, 40, 40)
    for number, order in enumerate(([0, 1], [1, 0])):
        shapes, labels = [whole, pond], ["sand", "water"]
        path = write_vector(
            tmp_path / f"{number}.gpkg", [shapes[n] for n in order], {"label": [labels[n] for n in order]}
        )
        layer = read_soil(path, FRAME)
        assert drawn(layer) == ["ssssssssss"] * 2 + ["ssNNssssss"] * 2 + ["ssssssssss"] * 6
        assert layer.report.disputed_cells == 4


def test_what_is_not_understood_hides_nothing_and_is_listed(tmp_path: Path) -> None:
    path = write_vector(
        tmp_path / "soil.gpkg",
        [block(0, 0, 50, 100), block(0, 0, 100, 100)],
        {"label": ["gravel", "Urban land"]},
    )
    layer = read_soil(path, FRAME)
    assert drawn(layer) == ["ggggg?????"] * 10
    assert [entry.label for entry in layer.report.not_understood] == ["Urban land"]


def test_a_polygon_that_crosses_itself_is_repaired(tmp_path: Path) -> None:
    bow_tie = shapely.Polygon([(WEST, NORTH), (WEST + 100, NORTH), (WEST, NORTH - 100), (WEST + 100, NORTH - 100)])
    layer = read_soil(write_vector(tmp_path / "soil.gpkg", [bow_tie], {"label": ["clay"]}), FRAME)
    assert drawn(layer)[1][2:8] == "cccccc"
    assert layer.codes[0, 5] == layer.codes[9, 5] == CLAY
    assert layer.codes[5, 0] == layer.codes[5, 9] == UNKNOWN


def test_a_vector_in_degrees_lands_on_the_same_cells(tmp_path: Path) -> None:
    way = pyproj.Transformer.from_crs(UTM16, "EPSG:4326", always_xy=True)

    def to_degrees(points: Any) -> Any:
        return np.column_stack(way.transform(points[:, 0], points[:, 1]))

    shapes = [shapely.transform(shape, to_degrees) for shape in (block(0, 0, 42, 100), block(42, 0, 100, 100))]
    path = write_vector(tmp_path / "soil.geojson", shapes, {"label": ["sand", "rock"]}, "EPSG:4326")
    assert drawn(read_soil(path, FRAME)) == ["ssssRRRRRR"] * 10


def test_a_window_of_the_map_gets_its_part(tmp_path: Path) -> None:
    path = halves(tmp_path / "soil.gpkg", label=["sand", "clay"])
    part = read_soil(path, FRAME.window(Window(2, 3, 4, 5)))
    assert drawn(part) == ["ssccc"] * 4


def test_the_field_that_is_understood_best_is_chosen(tmp_path: Path) -> None:
    path = halves(tmp_path / "a.gpkg", name=["north field", "sand pit road"], texture=["silt loam", "clay"], cat=[1, 2])
    assert read_soil(path, FRAME).report.field == "texture"
    # Of two that are understood alike, the one with a telling name.
    path = halves(tmp_path / "b.gpkg", a=["sand", "clay"], soil_label=["clay", "sand"])
    assert read_soil(path, FRAME).report.field == "soil_label"
    assert read_soil(path, FRAME, field="a").report.field == "a"


def test_figures_of_sand_silt_and_clay_are_read_where_no_words_are(tmp_path: Path) -> None:
    path = halves(
        tmp_path / "soil.gpkg",
        mukey=["1", "2"],
        sandtotal_r=[92.0, 20.0],
        silttotal_r=[5.0, 20.0],
        claytotal_r=[3.0, 60.0],
    )
    layer = read_soil(path, FRAME)
    assert drawn(layer) == ["sssssccccc"] * 10
    assert layer.report.field == "sandtotal_r, silttotal_r, claytotal_r"


def test_an_unknown_field_is_refused_with_those_that_exist(tmp_path: Path) -> None:
    with pytest.raises(SoilFieldError, match=r"no field 'soil'.*cat, label"):
        read_soil(halves(tmp_path / "soil.gpkg", cat=[1, 2], label=["sand", "clay"]), FRAME, field="soil")


def test_numbers_without_a_legend_name_the_option(tmp_path: Path) -> None:
    path = halves(tmp_path / "soil.gpkg", cat=[1, 2])
    for field in (None, "cat"):
        with pytest.raises(SoilFieldError, match="--soil-legend"):
            read_soil(path, FRAME, field=field)


@pytest.mark.parametrize(
    "text",
    [
        "cat,label\n1,loess\n2,beach\n",
        "id;cat;name\n10;1;Lehm\n20;2;Sand\n",
        "\ufeffcat\tclass\n1\tSILT\n2\tsand\n",
        "cat,label,class\n1,no idea,silt\n2,rock,sand\n",  # the class wins over the words
    ],
)
def test_a_legend_says_what_numbers_mean(tmp_path: Path, text: str) -> None:
    legend = tmp_path / "legend.csv"
    legend.write_text(text, encoding="utf-8")
    path = halves(tmp_path / "soil.gpkg", cat=[1, 2])
    layer = read_soil(path, FRAME, legend=str(legend))
    assert drawn(layer) == ["iiiiisssss"] * 10
    assert layer.report.field == "cat"
    grid = np.repeat([[1, 2]], 10, axis=0).repeat(5, axis=1).astype(np.uint8)
    raster = write(tmp_path / "soil.tif", grid, transform=Affine(10, 0, WEST, 0, -10, NORTH))
    assert drawn(read_soil(str(raster), FRAME, legend=str(legend))) == ["iiiiisssss"] * 10


@pytest.mark.parametrize(
    ("text", "kind", "word"),
    [
        ("cat,class\n1,mud pie\n", SoilFieldError, "mud pie"),
        ("cat\n1\n", SoilFieldError, "head line"),
        ("cat,label\n7,sand\n", SoilFieldError, "soil.gpkg"),
        ("\0\0\0", UnreadableFileError, "not text"),
        (None, MissingFileError, "legend.csv"),
    ],
)
def test_a_legend_that_does_not_fit_is_refused(
    tmp_path: Path, text: str | None, kind: type[InputError], word: str
) -> None:
    if text is not None:
        (tmp_path / "legend.csv").write_text(text)
    path = halves(tmp_path / "soil.gpkg", cat=[1, 2])
    with pytest.raises(kind, match=word):
        read_soil(path, FRAME, legend=str(tmp_path / "legend.csv"))


def test_a_raster_of_other_cells_gives_each_cell_the_value_under_its_centre(tmp_path: Path) -> None:
    grid = np.array([[1, 2], [3, 0]], dtype=np.uint8)
    raster = write(tmp_path / "soil.tif", grid, transform=Affine(30, 0, WEST, 0, -30, NORTH), nodata=0)
    legend = tmp_path / "legend.csv"
    legend.write_text("value,class\n1,sand\n2,clay\n3,rock\n")
    layer = read_soil(str(raster), FRAME, legend=str(legend))
    assert drawn(layer) == ["sssccc????"] * 3 + ["RRR???????"] * 3 + ["??????????"] * 4
    assert layer.report.covered_fraction == 0.27
    assert [(entry.value, entry.label) for entry in layer.report.entries] == [("1", "1"), ("2", "2"), ("3", "3")]


def test_names_that_a_raster_carries_beside_it_are_read(tmp_path: Path) -> None:
    grid = np.repeat([[1, 2]], 10, axis=0).repeat(5, axis=1).astype(np.uint8)
    raster = write(tmp_path / "soil.tif", grid, transform=Affine(10, 0, WEST, 0, -10, NORTH))
    names = "".join(f"<Category>{name}</Category>" for name in ("", "silt", "sand"))
    (tmp_path / "soil.tif.aux.xml").write_text(
        f'<PAMDataset><PAMRasterBand band="1"><CategoryNames>{names}</CategoryNames></PAMRasterBand></PAMDataset>'
    )
    assert drawn(read_soil(str(raster), FRAME)) == ["iiiiisssss"] * 10
    fields = (
        "<FieldDefn><Name>Value</Name><Type>0</Type><Usage>5</Usage></FieldDefn>"
        "<FieldDefn><Name>Label</Name><Type>2</Type><Usage>2</Usage></FieldDefn>"
    )
    rows = "<Row><F>1</F><F>loam</F></Row><Row><F>2</F><F>dune</F></Row>"
    (tmp_path / "soil.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><GDALRasterAttributeTable>'
        f"{fields}{rows}</GDALRasterAttributeTable></PAMRasterBand></PAMDataset>"
    )
    assert drawn(read_soil(str(raster), FRAME)) == ["iiiiisssss"] * 10


def test_a_raster_of_unexplained_numbers_names_the_option(tmp_path: Path) -> None:
    raster = write(
        tmp_path / "soil.tif", np.ones((10, 10), dtype=np.uint8), transform=Affine(10, 0, WEST, 0, -10, NORTH)
    )
    with pytest.raises(SoilFieldError, match=r"'1'.*--soil-legend"):
        read_soil(str(raster), FRAME)
    with pytest.raises(SoilFieldError, match="no fields"):
        read_soil(str(raster), FRAME, field="cat")


def test_soil_that_lies_elsewhere_is_refused(tmp_path: Path) -> None:
    vector = write_vector(tmp_path / "far.gpkg", [block(5000, 0, 5100, 100)], {"label": ["sand"]})
    raster = write(tmp_path / "far.tif", np.ones((9, 9), np.uint8), transform=Affine(10, 0, WEST - 9000, 0, -10, NORTH))
    for path in (vector, str(raster), "bundled:jacksboro"):
        with pytest.raises(NoOverlapError):
            read_soil(path, FRAME if path != "bundled:jacksboro" else LOCAL)


@pytest.mark.parametrize(("frame", "crs"), [(FRAME, None), (LOCAL, UTM16)])
def test_soil_and_terrain_both_have_a_system_or_neither(tmp_path: Path, frame: Frame, crs: str | None) -> None:
    vector = write_vector(tmp_path / "soil.shp", [block(0, 0, 100, 100)], {"label": ["sand"]}, crs)
    raster = write(tmp_path / "s.tif", np.ones((9, 9), np.uint8), crs=crs, transform=Affine(10, 0, WEST, 0, -10, NORTH))
    for path in (vector, str(raster)):
        with pytest.raises(MissingCrsError):
            read_soil(path, frame)


def test_without_systems_soil_lies_in_the_elevations_own_coordinates(tmp_path: Path) -> None:
    grid = tmp_path / "dem.asc"
    rows = "\n".join([" ".join(["5"] * 10)] * 10)
    grid.write_text(f"ncols 10\nnrows 10\nxllcorner 740000\nyllcorner 4049900\ncellsize 10\n{rows}\n")
    with open_elevation([str(grid)], cell_size_m=10.0) as source:
        frame = source.frame
    vector = write_vector(
        tmp_path / "soil.shp", [block(0, 0, 50, 100), block(50, 0, 100, 100)], {"label": ["sand", "clay"]}, None
    )
    assert drawn(read_soil(vector, frame)) == ["sssssccccc"] * 10


def test_a_picture_of_classes_lies_over_a_picture_of_heights(tmp_path: Path) -> None:
    grey = np.full((10, 10), 7, dtype=np.uint8)
    classes = np.repeat([[1, 2]], 10, axis=0).repeat(5, axis=1).astype(np.uint8)
    classes[0] = 2
    for name, picture in (("heights.png", grey), ("classes.png", classes)):
        write(tmp_path / name, picture, crs=None, transform=None, driver="PNG")
    (tmp_path / "legend.csv").write_text("value,class\n1,sand\n2,clay\n")
    with open_elevation([str(tmp_path / "heights.png")], cell_size_m=10.0, height_range_m=(0.0, 9.0)) as source:
        layer = read_soil(str(tmp_path / "classes.png"), source.frame, legend=str(tmp_path / "legend.csv"))
    assert drawn(layer) == ["cccccccccc"] + ["sssssccccc"] * 9


def test_a_layer_is_named_with_the_path(tmp_path: Path) -> None:
    path = tmp_path / "soil.gpkg"
    write_vector(path, [block(0, 0, 100, 100)], {"label": ["sand"]}, layer="old")
    write_vector(path, [block(0, 0, 100, 100)], {"label": ["clay"]}, layer="new")
    assert drawn(read_soil(f"{path}|layername=new", FRAME))[0] == "cccccccccc"
    assert drawn(read_soil(str(path), FRAME))[0] == "ssssssssss"
    with pytest.raises(SoilFieldError, match="old, new"):
        read_soil(f"{path}|layername=none", FRAME)


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("soil.gpkg", b"", UnreadableFileError),
        ("soil.gpkg", b"SQLite format 3\0 but not really", UnreadableFileError),
        ("soil.tif", b"not a raster", UnreadableFileError),
        ("soil.geojson", b'{"type": "FeatureColl', UnreadableFileError),
        ("missing.gpkg", None, MissingFileError),
    ],
)
def test_files_that_are_no_soil_map_are_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, kind: type[InputError], capfd: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(kind, match=name) as refusal:
        read_soil(str(tmp_path / name), FRAME)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")


def test_lines_are_no_soil_map(tmp_path: Path) -> None:
    line = {"type": "LineString", "coordinates": [[-84.3, 36.5], [-84.2, 36.6]]}
    feature = {"type": "Feature", "properties": {"label": "sand"}, "geometry": line}
    path = tmp_path / "roads.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with pytest.raises(UnreadableFileError, match="no polygons"):
        read_soil(str(path), FRAME)


def shares(layer: SoilLayer) -> dict[str, float]:
    return {entry.label: round(100 * entry.cells / layer.codes.size, 1) for entry in layer.report.entries}


def test_the_real_zones_of_ebergoetzen(swathe_data: Path) -> None:
    with open_elevation([str(swathe_data / "ebergotzen/ebergotzen_dem_25m.tif")]) as source:
        frame = source.frame
    layer = read_soil(str(swathe_data / "ebergotzen/ebergotzen_soil_zones.gpkg"), frame)
    assert layer.report.covered_fraction == 1
    assert shares(layer) == {
        "silt and sand": 45.6,
        "clayey derivatives": 22.6,
        "clay and loess": 18.0,
        "sandy material": 13.8,
    }
    types = read_soil(
        str(swathe_data / "ebergotzen/ebergotzen_soiltype_25m.tif"),
        frame,
        legend=str(swathe_data / "ebergotzen/ebergotzen_soiltype_classes.csv"),
    )
    assert types.report.not_understood == ()
    assert types.report.covered_fraction == pytest.approx(0.48, abs=0.005)
    moor = {entry.label: entry.soil_class for entry in types.report.entries}
    assert moor["HMoor"] == moor["Moor"] == NONE


def test_the_real_soils_of_fort_bragg_agree_as_vector_and_as_raster(swathe_data: Path) -> None:
    folder = swathe_data / "fortbragg"
    with open_elevation([str(folder / "fortbragg_elevation_2016_1m.tif")]) as source:
        frame = source.frame
    vector = read_soil(str(folder / "fortbragg_soils.gpkg"), frame)
    raster = read_soil(
        str(folder / "fortbragg_soils_0.3m.tif"), frame, legend=str(folder / "fortbragg_soils_classes.csv")
    )
    assert shares(vector) == {"loamy sand": 80.4, "sand": 18.3, "loam": 1.3}
    assert np.mean(vector.codes != raster.codes) < 1e-3
