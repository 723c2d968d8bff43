"""The control box's holding registers for its users, which every client of the box reads alike.

Standard Modbus TCP on the command port (UFACTORY, UF_ModbusTCP_Manual: holding registers 256 to 511), over a connection
of its own: the SDK would wait 10,000 s for an answer, with the lock held that a stop needs.
"""

import socket
import struct
from pathlib import Path

from egophys_core.errors import ArmLostError, RobotError

PORT = 502
UNIX_SOCKET = Path("/tmp/xarmcontroller_uds_502")
"""Where an emulator listens that may not open the port."""
TIMEOUT_S = 1.0
MODBUS, UNIT = 0, 1
READ, WRITE, REFUSED = 3, 16, 0x80
HEAD = struct.Struct(">HHHBB")
"""Transaction, protocol, length of what follows, unit, function."""


class UserRegisters:
    """A client of the registers; each call is bounded in time."""

    def __init__(self, address: str, *, is_local: bool) -> None:
        """Connect to nothing yet.

        Args:
            address: IPv4 address of the control box.
            is_local: whether an emulator on this machine may stand for it.
        """
        self._address = address
        self._is_local = is_local
        self._socket: socket.socket | None = None
        self._transaction = 0

    def close(self) -> None:
        """Disconnect."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def read(self, first: int, count: int) -> list[int]:
        """Values of `count` registers from `first` on, 0 to 65535.

        Raises:
            RobotError: the box keeps no such registers.
            ArmLostError: no answer.
        """
        answer = self._ask(READ, struct.pack(">HH", first, count))
        return list(struct.unpack(f">{count}H", answer[1 : 1 + 2 * count]))

    def write(self, first: int, values: list[int]) -> None:
        """Set registers from `first` on.

        Raises:
            RobotError: the box keeps no such registers.
            ArmLostError: no answer.
        """
        count = len(values)
        self._ask(WRITE, struct.pack(f">HHB{count}H", first, count, 2 * count, *values))

    def _ask(self, function: int, parameters: bytes) -> bytes:
        """What follows the function in the answer."""
        self._transaction = (self._transaction + 1) % 65536
        try:
            connection = self._connected()
            connection.sendall(HEAD.pack(self._transaction, MODBUS, 2 + len(parameters), UNIT, function) + parameters)
            _, _, length, _, answered = HEAD.unpack(self._receive(connection, HEAD.size))
            content = self._receive(connection, length - 2)
        except (OSError, struct.error) as error:
            self.close()
            raise ArmLostError(f"no answer from the registers of the controller at {self._address}: {error}") from error
        if answered & REFUSED:
            raise RobotError(
                f"the controller at {self._address} keeps no registers for its users (Modbus {content[0]})"
            )
        return content

    def _connected(self) -> socket.socket:
        if self._socket is None:
            if self._is_local and UNIX_SOCKET.exists():
                self._socket = socket.socket(socket.AF_UNIX)
                self._socket.settimeout(TIMEOUT_S)
                self._socket.connect(str(UNIX_SOCKET))
            else:
                self._socket = socket.create_connection((self._address, PORT), TIMEOUT_S)
            self._socket.settimeout(TIMEOUT_S)
        return self._socket

    @staticmethod
    def _receive(connection: socket.socket, count: int) -> bytes:
        content = b""
        while len(content) < count:
            part = connection.recv(count - len(content))
            if not part:
                raise ConnectionResetError("the connection was closed")
            content += part
        return content
