"""Names that people give to regions and layers: any text, made safe where it becomes the name of a file or table."""

from __future__ import annotations

import hashlib
import re
import unicodedata

from swathe.errors import InvalidParameterError

_MOST_CHARACTERS, _LABEL_CHARACTERS = 200, 40


def checked_name(name: str, what: str = "region") -> str:
    """Return the name of a region or layer, in one Unicode form.

    Raises:
        InvalidParameterError: it is empty, too long, or holds control characters or half a character.
    """
    text = unicodedata.normalize("NFC", name)
    if not text.strip() or len(text) > _MOST_CHARACTERS:
        raise InvalidParameterError(
            f"A {what} cannot be called {name[:60]!r}.", f"Give 1 to {_MOST_CHARACTERS} characters."
        )
    if any(unicodedata.category(character) in {"Cc", "Cs"} for character in text):
        raise InvalidParameterError(
            f"The name {name[:60]!r} of a {what} holds characters that cannot be shown.", "Leave them out."
        )
    return text


def label(name: str) -> str:
    """Return a name as letters, digits and low lines, different for every name whatever the case of files."""
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower())[:_LABEL_CHARACTERS].strip("_")
    if plain == name:
        return plain
    return f"{plain or 'x'}_{hashlib.sha256(name.encode()).hexdigest()[:8]}"
