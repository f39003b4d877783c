"""The keys of a strategy's budget as a spec writes them; light, for the spec reader."""

from typing import Any

BUDGET_KEYS: dict[str, tuple[Any, float, float, str]] = {
    "touches": (int, 1, 1e6, "guarded closings and pad touches of an episode"),
    "robot_time_s": (float, 1e-3, 1e6, "robot time of an episode"),
    "volume_ratio": (float, 1.0, 1e6, "90 % interval of the volume, upper over lower bound"),
}
"""Type, least and greatest value, and meaning of each."""
