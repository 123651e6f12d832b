"""Hand readings from CSV: places, depths, units, and errors that name file and line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pyproj
import pytest

from raster_files import UTM16
from swathe.belief import ClassReading, PenetrometerReading
from swathe.errors import MissingFileError, ReadingFileError, UnreadableFileError
from swathe.grid import GridGeometry
from swathe.io.crs import Frame
from swathe.io.readings import read_readings
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from pathlib import Path

LOCAL = Frame(GridGeometry(10, 10, 10.0, 0.0, 100.0))
PLACED = Frame(GridGeometry(10, 10, 10.0, 740_000.0, 4_050_000.0), pyproj.CRS(UTM16).to_wkt())


def write(folder: Path, text: str) -> Path:
    path = folder / "readings.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_depth_columns_become_profiles(tmp_path: Path) -> None:
    path = write(tmp_path, "x,y,ci_10cm,ci_5cm,refusal_cm,note\n12,34,500,300,,soft\n\n15,36,,,4,stone\n")
    assert read_readings(path, LOCAL) == [
        PenetrometerReading(12.0, 34.0, (0.05, 0.1), (300.0, 500.0)),
        PenetrometerReading(15.0, 36.0, (), (), 0.04),
    ]


def test_units_semicolons_sleeve_friction_and_classes(tmp_path: Path) -> None:
    head = "\ufeffX;Y;CI_2in_psi;FS_2in_psi;class\n"
    path = write(tmp_path, head + "1;2;100;2;\n3;4;;;Clay\n")
    pushed, word = read_readings(path, LOCAL)
    assert isinstance(pushed, PenetrometerReading)
    assert pushed.depths_m == (0.0508,)
    assert pushed.cone_indices_kpa == pytest.approx((689.4757,))
    assert pushed.sleeve_frictions_kpa == pytest.approx((13.789514,))
    assert word == ClassReading(3.0, 4.0, SoilClass.CLAY)


def test_degrees_are_brought_into_the_frame(tmp_path: Path) -> None:
    x_m, y_m = 740_050.0, 4_049_950.0
    lon, lat = pyproj.Transformer.from_crs(UTM16, "EPSG:4326", always_xy=True).transform(x_m, y_m)
    path = write(tmp_path, f"lon,lat,ci_5cm\n{lon!r},{lat!r},300\n")
    (reading,) = read_readings(path, PLACED)
    assert (reading.x_m, reading.y_m) == pytest.approx((x_m, y_m), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x,y,ci_5cm\n", "head line"),
        ("", "head line"),
        ("east,north,ci_5cm\n1,2,3\n", "neither the columns"),
        ("x,y\n1,2\n", "no column with a reading"),
        ("x,y,ci_deep\n1,2,3\n", "'ci_deep'"),
        ("x,y,ci_5cm,ci_0.05m\n1,2,3,4\n", "two columns for the depth"),
        ("x,y,ci_5cm,ci_5cm\n1,2,3,4\n", "twice"),
        ("x,y,fs_5cm,refusal_cm\n1,2,3,4\n", "without cone index"),
        ("x,y,ci_5cm\n1,2,300\n1,2,soft\n", "readings.csv, line 3.*'soft'"),
        ("x,y,ci_5cm\n1,2,nan\n", "line 2.*'nan'"),
        ("x,y,ci_5cm\n1,,300\n", "line 2 has no place"),
        ("x,y,ci_5cm\n1,2,\n", "line 2.*neither"),
        ("x,y,ci_5cm\n1,2,-4\n", "line 2.*not physical"),
        ("x,y,ci_5cm\n1,2,3,4\n", "line 2 has more fields"),
        ("x,y,ci_5cm,class\n1,2,3,clay\n", "line 2 has both"),
        ("x,y,class\n1,2,mud\n", "line 2.*'mud'"),
        ("x,y,class\n1,2,unknown\n", "line 2.*'unknown'"),
        ("x,y,ci_5cm,ci_10cm,fs_5cm,fs_10cm\n1,2,3,4,5,\n", "line 2 lacks sleeve"),
        ("lon,lat,ci_5cm\n1,2,3\n", "line 2"),
    ],
)
def test_what_cannot_be_read_is_named_with_file_and_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ReadingFileError, match=said) as caught:
        read_readings(write(tmp_path, text), LOCAL)
    assert "readings.csv" in caught.value.message
    assert caught.value.remedy


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        read_readings(tmp_path / "none.csv", LOCAL)
    (tmp_path / "b.csv").write_bytes(b"x,y,ci_5cm\n\xff\xfe\n")
    with pytest.raises(UnreadableFileError):
        read_readings(tmp_path / "b.csv", LOCAL)
