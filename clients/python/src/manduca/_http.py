"""JSON over HTTP by the standard library, and nothing about studies.

Every call of the interface may be repeated without harm, so one that found nobody or a
coordinator which is just restarting is tried again a few times.
"""

from __future__ import annotations

import ipaddress
import json
import ssl
import time
from contextlib import contextmanager
from http.client import HTTPException, HTTPResponse
from typing import TYPE_CHECKING, Any, NoReturn
from urllib.error import HTTPError, URLError
from urllib.parse import urlencode, urlsplit
from urllib.request import HTTPRedirectHandler, ProxyHandler, Request, build_opener

from manduca.errors import PASSING, URN, ForeignAnswerError, Problem, ProblemError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_PAUSES_S = (0.2, 0.5, 1.0)
_LONGEST_PAUSE_S = 10.0
_SHOWN = 120


class _StayHere(HTTPRedirectHandler):
    """A token is for one address: redirections are reported, not followed."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        return None


class Transport:
    """Calls one coordinator."""

    def __init__(self, url: str, token: str | None, timeout_s: float) -> None:
        """Check the address; nothing is sent yet."""
        parts = urlsplit(url)
        if parts.scheme not in {"http", "https"} or not parts.hostname:
            raise ValueError(f"`{url}` is no address of a coordinator; write it like http://127.0.0.1:8080")
        self.url = url.rstrip("/")
        self._token = token
        self._timeout_s = timeout_s
        # A proxy cannot reach our own loopback, whatever HTTP_PROXY says.
        proxies = ProxyHandler({} if _is_loopback(parts.hostname) else None)
        self._opener = build_opener(_StayHere(), proxies)

    def call(self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None) -> Any:
        """Send JSON and read the JSON answer."""
        with self._answer(method, path, body, {"accept": "application/json", **(headers or {})}) as answer:
            text = answer.read()
        try:
            return json.loads(text)
        except ValueError as error:
            said = f"{answer.reason}, no JSON: {_plain_text(text)}"
            raise ForeignAnswerError(self.url + path, answer.status, said) from error

    def get(self, path: str, **query: Any) -> Any:
        """Read JSON; arguments which are None are left out."""
        given = {name: value for name, value in query.items() if value is not None}
        return self.call("GET", f"{path}?{urlencode(given)}" if given else path)

    @contextmanager
    def stream(self, path: str, media_type: str) -> Iterator[HTTPResponse]:
        """Open an answer which may be larger than memory, to be read piece by piece."""
        with self._answer("GET", path, None, {"accept": media_type}) as answer:
            if answer.headers.get_content_type() != media_type:
                said = f"{answer.reason}, {answer.headers.get_content_type()} in place of {media_type}"
                raise ForeignAnswerError(self.url + path, answer.status, said)
            yield answer

    @contextmanager
    def _answer(
        self, method: str, path: str, body: Any, headers: Mapping[str, str]
    ) -> Iterator[HTTPResponse]:
        request = Request(self.url + path, method=method, headers=dict(headers))
        if body is not None:
            request.data = json.dumps(body, allow_nan=False, default=_plain).encode()
            request.add_header("content-type", "application/json")
        if self._token:
            request.add_header("authorization", f"Bearer {self._token}")
        try:
            with self._patiently(request) as answer:
                yield answer
        except (HTTPException, OSError) as error:
            raise UnreachableError(
                f"the answer of {self.url}{path} broke off: {error!r}\n  -> ask again"
            ) from error

    def _patiently(self, request: Request) -> HTTPResponse:
        for pause_s in (*_PAUSES_S, None):
            try:
                answer: HTTPResponse = self._opener.open(request, timeout=self._timeout_s)
            except HTTPError as error:
                with error:
                    if error.code not in PASSING or pause_s is None:
                        _refuse(error, request.full_url)
                    time.sleep(max(pause_s, _asked_to_wait_s(error)))
            except (URLError, HTTPException, OSError) as error:
                if pause_s is None:
                    raise UnreachableError(self._nobody(error)) from error
                time.sleep(pause_s)
            else:
                return answer
        raise AssertionError  # the last round returns or raises

    def _nobody(self, error: Exception) -> str:
        why = error.reason if isinstance(error, URLError) else error
        if isinstance(why, ssl.SSLCertVerificationError):
            advice = (
                "name the PEM file of its authority, or its own, in SSL_CERT_FILE; use a name it is made for"
            )
            return f"the certificate of {self.url} is not accepted: {why.verify_message}\n  -> {advice}"
        advice = "start one with `manduca serve`, or give its address"
        return f"no coordinator answers at {self.url}: {why}\n  -> {advice}"


def _refuse(error: HTTPError, url: str) -> NoReturn:
    """Raise the coordinator's refusal, or say that it is none."""
    try:
        text = error.read()
    except (HTTPException, OSError):
        text = b""
    document: Any = None
    if "json" in error.headers.get("content-type", ""):
        try:
            document = json.loads(text)
        except ValueError:
            document = None
    if isinstance(document, dict) and _is_a_coordinators(document, error.code):
        raise ProblemError.of(Problem.read(document, error.code)) from None
    to = error.headers.get("location", "")
    said = f"to {to}, which is not followed: a token is for one address" if to else _plain_text(text)
    raise ForeignAnswerError(url, error.code, f"{error.reason}: {said}" if said else error.reason) from None


def _is_a_coordinators(document: Mapping[str, Any], status: int) -> bool:
    return str(document.get("type", "")).startswith(URN) and document.get("status", status) == status


def _plain_text(text: bytes) -> str:
    """Put the beginning of a stranger's text into one line a terminal can show."""
    words = "".join(c if c.isprintable() else " " for c in text.decode("utf-8", "replace")).split()
    return " ".join(words)[:_SHOWN]


def _asked_to_wait_s(error: HTTPError) -> float:
    said = error.headers.get("retry-after", "")
    return min(float(said), _LONGEST_PAUSE_S) if said.isdecimal() else 0.0


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _plain(value: Any) -> Any:
    """Make a number of another library, such as numpy's, one of JSON's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be sent as JSON")
