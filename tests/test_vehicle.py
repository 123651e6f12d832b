"""Vehicle files: what the bundled ones promise, and what a user's own file is told when it is wrong."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

import swathe.vehicle
from swathe.errors import InvalidVehicleError, MissingFileError, SwatheError, UnreadableFileError
from swathe.vehicle import Vehicle, load_vehicle, vehicle_names

BUNDLED = Path(swathe.vehicle.__file__).parent / "vehicles"

OWN_FILE = """
name = "mule"

[footprint]
length_m = { value = 1.2, source = "tape measure" }
width_m = 0.8
height_m = 1
ground_clearance_m = 0.2

[mass]
mass_kg = 90

[motion]
steering = "skid"
max_speed_mps = 2.0
max_turn_rate_radps = 1.5
min_turn_radius_m = 0
max_acceleration_mps2 = 1.0
max_braking_mps2 = 1.0
reaction_time_s = 0.3
sight_distance_m = 10

[limits]
grade_up = 0.3
grade_down = 0.4
side_slope = 0.2
step_height_m = 0.1

[power]
power_w = 800
drive_efficiency = 0.6
idle_power_w = 50

[ground]
traction_friction = 0.6
braking_friction = 0.6
ground_pressure_kpa = 20

[tracks]
contact_length_m = 0.9
width_m = 0.2
grousers_over_38_mm = false
road_wheels = 8
shoe_area_m2 = 0.01
manual_transmission = false
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def complaint_about(folder: Path, old: str, new: str) -> str:
    """Return the message for the own file with one change, after checking that the change was made."""
    assert old in OWN_FILE
    with pytest.raises(InvalidVehicleError) as caught:
        load_vehicle(write(folder, OWN_FILE.replace(old, new)))
    assert caught.value.remedy
    return caught.value.message


@pytest.mark.parametrize("name", vehicle_names())
def test_every_bundled_figure_has_a_source(name: str) -> None:
    document = tomllib.loads((BUNDLED / f"{name}.toml").read_text(encoding="utf-8"))
    sections = {key: content for key, content in document.items() if isinstance(content, dict)}
    assert len(sections) == 7
    for section, figures in sections.items():
        for figure, content in figures.items():
            assert isinstance(content, dict), f"{name}: {section}.{figure} is bare"
            assert content["source"].strip(), f"{name}: {section}.{figure} has no source"
            if "estimate" in content["source"]:
                assert content["source"].startswith("estimate: "), f"{name}: {section}.{figure} hides an estimate"
                assert len(content["source"]) > len("estimate: why")


@pytest.mark.parametrize("name", vehicle_names())
def test_bundled_vehicle_carries_its_own_name_and_every_source(name: str) -> None:
    vehicle = load_vehicle(name)
    assert vehicle.name == name
    assert vehicle.description
    figures = vehicle.as_dict()["figures"]
    assert {figure for figure, content in figures.items() if content["source"]} == set(figures)


def test_the_required_vehicles_are_bundled_with_the_required_limits() -> None:
    assert set(vehicle_names()) == {
        "pioneer-2dx",
        "pioneer-3at",
        "jackal",
        "husky",
        "warthog",
        "tractor",
        "pickup-4x4",
        "tracked-carrier",
    }
    pioneer = load_vehicle("pioneer-3at")
    assert (pioneer.grade_up, pioneer.grade_down, pioneer.side_slope) == (0.25, 0.30, 0.20)
    assert pioneer.max_grade == 0.30
    assert load_vehicle("pioneer-2dx").grade_up == 0.25
    tractor = load_vehicle("tractor")
    assert (tractor.grade_up, tractor.grade_down, tractor.side_slope) == (0.30, 0.30, 0.20)
    assert load_vehicle("pickup-4x4").grade_up > tractor.grade_up
    assert load_vehicle("tracked-carrier").running_gear == "tracks"


def test_derived_figures_follow_from_the_file(tmp_path: Path) -> None:
    vehicle = load_vehicle(write(tmp_path, OWN_FILE))
    assert vehicle.circumscribed_radius_m == pytest.approx(math.sqrt(1.2**2 + 0.8**2) / 2)
    assert vehicle.weight_n == pytest.approx(882.6, abs=0.05)
    assert vehicle.max_grade == 0.4
    assert vehicle.sources == {"length_m": "tape measure"}


