"""Effects and lists in the prose of a page."""

from __future__ import annotations

import re
from collections.abc import Sequence

from phaselead.model import catalogue


def effect_title(name: str) -> str:
    """The title of an effect as it stands within a sentence: "amplifier low-pass", "DAC nonlinearity"."""
    known = catalogue()
    title = known[name].title if name in known else name.replace("_", " ")
    return title if title[1:2].isupper() else title[:1].lower() + title[1:]


def in_prose(text: str) -> str:
    """A text in which effects have their titles, not the names that stage files give them. A name in front of a point
    and a word is one of the code, and stays."""
    names = "|".join(name for name in catalogue() if "_" in name)
    return re.sub(rf"(`?)\b({names})\b(?!\.\w)\1", lambda found: effect_title(found[2]), text)


def begun(text: str) -> str:
    """A text as it begins a sentence."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words in a row, ``last`` before the last of them."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
