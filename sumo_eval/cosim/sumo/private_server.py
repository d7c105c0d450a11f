"""A sumo process that is a TraCI server, out of reach of every network.

SUMO listens for its clients on all interfaces, and no option changes that. So, on Linux, it starts
in a network namespace of its own, which has nothing but a loopback interface: SUMO cannot be
reached from outside. The child process makes the harness's sockets in that namespace before it
becomes sumo, and sends them here. The user's program connects to a relay, which listens on this
machine's loopback interface and takes one connection.

Where a namespace is not available (other systems, containers that forbid it) SUMO's port is open to
the network. The harness connects both clients as soon as SUMO listens, and SUMO takes no third one.
So a stranger that connects later is never served. A stranger that connects earlier takes a client's
place, which ends the case.

Users: `cosim/doors/traci_program.py`.
"""

import ctypes
import os
import re
import select
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import IO

from sumo_eval.cosim.sumo.sumo_files import EGO

LOOPBACK = "127.0.0.1"
CLIENTS = 2  # the harness, and the relay of the user's program
# numbers of Linux's sched.h and if.h
_NEW_USERS, _NEW_NETWORK = 0x10000000, 0x40000000  # CLONE_NEWUSER, CLONE_NEWNET
_SET_FLAGS, _UP_AND_RUNNING = 0x8914, 0x1 | 0x40  # SIOCSIFFLAGS; IFF_UP, IFF_RUNNING
_WORD = b"made"  # the message that comes with the child's sockets
# a TraCI message: its length (4 bytes), the command's length (1 byte), the command (1 byte)
_COMMAND = slice(5, 6)
_SET_ORDER = b"\x03"
_STEP = b"\x02"
# A message to the ego (0xc4) of setSpeed, slowDown, setAcceleration or setPreviousSpeed with nan or
# infinity, directly or in a compound (0x0f): a double (0x0b) whose exponent has all bits set.
_NO_NUMBER = re.compile(
    rb".{5}\xc4[\x40\x14\x72\x3c]\0\0\0\x03"
    + EGO.encode()
    + rb"(\x0f.{4}(\x0b.{8})*)?\x0b[\x7f\xff][\xf0-\xff]",
    re.DOTALL,
)
# request to close, and its answer
_CLOSE = b"\0\0\0\x06\x02\x7f"
_CLOSED = b"\0\0\0\x0b\x07\x7f" + bytes(5)


class PrivateServer:
    """A server's process, and its two clients' sockets.

    command: that starts sumo. port: on which it listens.
    output: file that receives what it prints.
    isolated: whether it has a network namespace of its own.
    """

    def __init__(self, command: Sequence[str], port: int, output: IO[bytes]) -> None:
        on_linux = sys.platform == "linux"
        own_end, childs_end = socket.socketpair()
        with own_end, childs_end:
            self.process = subprocess.Popen(
                list(command), stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                preexec_fn=partial(_enter_own_network, childs_end) if on_linux else None,
            )  # fmt: skip
            childs_end.close()  # else `recv_fds` waits for ever if the child sends nothing
            word = b""
            handles: list[int] = []
            if on_linux:
                word, handles = socket.recv_fds(own_end, len(_WORD), CLIENTS)[:2]
        self.isolated = word == _WORD and len(handles) == CLIENTS
        self.sockets = [socket.socket(fileno=handle) for handle in handles] or [
            socket.socket() for _ in range(CLIENTS)
        ]
        self._to_connect = list(self.sockets)
        self._port = port

    def connect(self) -> None:
        """Connect both clients, one directly after the other.

        Raises OSError while the server does not listen yet; the next call continues.
        """
        while self._to_connect:
            self._to_connect[0].connect((LOOPBACK, self._port))
            self._to_connect.pop(0).setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def end(self) -> None:
        """End the process and its connections."""
        for connection in self.sockets:
            with suppress(OSError):  # it was not connected, or is closed
                connection.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits for it
        self.process.kill()
        self.process.wait()
        self.sockets[0].close()  # the other one is the relay's to close


class Relay:
    """Listens on the loopback interface for one client, and passes on the messages between client
    and server.

    server: connected socket of the server's second client.
    has_asked, has_order: whether the client has asked for a step, and whether it has set its order.
    has_erred: whether it has given the ego a speed that is not finite, or the like.
    has_left: whether the client has asked to close its connection. The relay does not pass that on,
        because SUMO would continue with one client less. It closes both connections, so that SUMO
        ends at the next step.

    For how long a client may take to connect: `doors/traci_program.py`.
    """

    has_asked = has_order = has_erred = has_left = False

    def __init__(self, server: socket.socket) -> None:
        self._listener = socket.create_server((LOOPBACK, 0), backlog=1)
        self.port = self._listener.getsockname()[1]
        self._server = server
        threading.Thread(target=self._run, daemon=True).start()

    def end(self) -> None:
        """Listen no more."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits for a client

    def _run(self) -> None:
        """Wait for the client, then pass on messages until one side is gone."""
        with self._server, suppress(OSError):  # either side may be gone at any time
            with self._listener:
                client, _ = self._listener.accept()
            with client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                opposite = {client: self._server, self._server: client}
                tail = b""
                while True:
                    for side in select.select(list(opposite), [], [])[0]:
                        data = side.recv(65_536)
                        if side is client:
                            tail = (tail + data)[-len(_CLOSE) :]  # `_CLOSE` may come in pieces
                            self.has_left = not data or tail == _CLOSE
                            self.has_asked |= data[_COMMAND] == _STEP
                            self.has_order |= data[_COMMAND] == _SET_ORDER
                            self.has_erred |= _NO_NUMBER.match(data) is not None
                        if self.has_left:
                            client.sendall(_CLOSED)
                        if self.has_left or not data:
                            return
                        opposite[side].sendall(data)


def _enter_own_network(report: socket.socket) -> None:
    """Give this process a network of its own, and send sockets of that network to `report`.

    A child process runs it before it becomes the server.
    """
    # where a namespace is not allowed, `PrivateServer` receives no sockets and makes its own
    with suppress(OSError):
        user = os.geteuid()
        group = os.getegid()
        if ctypes.CDLL(None, use_errno=True).unshare(_NEW_USERS | _NEW_NETWORK) != 0:
            return
        for name, text in {  # the child keeps its user and group
            "uid_map": f"{user} {user} 1",
            "setgroups": "deny",
            "gid_map": f"{group} {group} 1",
        }.items():
            with suppress(OSError), open(f"/proc/self/{name}", "w") as file:
                file.write(text)
        _start_loopback()
        sockets = [socket.socket() for _ in range(CLIENTS)]
        socket.send_fds(report, [_WORD], [connection.fileno() for connection in sockets])


def _start_loopback() -> None:
    """Start the loopback interface of this process's network, on Linux."""
    import fcntl

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        # `struct ifreq`: the interface's name, its flags, padding
        request = struct.pack("16sh14x", b"lo", _UP_AND_RUNNING)
        fcntl.ioctl(any_socket, _SET_FLAGS, request)
