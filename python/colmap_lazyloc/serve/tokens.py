"""The bearer tokens that are let in."""

import hashlib
import hmac

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import Path, read_entries


class Tokens:
    """The tokens of a file."""

    def __init__(self, path: Path):
        """Reads a file with one token per line; empty lines and comments (#) are skipped."""
        entries = read_entries(path)
        if not entries:
            raise InputError(f"{path}: contains no token")
        for number, token in entries:
            if not token.isascii() or not token.isprintable() or " " in token:
                raise InputError(f"{path}, line {number}: a token must be printable ASCII without blanks")
        # Hashes have one length, so that the time of a comparison says nothing of a token.
        self._hashes = [hashlib.sha256(token.encode()).digest() for _, token in entries]

    def __contains__(self, token: str) -> bool:
        given = hashlib.sha256(token.encode()).digest()
        return any([hmac.compare_digest(given, known) for known in self._hashes])  # a list, to compare with all
