"""A secret: a file with random bytes that only its owner can read. The values drawn from it can't be computed without it."""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
from pathlib import Path

from servobench.core.errors import StorageError, UsageError

LENGTH = 32  # bytes: as many as SHA-256 has, so that guessing is hopeless
_LARGEST = 4096  # bytes; what is larger is some other file


def new_secret(path: Path) -> bytes:
    """Write a file with random bytes that only its owner may read, and return them; a file that is there isn't replaced.

    Raises `StorageError` where it can't be written.
    """
    secret = os.urandom(LENGTH)
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(secret)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise StorageError(f"the secret {path} can't be written: {error.strerror or error}") from error
    return secret


def read_secret(path: Path) -> bytes:
    """Return the secret in a file.

    Raises `UsageError` where there is none, where it is too short to be safe or too long to be one, and where others may read it.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            known = file.read(_LARGEST + 1)
    except FileNotFoundError:
        raise UsageError(
            f"there is no secret {path}; expected the file used to assign the motors, as only that gives the same "
            "ones"
        ) from None
    except OSError as error:
        raise UsageError(f"the secret {path} can't be read: {error.strerror or error}") from error
    if os.name == "posix" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise UsageError(
            f"the secret {path} may be read by others (mode {stat.S_IMODE(mode):03o}); run `chmod 600 {path}` if it "
            "hasn't been read by others, otherwise assign new motors with a new secret"
        )
    if not LENGTH <= len(known) <= _LARGEST:
        length = f"more than {_LARGEST}" if len(known) > _LARGEST else str(len(known))
        raise UsageError(
            f"the secret {path} has {length} bytes; expected {LENGTH} to {_LARGEST}, random ones, as "
            "`servobench lab assess EXERCISE ROSTER` writes to a new file"
        )
    return known


def hash_words(secret: bytes, *words: str) -> bytes:
    """Return 32 bytes that need the secret to compute: HMAC-SHA256 of the words, separated by their lengths."""
    parts = [word.encode("utf-8", "surrogatepass") for word in words]
    message = b"".join(len(part).to_bytes(4, "big") + part for part in parts)
    return hmac.new(secret, message, hashlib.sha256).digest()
