"""Options of fits that are one of a few words."""

from typing import Any, Literal, get_args

Kind = Literal["solina", "solina_box", "radial", "distance", "volume_distance"]
Loss = Literal["none", "pseudo_huber", "cauchy", "geman_mcclure"]
Monotone = Literal["none", "falling", "rising"]


def check_word(name: str, word: str, words: Any) -> None:
    """Raises ValueError with what the option may be where `word` is none of the Literal `words`."""
    known = get_args(words)
    if word not in known:
        raise ValueError(f"{name}: {word!r}, should be one of {', '.join(known)}")
