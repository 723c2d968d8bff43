"""Who the emulator says it is: model, serial numbers and firmware, as the identity registers carry them."""

import socket

ARM_TYPE = 6
AXES = 6
"""Together an xArm6 to the SDK."""

FIRMWARE = "v2.5.0"
"""The version announced. Clients choose by it how they speak: from 2.0.102 on they wait for feedback frames, from
2.4.101 on they send infinity for an axis that shall keep its value instead of the value of their last report."""

CONTROL_BOX_SERIAL = "AC1300EMU"
FIELD_SIZE = 40
"""Bytes of either identity register; clients cut at the first zero byte, so one must be left."""


def robot_serial(host: str) -> str:
    """`XI1300EMU` and the IPv4 address in hexadecimal: tells emulators from robots and from each other.

    Characters 3 to 6 are the hardware generation, as on real arms; the SDK reads them as a number.

    Raises:
        OSError: `host` is no IPv4 address and no name of one.
    """
    return f"XI1300EMU{socket.inet_aton(socket.gethostbyname(host)).hex().upper()}"


def version_field(serial: str) -> bytes:
    """Register 1: axes, type, serial numbers and firmware."""
    return f"{AXES},{ARM_TYPE},{serial},{CONTROL_BOX_SERIAL},{FIRMWARE}".encode().ljust(FIELD_SIZE, b"\0")


def serial_field(serial: str) -> bytes:
    """Register 2: serial numbers of arm and control box."""
    return f"{serial}\0{CONTROL_BOX_SERIAL}\0".encode().ljust(FIELD_SIZE, b"\0")
