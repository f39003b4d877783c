"""What a command's exit code says."""

DONE = 0
SOME_FAILED = 1
"""Something that was asked for could not be done; the rest was."""
BAD_USAGE = 2
OTHER_SPEC = 3
"""The folder holds another study."""
INTERRUPTED = 130
