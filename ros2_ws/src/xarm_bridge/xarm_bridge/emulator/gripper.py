"""The xArm gripper as a Modbus RTU device behind the control box's RS485 register. Positions in pulses."""

import struct

DEVICE_ID = 8
READ_REGISTERS = 0x03
WRITE_REGISTERS = 0x10
ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3
LARGEST_READ = 16

STATUS = 0x0000
ERROR_CODE = 0x000F
ENABLE = 0x0100
MODE = 0x0101
CLEAR_ERROR = 0x0109
SPEED = 0x0303
TARGET = 0x0700
POSITION = 0x0702
VERSION = 0x0801

CLOSED, OPEN = -10, 850
"""Range of positions the gripper takes, pulses; 850 is 85 mm between the fingers."""

PULSES_PER_SPEED_UNIT = 0.21
"""Pulses per second at speed 1 (r/min of the motor): the stroke takes 0.8 s at the top speed of 5000."""

FIRMWARE = (3, 4, 3)
"""The first firmware that reports "moving" in its status register, which clients wait for."""


class Gripper:
    """One gripper. Its time is given by the caller through `advance`."""

    def __init__(self) -> None:
        self.position = float(OPEN)
        self._target = float(OPEN)
        self._now = 0.0
        self._registers = {STATUS: 0, ERROR_CODE: 0, ENABLE: 0, MODE: 0, SPEED: 1500}
        self._registers.update({VERSION + index: number for index, number in enumerate(FIRMWARE)})

    def advance(self, now: float) -> None:
        """Move on to a time in seconds; earlier times change nothing."""
        elapsed = max(now - self._now, 0.0)
        self._now = max(now, self._now)
        most = self._registers[SPEED] * PULSES_PER_SPEED_UNIT * elapsed
        displacement = self._target - self.position
        self.position += max(-most, min(most, displacement))
        self._registers[STATUS] = int(self.position != self._target)

    def answer(self, frame: bytes) -> bytes:
        """Reply to a Modbus RTU frame without CRC: device, function, address, count, ..."""
        if len(frame) < 6:
            return bytes([DEVICE_ID, (frame[1] if len(frame) > 1 else 0) | 0x80, ILLEGAL_VALUE])
        device, function, address, count = struct.unpack_from(">BBHH", frame)
        if function == READ_REGISTERS:
            if count > LARGEST_READ:
                return bytes([device, function | 0x80, ILLEGAL_VALUE])
            values = [self._read(address + index) for index in range(count)]
            if None in values:
                return bytes([device, function | 0x80, ILLEGAL_ADDRESS])
            return bytes([device, function, 2 * count]) + struct.pack(f">{count}H", *values)
        if function == WRITE_REGISTERS:
            if len(frame) != 7 + 2 * count:
                return bytes([device, function | 0x80, ILLEGAL_VALUE])
            self._write(address, struct.unpack_from(f">{count}H", frame, 7))
            return frame[:6]
        return bytes([device, function | 0x80, ILLEGAL_FUNCTION])

    def _read(self, address: int) -> int | None:
        if address in (POSITION, POSITION + 1):
            high, low = struct.unpack(">HH", struct.pack(">i", round(self.position)))
            return high if address == POSITION else low
        return self._registers.get(address)

    def _write(self, address: int, values: tuple[int, ...]) -> None:
        if address == TARGET and len(values) == 2:
            (target,) = struct.unpack(">i", struct.pack(">HH", *values))
            if self._registers[ENABLE]:  # a gripper that is not enabled stays where it is
                self._target = float(max(CLOSED, min(OPEN, target)))
        elif address == CLEAR_ERROR:
            self._registers[ERROR_CODE] = 0
        else:
            self._registers.update({address + index: value for index, value in enumerate(values)})
