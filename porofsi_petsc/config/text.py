"""Read a text file of the user, or say in one sentence why it cannot be read."""

import os
import stat
from pathlib import Path

from ..errors import InputError, shown

LARGEST_FILE = 2**30  # [bytes] of a scene or a table; a mesh has formats of its own


def read_text(path: str | os.PathLike[str], what: str, expected: str, advice: str) -> str:
    """Return the text of a UTF-8 file, with or without byte-order mark, its lines ended by "\\n".

    what, expected : the words for the file and for its content; advice : what helps where there is
    none. Raises InputError when it is missing, no regular file (which may be without end), too
    large, or not UTF-8.
    """
    require_regular(path, what, advice)
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{what} {_name(path)} cannot be read: {error.strerror}") from None
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        text = (
            f"byte 0x{data[error.start]:02x} in line {line} is not UTF-8, expected {expected}; save"
            " it as UTF-8 text"
        )
        raise InputError(f"{what} {_name(path)}: {text}") from None


def require_regular(path: str | os.PathLike[str], what: str, advice: str) -> None:
    """Raise InputError unless the path is that of a regular file of a size that can be read."""
    try:
        status = Path(path).stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{what} {_name(path)} cannot be read: no such file; {advice}") from None
    except (
        OSError,
        ValueError,
        RuntimeError,
    ) as error:  # no permission, a null character, a name too long, links in a circle
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {_name(path)} cannot be read: {reason}") from None
    kind = "a directory" if stat.S_ISDIR(status.st_mode) else "a device or pipe"
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{what} {_name(path)}: received {kind}, expected a file")
    if status.st_size > LARGEST_FILE:
        raise InputError(
            f"{what} {_name(path)}: received {status.st_size} bytes, expected at most"
            f" {LARGEST_FILE}"
        )


def _name(path: str | os.PathLike[str]) -> str:
    """Return the path, shortened and in quotes where it would not fit into a sentence."""
    text = str(path)
    return text if text.isprintable() and len(text) <= 255 else shown(text)