def test_own_file_may_have_bare_figures_whole_numbers_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(b"\xef\xbb\xbf" + OWN_FILE.encode().replace(b"\n", b"\r\n"))
    for given in (path, str(path)):
        vehicle = load_vehicle(given)
        assert vehicle.name == "mule"
        assert vehicle.mass_kg == 90.0
        assert isinstance(vehicle.mass_kg, float)


def test_a_file_without_the_usual_ending_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mule").write_text(OWN_FILE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_vehicle("mule").name == "mule"


def test_core_arguments_are_flat_and_complete(tmp_path: Path) -> None:
    tracked = load_vehicle(write(tmp_path, OWN_FILE)).core_arguments()
    wheeled = load_vehicle("pioneer-3at").core_arguments()
    assert set(tracked) == set(wheeled)
    assert not {"name", "description", "sources"} & set(tracked)
    assert tracked["running_gear"] == "tracks"
    assert tracked["track_road_wheels"] == 8
    assert all(value is None for key, value in tracked.items() if key.startswith("wheel_"))
    assert wheeled["wheel_count"] == 4
    assert all(value is None for key, value in wheeled.items() if key.startswith("track_"))
    assert wheeled["vehicle_cone_index_kpa"] is None
    assert all(value is None or isinstance(value, float | int | str | bool) for value in wheeled.values())


def test_as_dict_is_json_with_value_and_source(tmp_path: Path) -> None:
    shown = json.loads(json.dumps(load_vehicle(write(tmp_path, OWN_FILE)).as_dict()))
    assert shown["name"] == "mule"
    assert shown["figures"]["length_m"] == {"value": 1.2, "source": "tape measure"}
    assert shown["figures"]["width_m"] == {"value": 0.8, "source": None}
    assert "wheel_count" not in shown["figures"]


def test_vehicles_cannot_be_changed() -> None:
    vehicle = load_vehicle("husky")
    with pytest.raises(ValidationError):
        vehicle.mass_kg = 1.0


def test_measured_cone_index_is_optional(tmp_path: Path) -> None:
    text = OWN_FILE.replace("ground_pressure_kpa = 20", "ground_pressure_kpa = 20\nvehicle_cone_index_kpa = 34.5")
    assert load_vehicle(write(tmp_path, text)).vehicle_cone_index_kpa == 34.5


@pytest.mark.parametrize(
    ("given", "nearest"), [("pioneer-3a", "pioneer-3at"), ("Husky", "husky"), ("pickup", "pickup-4x4")]
)
def test_unknown_name_is_answered_with_the_nearest_and_all_names(given: str, nearest: str) -> None:
    with pytest.raises(InvalidVehicleError) as caught:
        load_vehicle(given)
    assert f"did you mean {nearest!r}" in caught.value.message
    assert all(name in caught.value.remedy for name in vehicle_names())


@pytest.mark.parametrize(
    ("old", "new", "clause"),
    [
        ("grade_up = 0.3", "grade_up = -0.2", "limits.grade_up is -0.2, must be above 0 and at most 2"),
        ("grade_up = 0.3", "grade_up = nan", "limits.grade_up is nan, must be above 0 and at most 2"),
        ("grade_up = 0.3", "grade_up = '30 %'", "limits.grade_up is '30 %', must be above 0 and at most 2"),
        ("mass_kg = 90", "mass_kg = true", "mass.mass_kg is true, must be above 0 and at most 1,000,000"),
        ("mass_kg = 90", "mass_kg = 1e999", "mass.mass_kg is inf, must be above 0"),
        ("steering = ", "steering = 'magic' #", "motion.steering is 'magic', must be one of 'differential', 'skid'"),
        ("road_wheels = 8", "road_wheels = 8.5", "road_wheels is 8.5, must be a whole number, at least 1 and"),
        ("grousers_over_38_mm = false", "grousers_over_38_mm = 0", "tracks.grousers_over_38_mm is 0, must be true or"),
        ("[power]", "[powr]", "powr is not a known section (did you mean 'power'?)"),
        ("[power]", "[powr]", "the section [power] is missing"),
        ("power_w = 800", "powerw = 800", "power.powerw is not a known figure (did you mean 'power_w'?)"),
        ("power_w = 800", "", "power.power_w is missing"),
        ("[mass]\nmass_kg = 90", "mass = 90", "mass must be a section with figures, not 90"),
        ("width_m = 0.8", "width_m = { source = 'x' }", "footprint.width_m must have a value and may have a source"),
        ("width_m = 0.8", "width_m = { value = 1, unit = 'm' }", "footprint.width_m must have a value and may have a"),
        ("width_m = 0.8", "width_m = { value = 1, source = 7 }", "footprint.width_m.source must be text"),
        ("[tracks]", "[legs]", "exactly one of [wheels] and [tracks] must be given, not none"),
        ("[tracks]", "[wheels]\ncount = 4\n[tracks]", "exactly one of [wheels] and [tracks] must be given, not both"),
        ('name = "mule"', "", "name is missing"),
        ('name = "mule"', "name = ''", "name is '', must be text of 1 to 80 characters"),
        ("ground_clearance_m = 0.2", "ground_clearance_m = 1.5", "ground_clearance_m must be less than footprint.h"),
        ('steering = "skid"', 'steering = "ackermann"', "motion.min_turn_radius_m must be above 0 for ackermann"),
    ],
)  # fmt: skip
def test_each_bad_field_is_named_with_what_is_allowed(tmp_path: Path, old: str, new: str, clause: str) -> None:
    if new == "mass = 90":  # a bare key must stand before the first section
        text = "mass = 90\n" + OWN_FILE.replace(old, "")
        with pytest.raises(InvalidVehicleError, match="mass must be a section with figures, not 90") as caught:
            load_vehicle(write(tmp_path, text))
        assert "mass_kg is missing" not in caught.value.message
        return
    assert clause in complaint_about(tmp_path, old, new)


