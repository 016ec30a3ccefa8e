"""The access keys of a panel, and the sessions that they open."""

from __future__ import annotations

import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Role = Literal["operator", "viewer"]
Carrier = Literal["link", "local page", "code"]
"""The ways in which a key comes: a printed link; the form of a page in the file system; typed by a person."""

KEY_TIME = 12 * 3600.0  # s; how long a printed link or code opens the panel
LOCAL_TIME = (
    300.0  # s; how long a local page does: over https a person may have to accept the certificate first
)
SESSION_TIME = 12 * 3600.0  # s since the session was used last
_MOST_SESSIONS = 256
_MOST_SPENT = 256
_CODE_SIGNS = "abcdefghjkmnpqrstuvwxyz23456789"  # none that looks like another
_CODE_LENGTH = (
    12  # 31^12 = 2^59: 10,000 guesses per second for 12 hours hit it once in a thousand million times
)


@dataclass(eq=False)
class Session:
    """One browser that was let in: `cookie` names it, `token` has to come with what it asks to be done.

    `role` says what it may do, and it expires at that monotonic time [s] if nothing comes from it before.
    """

    role: Role
    cookie: str
    token: str
    expires: float


@dataclass(eq=False)
class _Key:
    text: str
    role: Role
    carrier: Carrier
    expires: float


class Keys:
    """Random keys, compared in constant time, that expire; `now` is a monotonic time [s].

    A key opens a session if its own carrier brings it: a code in an address opens nothing. A viewer's session sees and may stop
    the motor, and does nothing else. The keys of links and local pages work once, as browsers keep addresses in their history;
    `used` is told of each that comes, so that a fresh link can be printed. A code works until it expires: a class comes in one
    after the other.
    """

    def __init__(
        self,
        now: Callable[[], float] = time.monotonic,
        used: Callable[[Carrier], None] = lambda carrier: None,
    ) -> None:
        self._now = now
        self._used = used
        self._keys: list[_Key] = []
        self._spent: list[str] = []
        self._sessions: list[Session] = []

    def new(self, role: Role, carrier: Carrier = "link") -> str:
        """Return a new key."""
        text = _code() if carrier == "code" else secrets.token_urlsafe(32)
        lasts = LOCAL_TIME if carrier == "local page" else KEY_TIME
        self._keys.append(_Key(text, role, carrier, self._now() + lasts))
        return text

    def open(self, text: str, carrier: Carrier = "link") -> Session | None:
        """Return a new session for a key that its carrier brings; None where it isn't one, was used, or is over."""
        if carrier == "code":
            text = _group(text)
        key = None
        for each in self._keys:
            if same(each.text, text) and each.carrier == carrier:
                key = each
        if key is None:
            return None
        if carrier != "code":
            self._keys.remove(key)
            self._spent = [*self._spent, key.text][-_MOST_SPENT:]
            self._used(carrier)
        return self._begin(key.role) if key.expires > self._now() else None

    def is_spent(self, text: str) -> bool:
        """Return whether a text was a key that works once, and was used or came too late."""
        return any(same(each, text) for each in self._spent)

    @property
    def has_code(self) -> bool:
        """Whether a code may be typed."""
        return any(key.carrier == "code" for key in self._keys)

    def _begin(self, role: Role) -> Session:
        session = Session(
            role=role,
            cookie=secrets.token_urlsafe(32),
            token=secrets.token_urlsafe(32),
            expires=self._now() + SESSION_TIME,
        )
        self._sessions = [*self._alive(), session][-_MOST_SESSIONS:]
        return session

    def session(self, cookie: str) -> Session | None:
        """Return the session that a cookie names, which goes on by that; None where there is none, or it is over."""
        session = None
        for each in self._alive():
            if same(each.cookie, cookie):
                session = each
        if session is not None:
            session.expires = self._now() + SESSION_TIME
        return session

    def _alive(self) -> list[Session]:
        return [each for each in self._sessions if each.expires > self._now()]


def _code() -> str:
    """A random code that a person can type, in groups of four signs."""
    return _group("".join(secrets.choice(_CODE_SIGNS) for _ in range(_CODE_LENGTH)))


def _group(typed: str) -> str:
    signs = "".join(sign for sign in typed.lower() if sign.isalnum())
    return "-".join(signs[k : k + 4] for k in range(0, len(signs), 4))


def same(expected: str, text: str) -> bool:
    """Return whether two texts are the same, in a time that doesn't tell how much of them is; an empty one never is."""
    alike = hmac.compare_digest(expected.encode(), text.encode("utf-8", "surrogatepass"))
    return bool(text) and alike
