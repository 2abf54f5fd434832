"""Client that fetches one answer of a web server, within limits of size and time.

A server may be slow, end in the middle, send a web page or a decompression bomb, or redirect in
circles. Each fault is one sentence, without any secret of the address. No request is repeated.
"""

import base64
import contextlib
import http.client
import socket
import ssl
import threading
import time
import urllib.error
import urllib.request
import zlib
from collections.abc import Mapping
from http.cookiejar import CookieJar
from typing import IO, Any, Literal
from urllib.parse import parse_qsl, quote_plus, unquote, urlencode, urlsplit, urlunsplit

from rsoconsole import __version__
from rsoconsole.base import OrbitError
from rsoconsole.config import without_secrets
from rsoconsole.orbits import gunzipped, remark_of

MAX_BYTES = 64 << 20
"""Largest size of one unpacked answer; the whole catalogue has a third of it."""
MAX_REDIRECTS = 5
DEADLINE_S = 180.0
SILENT_S = 30.0
_CHUNK = 1 << 16
_MAX_OF_A_REFUSAL, _SHORTEST_SECRET = 4096, 3
_REFUSALS = {401, 403, 429, 451}

FaultKind = Literal["refused", "unreachable", "failed"]


class FetchError(OrbitError):
    """No usable answer from a server; ``kind`` says what may be done.

    - "refused": the request must not be repeated without the operator.
    - "unreachable": the server never received the request.
    - "failed": any other fault.
    """

    def __init__(self, words: str, kind: FaultKind, is_answer: bool = False) -> None:
        """``is_answer``: ``words`` begin with a verb, to follow the server's name in a sentence."""
        super().__init__(words)
        self.kind: FaultKind = kind
        self.is_answer = is_answer


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Handler of redirects: a few, never from https to http, with an account to no other host."""

    max_redirections = MAX_REDIRECTS
    max_repeats = 2

    def __init__(self, *, is_bound: bool) -> None:
        self._is_bound = is_bound

    def redirect_request(  # noqa: PLR0917 - urllib's own signature
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: Any,
        newurl: str,
    ) -> urllib.request.Request | None:
        old, new = urlsplit(req.full_url), urlsplit(newurl)
        is_other = (old.scheme, old.netloc) != (new.scheme, new.netloc)
        if self._is_bound and is_other:
            words = "an account is shown to one host only"
        elif new.scheme not in {"http", "https"} or (old.scheme, new.scheme) == ("https", "http"):
            words = "which is not followed"
        else:
            return super().redirect_request(req, fp, code, msg, headers, newurl)
        fp.close()
        raise FetchError(f"it sends on to {without_secrets(newurl)}: {words}", "failed")


class Fetcher:
    """Client for web servers; cookies of a login are kept for as long as this object exists."""

    def __init__(self, *, deadline_s: float = DEADLINE_S, is_bound: bool = False) -> None:
        self._deadline_s = deadline_s
        self._opener = urllib.request.build_opener(
            _Redirects(is_bound=is_bound), urllib.request.HTTPCookieProcessor(CookieJar())
        )

    def get(self, url: str, *, form: Mapping[str, str] | None = None) -> bytes:
        """Return the body of an answer, unpacked where it came as gzip. ``form``: sent by POST.

        Raises FetchError, whose message never holds a secret of the address or the form.
        """
        done: list[bytes | BaseException] = []
        began = time.monotonic()

        def work() -> None:
            try:
                done.append(self._get(url, form, began + self._deadline_s))
            except BaseException as error:
                done.append(error)

        # A name server, or a head that comes byte by byte, is past every time-out of a socket.
        worker = threading.Thread(target=work, daemon=True, name="fetch")
        worker.start()
        worker.join(self._deadline_s + 1.0)
        where = without_secrets(url)
        if not done:
            raise FetchError(f"{where} took longer than {self._deadline_s:.0f} s", "failed")
        if isinstance(done[0], BaseException):
            raise _fault(done[0], where, self._deadline_s) from None
        return done[0]

    def _get(self, url: str, form: Mapping[str, str] | None, deadline: float) -> bytes:
        plain, login = _without_login(url)
        request = urllib.request.Request(
            plain,
            data=None if form is None else urlencode(form).encode(),
            headers={
                "User-Agent": f"rsoconsole/{__version__}",
                "Accept-Encoding": "gzip",
                "Accept": "application/json, text/plain, */*",
            },
        )
        if login is not None:
            # Not sent along when the server sends on to another.
            request.add_unredirected_header("Authorization", f"Basic {login}")
        timeout_s = min(SILENT_S, self._deadline_s)
        try:
            with contextlib.closing(self._opener.open(request, timeout=timeout_s)) as answer:
                return _body(answer, deadline)
        except urllib.error.HTTPError as error:
            why = without_secrets_of(url, _reason(error), form)
            raise FetchError(*_answer_fault(error.code, why)) from None


def _without_login(url: str) -> tuple[str, str | None]:
    """Return the address without its login, and the login encoded for HTTP."""
    parts = urlsplit(url)
    login, at, host = parts.netloc.rpartition("@")
    if not at:
        return url, None
    packed = base64.b64encode(unquote(login).encode()).decode()
    return urlunsplit(parts._replace(netloc=host)), packed


def _body(answer: Any, deadline: float) -> bytes:
    announced = answer.headers.get("Content-Length")
    is_packed = answer.headers.get("Content-Encoding", "").strip().lower() == "gzip"
    got, parts = 0, list[bytes]()
    while chunk := answer.read1(_CHUNK):
        got += len(chunk)
        if got > MAX_BYTES:
            raise FetchError(f"it sends more than {MAX_BYTES >> 20} MB", "failed")
        parts.append(chunk)
        if time.monotonic() > deadline:
            raise TimeoutError
    cut_off = FetchError(f"its answer ended after {got} bytes, before it was whole", "failed")
    if announced is not None and announced.isdecimal() and got < int(announced):
        raise cut_off
    if not is_packed:
        return b"".join(parts)
    try:
        plain = gunzipped(b"".join(parts), MAX_BYTES)
    except EOFError as error:
        raise cut_off from error
    if len(plain) > MAX_BYTES:
        raise FetchError(f"it sends more than {MAX_BYTES >> 20} MB", "failed")
    return plain


def _fault(error: BaseException, where: str, deadline_s: float) -> FetchError:
    if isinstance(error, FetchError):
        return FetchError(f"{where}{'' if error.is_answer else ':'} {error}", error.kind)
    reason: object = error.reason if isinstance(error, urllib.error.URLError) else error
    if isinstance(reason, TimeoutError):
        silent_s = min(SILENT_S, deadline_s)
        words = f"{where} was silent for {silent_s:.0f} s or took longer than {deadline_s:.0f} s"
        return FetchError(words, "failed")
    if isinstance(reason, ssl.SSLError):
        return FetchError(f"{where} cannot be trusted ({reason.reason or 'TLS'})", "failed")
    if isinstance(error, urllib.error.URLError) and isinstance(reason, OSError):
        is_name = isinstance(reason, socket.gaierror)
        words = "no such name" if is_name else reason.strerror or type(reason).__name__
        return FetchError(
            f"{where} cannot be reached ({words}): is there a network?", "unreachable"
        )
    return FetchError(
        f"{where} broke off its answer ({type(reason).__name__}), before it was whole", "failed"
    )


def _answer_fault(status: int, why: str) -> tuple[str, FaultKind, bool]:
    because = f": {why}" if why else ""
    if status in _REFUSALS:
        return f"refuses ({status}){because}", "refused", True
    if 300 <= status < 400:
        return f"sends on in circles ({status})", "failed", True
    hint = ": is its name right?" if status == 404 else because
    return f"answers with fault {status}{hint}", "failed", True


def _reason(error: urllib.error.HTTPError) -> str:
    """Server's reason for a refusal; empty where its answer holds none."""
    try:
        with contextlib.closing(error):
            content = error.read(_MAX_OF_A_REFUSAL)
        if (error.headers.get("Content-Encoding") or "").strip().lower() == "gzip":
            content = zlib.decompressobj(wbits=31).decompress(content, _MAX_OF_A_REFUSAL)
    except (OSError, http.client.HTTPException, zlib.error):
        return ""
    return remark_of(content.decode("utf-8", "replace")) if content.strip() else ""


def without_secrets_of(url: str, words: str, form: Mapping[str, str] | None = None) -> str:
    """Return words of a server without what its address and a form keep secret."""
    for secret in sorted(_secrets(url, form), key=len, reverse=True):
        words = words.replace(secret, "...")
    return words


def _secrets(url: str, form: Mapping[str, str] | None) -> frozenset[str]:
    """Return the secrets of an address and a form that a server may repeat, plain and quoted."""
    parts = urlsplit(url)
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    plain = [parts.username, parts.password, parts.query, *(form or {}).values()]
    plain += [unquote(each) for each in plain if each] + [value for _, value in pairs]
    plain += [quote_plus(each) for each in plain if each]
    return frozenset(each for each in plain if each and len(each) >= _SHORTEST_SECRET)
