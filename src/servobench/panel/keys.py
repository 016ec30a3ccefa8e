"""Who may come in: the keys that a panel hands out, and the sessions that they open."""

from __future__ import annotations

import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Role = Literal["operator", "viewer"]

KEY_TIME = 12 * 3600.0  # s; how long the address that the panel prints lets somebody in
SESSION_TIME = 12 * 3600.0  # s since the session was used last
ONCE_TIME = 60.0  # s; what a browser that the panel opens itself needs at most
_MOST_SESSIONS = 256


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
    expires: float
    once: bool


class Keys:
    """Random keys, compared in constant time, that expire; `now` is a monotonic time [s].

    A key in the panel's address opens a session. A viewer's sees and may stop the motor, and does nothing else.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._keys: list[_Key] = []
        self._sessions: list[Session] = []

    def new(self, role: Role, *, once: bool = False) -> str:
        """Return a new key; one that is to be used `once` lasts a minute."""
        text = secrets.token_urlsafe(32)
        self._keys.append(_Key(text, role, self._now() + (ONCE_TIME if once else KEY_TIME), once))
        return text

    def open(self, key: str) -> Session | None:
        """Return a new session for a key; None where it isn't one, or is over."""
        found = None
        for each in self._keys:
            if same(each.text, key) and each.expires > self._now():
                found = each
        if found is None:
            return None
        if found.once:
            self._keys.remove(found)
        session = Session(
            role=found.role,
            cookie=secrets.token_urlsafe(32),
            token=secrets.token_urlsafe(32),
            expires=self._now() + SESSION_TIME,
        )
        self._sessions = [*self._alive(), session][-_MOST_SESSIONS:]
        return session

    def session(self, cookie: str) -> Session | None:
        """Return the session that a cookie names, which goes on by that; None where there is none, or it is over."""
        found = None
        for each in self._alive():
            if same(each.cookie, cookie):
                found = each
        if found is not None:
            found.expires = self._now() + SESSION_TIME
        return found

    def _alive(self) -> list[Session]:
        return [each for each in self._sessions if each.expires > self._now()]


def same(expected: str, given: str) -> bool:
    """Return whether two texts are the same, in a time that doesn't tell how much of them is; an empty one never is."""
    alike = hmac.compare_digest(expected.encode(), given.encode("utf-8", "surrogatepass"))
    return bool(given) and alike
