"""Races: which entry of many is best, within how much, with as few episodes as that takes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "command": ["race"],
    "course": ["rules_of"],
    "power": ["power_row"],
    "race_note": ["end_race_note", "race_state"],
    "race_units": ["RaceUnits"],
    "until": ["sweep_until"],
    "verdict": ["amount", "verdict_word"],
})
