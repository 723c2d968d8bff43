"""Standard Modbus TCP on the command port: the holding registers that the control box leaves to its users.

UFACTORY's "UF_ModbusTCP_Manual" (in xArm-Python-SDK, doc/) calls holding registers 256 to 511 "general purpose, user
defined"; every client of the box reads what any other wrote. Nothing else of that manual is emulated: other addresses
and functions are refused with the exception codes of the Modbus specification, and named once in the log.
"""

import logging
import struct

log = logging.getLogger("xarm_emulator")

FIRST, COUNT = 0x100, 0x100

READ_HOLDING = 0x03
WRITE_ONE = 0x06
WRITE_SEVERAL = 0x10
LARGEST_READ, LARGEST_WRITE = 125, 123
"""Registers in one request, Modbus Application Protocol 1.1b3, sections 6.3 and 6.12."""

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


class RefusedRequestError(Exception):
    """A request that is answered with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class HoldingRegisters:
    """The user-defined holding registers, zero at power-up."""

    def __init__(self) -> None:
        self._values = [0] * COUNT
        self._named: set[str] = set()

    def answer(self, pdu: bytes) -> bytes:
        """The reply to one request, both without the header: function code and what follows it."""
        function = pdu[0] if pdu else 0
        try:
            return self._carry_out(function, pdu)
        except struct.error:
            return bytes([function | 0x80, ILLEGAL_VALUE])
        except RefusedRequestError as refusal:
            return bytes([function | 0x80, refusal.code])

    def _carry_out(self, function: int, pdu: bytes) -> bytes:
        if function == READ_HOLDING:
            _, address, count = struct.unpack(">BHH", pdu)
            start = self._place(address, count, LARGEST_READ)
            return struct.pack(f">BB{count}H", function, 2 * count, *self._values[start : start + count])
        if function == WRITE_ONE:
            _, address, value = struct.unpack(">BHH", pdu)
            self._values[self._place(address, 1, 1)] = value
            return pdu
        if function == WRITE_SEVERAL:
            _, address, count, size = struct.unpack_from(">BHHB", pdu)
            start = self._place(address, count, LARGEST_WRITE)
            if size != 2 * count:
                raise RefusedRequestError(ILLEGAL_VALUE)
            self._values[start : start + count] = struct.unpack(f">{count}H", pdu[6:])
            return pdu[:5]
        self._name(f"Modbus function {function}")
        raise RefusedRequestError(ILLEGAL_FUNCTION)

    def _place(self, address: int, count: int, most: int) -> int:
        """Index of the first of `count` registers from an address on."""
        if not 1 <= count <= most:
            raise RefusedRequestError(ILLEGAL_VALUE)
        if not FIRST <= address <= FIRST + COUNT - count:
            self._name(f"Modbus holding register {address if address < FIRST else address + count - 1}")
            raise RefusedRequestError(ILLEGAL_ADDRESS)
        return address - FIRST

    def _name(self, what: str) -> None:
        if what not in self._named:
            self._named.add(what)
            log.warning("%s is not emulated", what)
