"""The ports the emulator listens on and the connections to them; all of it can be cut and come back."""

import asyncio
import contextlib
import logging
import socket
import struct
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

log = logging.getLogger("xarm_emulator")

UNIX_SOCKET = "/tmp/xarmcontroller_uds_{port}"
"""Where the SDK looks for a controller on the same machine before it tries TCP."""

BACKLOG = 100
RESET_ON_CLOSE = struct.pack("ii", 1, 0)
"""SO_LINGER of 0 s: closing sends a reset, as from a box that knows nothing of the connection any more."""

Service = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


class Network:
    """Listens on several ports; one service a port, called for each connection."""

    def __init__(self, services: dict[int, Service]) -> None:
        self._services = services
        self._listeners: dict[socket.socket, Service] = {}
        self._sockets: list[Path] = []
        self._serving: dict[asyncio.Task[None], asyncio.StreamWriter | None] = {}
        self._fillers: list[socket.socket] = []
        self.is_cut = False

    def open(self, host: str) -> str:
        """Start listening on TCP, or on the SDK's Unix sockets where the first port is not permitted.

        Returns where it listens, for people.

        Raises:
            OSError: the address does not exist or is taken.
        """
        first, *others = self._services
        try:
            for port, service in self._services.items():
                self._listeners[socket.create_server((host, port), backlog=BACKLOG)] = service
            where = f"{host}:{first}, reports on {', '.join(map(str, others))}"
        except PermissionError:
            for port, service in self._services.items():
                self._listeners[self._unix_listener(port)] = service
            where = (
                f"{UNIX_SOCKET.format(port='*')} because port {first} is not permitted. While it "
                "runs, the SDK on this machine connects here for every address, a real arm's included"
            )
        for listener in self._listeners:
            listener.setblocking(False)
        self._accept_from_now()
        return where

    def cut(self) -> None:
        """Leave connections open and unserved, and connecting clients without an answer.

        The caller reads on and writes nothing. A full queue of connections makes the kernel drop further ones.
        """
        self.is_cut = True
        for listener in self._listeners:
            asyncio.get_running_loop().remove_reader(listener)
            listener.listen(0)
            filler = socket.socket(listener.family, socket.SOCK_STREAM)
            filler.setblocking(False)
            filler.connect_ex(listener.getsockname())
            self._fillers.append(filler)

    def restore(self) -> None:
        """Reset the connections of before and accept new ones."""
        for writer in self._serving.values():
            if writer is not None and not writer.is_closing():
                writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET_ON_CLOSE)
                writer.transport.abort()
        for filler in self._fillers:
            filler.close()
        self._fillers.clear()
        for listener in self._listeners:
            listener.listen(BACKLOG)
        self._accept_from_now()
        self.is_cut = False

    def close(self) -> None:
        """Stop listening, drop the clients and remove the sockets."""
        for listener in self._listeners:
            asyncio.get_running_loop().remove_reader(listener)
            listener.close()
        for path in self._sockets:
            path.unlink(missing_ok=True)

    def _unix_listener(self, port: int) -> socket.socket:
        path = Path(UNIX_SOCKET.format(port=port))
        if _is_answered(path):
            raise OSError(f"another emulator listens on {path}; only one can without port 502")
        path.unlink(missing_ok=True)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listener.bind(str(path))
        self._sockets.append(path)
        listener.listen(BACKLOG)
        return listener

    def _accept_from_now(self) -> None:
        for listener, service in self._listeners.items():
            asyncio.get_running_loop().add_reader(listener, partial(self._accept, listener, service))

    def _accept(self, listener: socket.socket, service: Service) -> None:
        try:
            connection, _ = listener.accept()
        except OSError as error:  # the client is gone again, or this process has no descriptor left
            log.warning("cannot accept a connection: %s", error)
            return
        connection.setblocking(False)
        task = asyncio.get_running_loop().create_task(self._serve(connection, service))
        self._serving[task] = None
        task.add_done_callback(self._serving.pop)

    async def _serve(self, connection: socket.socket, service: Service) -> None:
        reader, writer = await asyncio.open_connection(sock=connection)
        task = asyncio.current_task()
        assert task is not None
        self._serving[task] = writer
        with contextlib.closing(writer), contextlib.suppress(ConnectionError):
            await service(reader, writer)


def _is_answered(path: Path) -> bool:
    """Whether a living process listens on a Unix socket (a killed one leaves the file)."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        return client.connect_ex(str(path)) == 0
