"""What the run log's channels hold: ROS 2 message definitions, and JSON schemas for what ROS has no message for."""

from __future__ import annotations

from typing import Any, NamedTuple

_RULE = "=" * 80

_TIME = """int32 sec
uint32 nanosec
"""
_HEADER = """builtin_interfaces/Time stamp
string frame_id
"""
_POINT = """float64 x
float64 y
float64 z
"""
_QUATERNION = """float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""
_POSE = """geometry_msgs/Point position
geometry_msgs/Quaternion orientation
"""
_TWIST = """geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
"""

#: The fields of each message, as its ROS 2 package defines them.
_FIELDS: dict[str, str] = {
    "builtin_interfaces/Time": _TIME,
    "std_msgs/Header": _HEADER,
    "geometry_msgs/Point": _POINT,
    "geometry_msgs/Vector3": _POINT,
    "geometry_msgs/Quaternion": _QUATERNION,
    "geometry_msgs/Pose": _POSE,
    "geometry_msgs/Twist": _TWIST,
    "geometry_msgs/Transform": """geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
    "geometry_msgs/PoseStamped": """std_msgs/Header header
geometry_msgs/Pose pose
""",
    "geometry_msgs/PoseWithCovariance": """geometry_msgs/Pose pose
float64[36] covariance
""",
    "geometry_msgs/TwistWithCovariance": """geometry_msgs/Twist twist
float64[36] covariance
""",
    "geometry_msgs/TransformStamped": """std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
    "nav_msgs/MapMetaData": """builtin_interfaces/Time map_load_time
float32 resolution
uint32 width
uint32 height
geometry_msgs/Pose origin
""",
    "sensor_msgs/LaserScan": """std_msgs/Header header
float32 angle_min
float32 angle_max
float32 angle_increment
float32 time_increment
float32 scan_time
float32 range_min
float32 range_max
float32[] ranges
float32[] intensities
""",
    "sensor_msgs/Range": """std_msgs/Header header
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
""",
    "nav_msgs/Odometry": """std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
""",
    "geometry_msgs/TwistStamped": """std_msgs/Header header
geometry_msgs/Twist twist
""",
    "nav_msgs/Path": """std_msgs/Header header
geometry_msgs/PoseStamped[] poses
""",
    "nav_msgs/OccupancyGrid": """std_msgs/Header header
nav_msgs/MapMetaData info
int8[] data
""",
    "tf2_msgs/TFMessage": """geometry_msgs/TransformStamped[] transforms
""",
}


def message_definition(name: str) -> str:
    """Return the definition of a message such as ``sensor_msgs/LaserScan`` followed by all that it is made of."""
    needed: list[str] = []

    def visit(message: str) -> None:
        for line in _FIELDS[message].splitlines():
            part = line.split()[0].partition("[")[0]
            if part in _FIELDS and part not in needed:
                needed.append(part)
                visit(part)

    visit(name)
    return _FIELDS[name] + "".join(f"{_RULE}\nMSG: {part}\n{_FIELDS[part]}" for part in needed)


class Topic(NamedTuple):
    """A channel of the log: its message's name, and the JSON schema when the message is JSON."""

    message: str
    json: dict[str, Any] | None = None


def _json(description: str, **fields: object) -> dict[str, Any]:
    """Return the schema of an object that has a time and these fields."""
    properties = {"time_s": _NUMBER, **fields}
    return {"type": "object", "description": description, "properties": properties, "required": ["time_s"]}


_NUMBER = {"type": "number"}
_TEXT = {"type": "string"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_NUMBERS_OR_NONE = {"type": "array", "items": {"type": ["number", "null"]}}

#: Every channel by its topic; the place in this table, from 1, is the channel's number in the file.
TOPICS: dict[str, Topic] = {
    "/scan": Topic("sensor_msgs/LaserScan"),
    "/sonar": Topic("sensor_msgs/Range"),
    "/odom": Topic("nav_msgs/Odometry"),
    "/truth": Topic("nav_msgs/Odometry"),
    "/cmd_vel": Topic("geometry_msgs/TwistStamped"),
    "/tf": Topic("tf2_msgs/TFMessage"),
    "/tf_static": Topic("tf2_msgs/TFMessage"),
    "/plan": Topic("nav_msgs/Path"),
    "/local_plan": Topic("nav_msgs/Path"),
    "/map": Topic("nav_msgs/OccupancyGrid"),
    "/events": Topic("swathe.Event", _json("What happened.", kind=_TEXT, fields={"type": "object"})),
    "/status": Topic("swathe.Status", _json("The navigator's status from a command on.", status=_TEXT)),
    "/histogram": Topic(
        "swathe.Histogram", _json("The polar histogram of the local method.", fields={"type": "object"})
    ),
    "/movers": Topic(
        "swathe.Movers",
        _json("What moves, each as x, y and radius in metres.", discs={"type": "array", "items": _NUMBERS}),
    ),
    "/readings": Topic(
        "swathe.Reading",
        _json(
            "A penetrometer reading.",
            x_m=_NUMBER,
            y_m=_NUMBER,
            depths_m=_NUMBERS_OR_NONE,
            cone_indices_kpa=_NUMBERS_OR_NONE,
            refusal_depth_m={"type": ["number", "null"]},
        ),
    ),
    "/grids": Topic(
        "swathe.Grids",
        _json(
            "What the overlapping grids said at each step of a second: a sign a step, 1 navigable, 0 not.",
            times_s=_NUMBERS,
            answers={"type": "array", "items": _TEXT},
            navigable=_TEXT,
        ),
    ),
    "/outcome": Topic(
        "swathe.Outcome", _json("How the drive ended; the last message of a complete log.", fields={"type": "object"})
    ),
}
