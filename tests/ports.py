"""Ports of the loopback interface that nobody listens on now."""

import socket


def free_udp_port() -> int:
    """A UDP port."""
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def free_tcp_port() -> int:
    """A TCP port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def free_endpoint() -> str:
    """A TCP port, as zenoh writes it."""
    return f"tcp/127.0.0.1:{free_tcp_port()}"
