"""The TraCI server of `traci:` is out of reach of every network: measured in the kernel's own table
of sockets."""

import socket
import sys
import time as clock
from pathlib import Path

import pytest
from road_scenes import HALF_SECOND, case, need_sumo

from sumo_eval.cosim.doors.traci_program import sumo_binary
from sumo_eval.cosim.sumo import private_server
from sumo_eval.cosim.sumo.private_server import LOOPBACK, PrivateServer, Relay
from sumo_eval.cosim.sumo.session import command_line

if sys.platform != "linux":
    pytest.skip("the kernel's table of sockets is Linux's", allow_module_level=True)
need_sumo()

LISTENS = "0A"


def listening(table):
    """Addresses (hexadecimal, as the kernel writes them) and ports that somebody listens on."""
    rows = [
        line.split()
        for path in (table, f"{table}6")
        for line in Path(path).read_text().splitlines()[1:]
    ]
    places = [row[1].split(":") for row in rows if row[3] == LISTENS]
    return {(address, int(port, 16)) for address, port in places}


def free_port():
    with socket.create_server((LOOPBACK, 0)) as probe:
        return int(probe.getsockname()[1])


def started(tmp_path):
    port = free_port()
    command = command_line(case(), HALF_SECOND, tmp_path, tmp_path / "log", None)
    words = [sumo_binary(), *command[1:], "--remote-port", str(port), "--num-clients", "2"]
    with (tmp_path / "console").open("wb") as output:
        return PrivateServer(words, port, output), port


def connect(server):
    until = clock.monotonic() + 20.0
    while True:
        try:
            server.connect()
            return
        except OSError:
            assert clock.monotonic() < until
            clock.sleep(0.005)


def test_in_a_network_of_its_own_sumo_listens_alone(tmp_path):
    server, port = started(tmp_path)
    try:
        if not server.isolated:
            pytest.skip("this machine allows no network namespaces")
        own, until = f"/proc/{server.process.pid}/net/tcp", clock.monotonic() + 20.0
        while not any(found == port for _, found in listening(own)):
            assert clock.monotonic() < until
            clock.sleep(0.005)
        assert listening(own) == {("00000000", port)}  # on every interface, of which there is one
        assert port not in {found for _, found in listening("/proc/self/net/tcp")}
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((LOOPBACK, port), timeout=5.0)
        connect(server)
        assert [one.getpeername() for one in server.sockets] == [(LOOPBACK, port)] * 2
    finally:
        server.end()
        server.sockets[1].close()


# TraCI: 6 bytes, of which the command has 2, 0x00 asks for the version
VERSION = b"\x00\x00\x00\x06\x02\x00"


def waiting(port):
    """Connections to a listening port that nobody has taken yet, by the kernel."""
    rows = [line.split() for line in Path("/proc/self/net/tcp").read_text().splitlines()[1:]]
    return next(
        int(row[4].split(":")[1], 16)
        for row in rows
        if row[3] == LISTENS and row[1].endswith(f":{port:04X}")
    )


def test_without_one_sumo_serves_its_two_clients_and_never_a_third(tmp_path, monkeypatch):
    # as on a machine that forbids it
    monkeypatch.setattr(private_server, "_enter_own_network", lambda report: None)
    server, port = started(tmp_path)
    try:
        assert not server.isolated
        connect(server)
        first = server.sockets[0]
        first.settimeout(20.0)
        first.sendall(VERSION)
        assert first.recv(100)  # SUMO serves nobody before it has both
        assert waiting(port) == 0
        with socket.create_connection((LOOPBACK, port), timeout=5.0) as stranger:
            stranger.sendall(VERSION)
            for _ in range(3):
                first.sendall(VERSION)
                assert first.recv(100)
            assert waiting(port) == 1
    finally:
        server.end()
        server.sockets[1].close()


def test_the_relay_listens_on_loopback_only_for_one_client_and_passes_on_both_ways():
    with socket.create_server((LOOPBACK, 0)) as there:
        near = socket.create_connection(there.getsockname())
        far, _ = there.accept()
    relay = Relay(near)
    assert {address for address, port in listening("/proc/self/net/tcp") if port == relay.port} == {
        "0100007F"
    }
    with socket.create_connection((LOOPBACK, relay.port), timeout=5.0) as client, far:
        far.settimeout(5.0)
        client.sendall(b"to the server")
        assert far.recv(100) == b"to the server"
        far.sendall(b"to the client")
        assert client.recv(100) == b"to the client"
        with pytest.raises(OSError, match=r"refused|timed out|reset"):
            socket.create_connection((LOOPBACK, relay.port), timeout=1.0)
        far.shutdown(socket.SHUT_RDWR)
        assert client.recv(100) == b""  # the end of the one is the end of the other
