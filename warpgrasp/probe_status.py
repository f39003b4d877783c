"""What became of a probe: failure is data."""

from enum import IntEnum


class ProbeStatus(IntEnum):
    """Status of one guarded move."""

    NOT_TRIED = 0
    CONTACT = 1
    NO_CONTACT = 2
    """The end of the path or line was reached with nothing felt."""
    BLOCKED = 3
    """Something stopped the motion, but nothing was felt where it counts."""
    UNREACHABLE = 4
    """The arm cannot take the hand there within its reach and limits."""
    COLLISION = 5
    """The open hand would strike object or table on its way; the probe is skipped."""
