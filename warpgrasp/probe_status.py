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
    SELF_CONTACT = 6
    """The finger was stopped, and by its joint angles it touches another finger or the palm."""


FELT_TO_THE_END = (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT, ProbeStatus.SELF_CONTACT)
"""What may have become of a closing whose joint angles tell what is free."""
