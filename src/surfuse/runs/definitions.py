"""ROS 2 message definitions of the log: standard ones (Jazzy) for viewers, own ones with every bit of our records.

Each text is the concatenated definition that MCAP's `ros2msg` schema encoding asks for: a reader needs nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.runs.sweep_fields import definition_text, logged

_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

_OUTLINE = """float64[] vertices_m
float64[16] world_from_part
float64 margin_m
float64[] sigma_m
int64[] hole_size
float64[] hole_vertices_m
float64[] viewpoint_m
"""

_SENSOR = """string name
string kind
float64 range_min_m
float64 range_max_m
float64 beam_full_angle_rad
float64 sigma_m
float64 incidence_limit_rad
float64 firing_time_s
float64 frequency_hz
float64 aperture_m
float64 dead_length_m
surfuse_msgs/LateTable[] late
"""

_LATE = """float64[] tilt_rad
float64[] bias_m
float64[] scatter_m
"""


@dataclass(frozen=True)
class Definition:
    """One message type: its full ROS 2 name and its concatenated definition.

    `text` has the definitions of all types that it is made of, in the form that MCAP asks of ros2msg.
    """

    name: str
    text: str


SCENE = Definition(
    "surfuse_msgs/msg/Scene",
    "uint32 format_version\n"
    "surfuse_msgs/Sensor[] sensors\n"
    "float64[16] world_from_part\n"
    "surfuse_msgs/Outline[] outline\n"
    "float64 depth_max_m\n"
    f"{_RULE}\nMSG: surfuse_msgs/Sensor\n{_SENSOR}{_RULE}\nMSG: surfuse_msgs/Outline\n{_OUTLINE}"
    f"{_RULE}\nMSG: surfuse_msgs/LateTable\n{_LATE}",
)

SWEEP = Definition("surfuse_msgs/msg/Sweep", definition_text(logged()))

PLAN = Definition(
    "surfuse_msgs/msg/Plan",
    "float64[] world_from_grip\n"
    "float64[] uv_m\n"
    "int64[] row\n"
    "float64[] joints_rad\n"
    "uint32 joints\n"
    "surfuse_msgs/Outline outline\n"
    "float64 step_m\n"
    "float64 standoff_m\n"
    "float64[] skipped_uv_m\n"
    "string[] skipped_reason\n"
    f"{_RULE}\nMSG: surfuse_msgs/Outline\n{_OUTLINE}",
)

VIEW = Definition(
    "surfuse_msgs/msg/CameraView",
    """float64 t_s
uint32 width_px
uint32 height_px
float64 fx_px
float64 fy_px
float64 cx_px
float64 cy_px
float64[5] distortion
float64[16] world_from_camera
""",
)

EVENT = Definition(
    "surfuse_msgs/msg/Event",
    """float64 t_s
uint8 level
string source
string text
""",
)

RANGE = Definition(
    "sensor_msgs/msg/Range",
    "uint8 ULTRASOUND=0\nuint8 INFRARED=1\nstd_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\n"
    f"float32 min_range\nfloat32 max_range\nfloat32 range\nfloat32 variance\n{_HEADER}",
)

IMAGE = Definition(
    "sensor_msgs/msg/Image",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
    f"uint8[] data\n{_HEADER}",
)

CAMERA_INFO = Definition(
    "sensor_msgs/msg/CameraInfo",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
    "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n"
    f"{_RULE}\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\n"
    f"bool do_rectify\n{_HEADER}",
)

JOINT_STATE = Definition(
    "sensor_msgs/msg/JointState",
    f"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{_HEADER}",
)

TF = Definition(
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/TransformStamped[] transforms\n"
    f"{_RULE}\nMSG: geometry_msgs/TransformStamped\n"
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    f"{_RULE}\nMSG: geometry_msgs/Transform\n"
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    f"{_RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
    f"{_RULE}\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n{_HEADER}",
)

LOG = Definition(
    "rcl_interfaces/msg/Log",
    "uint8 DEBUG=10\nuint8 INFO=20\nuint8 WARN=30\nuint8 ERROR=40\nuint8 FATAL=50\nbuiltin_interfaces/Time stamp\n"
    "uint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n"
    f"{_RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
)
