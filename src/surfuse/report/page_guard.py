"""Who may look at a page of this computer: only pages that came from it, under its own names.

A page of the network may make a browser ask any address, this computer's too, and by DNS rebinding its own name may
lead here. The browser then says where the question comes from (`Origin`) and which name was asked (`Host`): a question
with a foreign one is answered by 403, before anything is read or sent.
"""

from __future__ import annotations

import http
from collections.abc import Sequence
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")

POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob: data:; manifest-src 'self'; connect-src 'self' ws://127.0.0.1:* ws://localhost:* "
    "data: blob:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""What the browser may do with the page: ask this server alone, and never inside another page."""


def refusal(host: Sequence[str], origin: Sequence[str]) -> str | None:
    """Why a request with these `Host` and `Origin` headers is refused; None when it is not.

    The port is free: a tunnel (`ssh -L`) may have another one at its near end. A page may ask only the server that it
    came from, so an origin has to be that of the host, port included. A request without an origin is not one of a
    page's scripts.
    """
    if len(host) != 1 or _name_of(host[0]) not in NAMES:
        return f"Host {', '.join(host)[:80]!r} is not this computer: open http://{LOOPBACK} with the port"
    if origin and (len(origin) != 1 or origin[0].lower() != f"http://{host[0].lower()}"):
        return f"Origin {', '.join(origin)[:80]!r} is not this page"
    return None


def _name_of(host: str) -> str:
    """The name in a `Host` header, empty when it is no name with an optional port."""
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port
    except ValueError:
        return ""
    return (parts.hostname or "") if parts.netloc == host and "@" not in host else ""


def refused(request: Request) -> Response | None:
    """The answer to a request that is refused, None for one that may go on."""
    why = refusal(request.headers.get_all("Host"), request.headers.get_all("Origin"))
    if why is None:
        return None
    body = f"{why}\n".encode("utf-8", "replace")
    status = http.HTTPStatus.FORBIDDEN
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)


def guard_answer(response: Response) -> None:
    """Tell the browser what it may do with the answer."""
    response.headers["Content-Security-Policy"] = POLICY
    response.headers["X-Frame-Options"] = "DENY"
    response.headers["X-Content-Type-Options"] = "nosniff"
    response.headers["Cross-Origin-Resource-Policy"] = "same-origin"
    response.headers["Referrer-Policy"] = "no-referrer"
