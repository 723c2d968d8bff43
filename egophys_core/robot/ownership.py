"""One owner of an arm: a lock on this machine, and a note on the control box that every other machine sees.

The note carries a random token, a counter that its owner raises twice a second, and the owner's name. Whoever finds a
counter that rises stays away; one that stands still was left by a process that was killed. Two that come at once both
write, wait longer than a write takes and look whose token stands: Fischer's algorithm (L. Lamport, A fast mutual
exclusion algorithm, ACM Trans. Computer Systems 5 (1987) 1).
"""

import fcntl
import os
import secrets
import socket
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from egophys_core.errors import ArmLostError, RobotError
from egophys_core.robot.arm_driver import ArmDriver

MARK = 0xE60F
"""First number of a note; zeros are no note."""
TOKEN_SIZE, NAME_SIZE = 4, 26
"""Numbers of 16 bits; a name has two characters in each."""
NOTE_SIZE = 2 + TOKEN_SIZE + NAME_SIZE
RENEW_PERIOD_S = 0.5
"""How often an owner raises its counter."""
ABANDONED_S = 2.0
"""A counter that stood still for so long has no owner; an owner that has not raised it for so long must not move."""
WRITE_S = 0.3
"""Longer than a write takes to reach the control box."""


class ArmTakenError(RobotError):
    """Another process, here or elsewhere, owns the arm."""


class Ownership:
    """The right to move an arm, held by one process at a time."""

    def __init__(self, driver: ArmDriver, serial: str, name: str) -> None:
        """Own nothing yet.

        Args:
            driver: connected to the arm.
            serial: of the arm.
            name: of who wants it, for those who come later; this machine's name and the process are added.
        """
        self._driver = driver
        self._serial = serial
        self._name = f"{name} (process {os.getpid()} on {socket.gethostname()})"
        self._token = [1 + secrets.randbelow(0xFFFF) for _ in range(TOKEN_SIZE)]
        self._beat = 0
        self._renewed = float("-inf")
        self._lock: int | None = None
        self.is_seen_elsewhere = False
        """Whether other machines see it: not every control box keeps notes."""
        self.abandoned_by = ""
        """The last owner, if it left without saying so, as when it was killed."""

    def acquire(self, *, sleep: Callable[[float], object] = time.sleep) -> None:
        """Become the owner.

        Raises:
            ArmTakenError: another process owns it; says which.
            RobotError: the arm does not answer.
        """
        self._lock_here()
        try:
            self._note_there(sleep)
        except RobotError:
            self.release()
            raise

    def renew(self) -> None:
        """Stay the owner; to be called every `RENEW_PERIOD_S`.

        Raises:
            ArmTakenError: another process has taken the arm.
            ArmLostError: the arm does not answer.
        """
        if self.is_seen_elsewhere:
            self._require_ours(self._read())
            self._write()
        self._renewed = time.monotonic()

    def require(self) -> None:
        """Check that nobody else can have become the owner meanwhile.

        Raises:
            ArmTakenError: it was not renewed for too long, as when this process was stopped.
        """
        silent = time.monotonic() - self._renewed
        if silent > ABANDONED_S:
            raise ArmTakenError(
                f"this process has not told the arm with serial {self._serial} for {silent:.1f} s that it owns it, and "
                "another may have taken it; send the plan again"
            )

    def release(self) -> None:
        """Own it no longer."""
        if self.is_seen_elsewhere:
            self.is_seen_elsewhere = False
            try:
                if self._token_of(self._read()) == self._token:
                    self._driver.write_note([0] * NOTE_SIZE)
            except RobotError:
                pass  # the note is abandoned; who comes next waits until that is certain
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _lock_here(self) -> None:
        if self._lock is not None:
            return
        path = Path(tempfile.gettempdir()) / f"egophys-arm-{self._serial}.lock"
        try:
            # Another user's file may be read, which is enough to lock it.
            lock = os.open(path, os.O_RDONLY if path.exists() else os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise RobotError(f"cannot open the arm's lock {path}: {error.strerror}; remove that file") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            raise ArmTakenError(
                f"the arm with serial {self._serial} is driven by another process of this machine; its note says "
                f"{self._owner()}; end that one first"
            ) from None
        self._lock = lock

    def _owner(self) -> str:
        try:
            return self._name_of(self._driver.read_note(NOTE_SIZE)) or "nothing yet"
        except RobotError:
            return "nothing"

    def _note_there(self, sleep: Callable[[float], object]) -> None:
        try:
            before = self._read()
        except ArmLostError:
            raise
        except RobotError:  # a box without notes
            self.is_seen_elsewhere, self._renewed = False, time.monotonic()
            return
        if before[0] == MARK and self._token_of(before) != self._token:
            sleep(ABANDONED_S)
            if (now := self._read()) != before and now[0] == MARK:
                raise self._taken(now)
            self.abandoned_by = self._name_of(before)
        self._write()
        sleep(WRITE_S)
        self._require_ours(self._read())
        self.is_seen_elsewhere, self._renewed = True, time.monotonic()

    def _require_ours(self, note: list[int]) -> None:
        # A control box that was started anew has forgotten the note.
        if note[0] == MARK and self._token_of(note) != self._token:
            raise self._taken(note)

    def _taken(self, note: list[int]) -> ArmTakenError:
        return ArmTakenError(
            f"the arm with serial {self._serial} is driven by {self._name_of(note)}; end that one first"
        )

    def _read(self) -> list[int]:
        return self._driver.read_note(NOTE_SIZE)

    def _write(self) -> None:
        self._beat = (self._beat + 1) % 65536
        text = self._name.encode("ascii", "replace")[: 2 * NAME_SIZE].ljust(2 * NAME_SIZE, b"\0")
        name = [text[place] << 8 | text[place + 1] for place in range(0, len(text), 2)]
        self._driver.write_note([MARK, self._beat, *self._token, *name])

    @staticmethod
    def _token_of(note: list[int]) -> list[int]:
        return note[2 : 2 + TOKEN_SIZE]

    @staticmethod
    def _name_of(note: list[int]) -> str:
        text = b"".join(number.to_bytes(2, "big") for number in note[2 + TOKEN_SIZE :])
        return text.rstrip(b"\0").decode("ascii", "replace")
