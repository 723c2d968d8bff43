"""Messages of a camera, as recorded: stamped headers and CameraInfo."""

from typing import Any

import numpy as np

from egophys_core.recording.message_definitions import jazzy_types
from egophys_core.waypoint_plan import NANOSECONDS

INFO_TYPE = "sensor_msgs/msg/CameraInfo"


def stamped_header(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/Header of a time in nanoseconds."""
    types = jazzy_types().types
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def pinhole_info(header: Any, matrix: np.ndarray, size: tuple[int, int]) -> Any:
    """CameraInfo of a camera matrix [3, 3] without distortion, for images of width and height `size`."""
    return lens_info(header, matrix, size, model="plumb_bob", coefficients=np.zeros(5))


def lens_info(header: Any, matrix: np.ndarray, size: tuple[int, int], *, model: str, coefficients: np.ndarray) -> Any:
    """CameraInfo of a camera matrix [3, 3] and distortion coefficients [D], for images of width and height `size`."""
    types = jazzy_types().types
    return types[INFO_TYPE](
        header=header,
        height=size[1],
        width=size[0],
        distortion_model=model,
        d=np.array(coefficients, dtype=np.float64),
        k=matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([matrix, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )
