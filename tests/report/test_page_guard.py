"""Foreign pages get nothing: neither by a name that leads here, nor from a page of somewhere else."""

import base64
import os
import socket

import pytest

from surfuse.report.content import ReportContent
from surfuse.report.page_guard import refusal
from surfuse.report.viewer import opened


@pytest.fixture(scope="module")
def port(run_content):
    with opened(run_content, 0) as address:
        yield int(address.rsplit(":", 1)[1])


def ask(port, *lines):
    """Status line, headers and the first bytes of the body of a raw request."""
    with socket.create_connection(("127.0.0.1", port), timeout=300) as link:
        link.sendall("\r\n".join(("GET / HTTP/1.1", *lines, "", "")).encode("latin-1"))
        heard = b""
        while b"\r\n\r\n" not in heard:
            piece = link.recv(4096)
            if not piece:
                break
            heard += piece
    head, _, body = heard.partition(b"\r\n\r\n")
    return head.decode("latin-1"), body


def upgrade():
    import viser

    key = base64.b64encode(os.urandom(16)).decode()
    return (
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Key: {key}",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
    )


FOREIGN = [
    ("Host: evil.example",),
    ("Host: evil.example:{port}",),
    ("Host: 127.0.0.1.evil.example:{port}",),
    ("Host: localhost.evil.example",),
    ("Host: 127.0.0.1@evil.example",),
    ("Host: 0.0.0.0:{port}",),
    ("Host: ",),
    (),
    ("Host: 127.0.0.1:{port}", "Host: evil.example"),
    ("Host: 127.0.0.1:{port}", "Origin: https://evil.example"),
    ("Host: 127.0.0.1:{port}", "Origin: http://evil.example:{port}"),
    ("Host: 127.0.0.1:{port}", "Origin: null"),
    ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:3000"),
    ("Host: 127.0.0.1:{port}", "Origin: https://127.0.0.1:{port}"),
    ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:{port}", "Origin: http://evil.example"),
]
OWN = [
    ("Host: 127.0.0.1:{port}",),
    ("Host: localhost:{port}", "Origin: http://localhost:{port}"),
    ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:{port}"),
    ("Host: localhost:9000", "Origin: http://localhost:9000"),
]


@pytest.mark.parametrize("socketed", [False, True], ids=["http", "websocket"])
@pytest.mark.parametrize("lines", FOREIGN, ids=lambda lines: " ".join(lines) or "no host")
def test_foreign_host_or_origin_gets_403_and_no_content(port, lines, socketed):
    head, body = ask(port, *(line.format(port=port) for line in lines), *(upgrade() if socketed else ()))
    assert head.startswith("HTTP/1.1 403 ")
    assert b"<html" not in body
    assert "Upgrade" not in head


@pytest.mark.parametrize("lines", OWN, ids=" ".join)
def test_own_page_and_a_tunnel_are_served(port, lines):
    named = [line.format(port=port) for line in lines]
    head, _ = ask(port, *named)
    assert head.startswith("HTTP/1.1 200 ")
    assert "default-src 'none'" in head
    assert "frame-ancestors 'none'" in head
    assert ask(port, *named, *upgrade())[0].startswith("HTTP/1.1 101 ")


def test_refusal_names_the_header_and_does_not_repeat_a_long_one():
    assert "'evil.example'" in str(refusal(["evil.example"], []))
    assert "Origin 'http://a'" in str(refusal(["localhost:1"], ["http://a"]))
    assert len(str(refusal(["x" * 5000], []))) < 300


def test_nonsense_on_the_port_is_no_word_on_the_terminal(capfd):
    with opened(ReportContent(title="x"), 0) as address:
        port = int(address.rsplit(":", 1)[1])
        with socket.create_connection(("127.0.0.1", port), timeout=300) as link:
            link.sendall(b"\x16\x03\x01\x00\xff nonsense\r\n\r\n")
            while link.recv(4096):
                pass
        assert ask(port, f"Host: 127.0.0.1:{port}")[0].startswith("HTTP/1.1 200 ")
    heard = capfd.readouterr()
    assert (heard.out, heard.err) == ("", "")