def test_all_bad_fields_are_listed_at_once_and_each_only_once(tmp_path: Path) -> None:
    text = OWN_FILE.replace("grade_up = 0.3", "grade_up = 3").replace("mass_kg = 90", "mass_kg = 0")
    with pytest.raises(InvalidVehicleError) as caught:
        load_vehicle(write(tmp_path, text.replace("power_w = 800", "")))
    message = caught.value.message
    assert message.count("limits.grade_up is 3") == 1
    assert message.count("mass.mass_kg is 0") == 1
    assert message.count("power.power_w is missing") == 1
    assert message.count(";") == 2


def test_contradicting_wheel_figures_are_refused(tmp_path: Path) -> None:
    wheels = "[wheels]\ncount = 4\ndiameter_m = 0.5\nwidth_m = 0.1\nsection_height_m = 0.3\ndeflection_m = 0.4\n"
    text = OWN_FILE.partition("[tracks]")[0] + wheels + "chains = false\nmanual_transmission = false\n"
    with pytest.raises(InvalidVehicleError) as caught:
        load_vehicle(write(tmp_path, text))
    assert "wheels.section_height_m must be less than half of wheels.diameter_m" in caught.value.message
    assert "wheels.deflection_m must be less than wheels.section_height_m" in caught.value.message


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("name = 'x'\nmass kg = 3\n", "line 2, column 6"),
        ("a = " + "[" * 5000, "nested too deeply"),
        ("a = 1\na = 2\n", "line 2"),
    ],
)
def test_broken_toml_is_told_by_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InvalidVehicleError, match=reason):
        load_vehicle(write(tmp_path, text))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty"),
        (b" \n\t", "is empty"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "not text in UTF-8"),
        ("name = 'x'".encode("utf-16"), "not text in UTF-8"),
        (b"#" * 2_000_000, "too large"),
    ],
)
def test_files_that_are_no_text_are_unreadable(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match=reason):
        load_vehicle(path)


def test_missing_file_folder_and_nonsense_paths(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        load_vehicle("nowhere/mule.toml")
    with pytest.raises(UnreadableFileError, match="is not a file"):
        load_vehicle(tmp_path)
    for nonsense in ("", "   ", "x" * 5000, "a\0b", "x/" * 3000 + "y.toml"):
        with pytest.raises(SwatheError) as caught:
            load_vehicle(nonsense)
        assert caught.value.exit_code == 4


def test_a_path_that_the_system_refuses_is_unreadable() -> None:
    with pytest.raises(UnreadableFileError, match="cannot be read: File name too long"):
        load_vehicle("x" * 5000 + ".toml")


def test_model_refuses_unknown_fields() -> None:
    values = load_vehicle("husky").model_dump()
    with pytest.raises(ValidationError):
        Vehicle.model_validate({**values, "colour": "red"})
