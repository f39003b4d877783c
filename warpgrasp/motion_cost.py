"""What the primitive motions of a robot cost: one clock and one count for every procedure.

- A guarded step, of fingers or of arm and finger: command, rest, reading. It takes
  `ArmTable.guarded_step_s`, or as long as the joints need for the motion, whichever is longer.
- A finger's stroke, not guarded: the joint with the longest way governs, at
  `ArmTable.finger_speed_rad_s`. A finger that closed opens again the way that it came.
- A move of the arm from place to place: the slowest joint governs (`arm_kernel.arm_time`).

A touch is one guarded motion of one finger until contact that was made, whether anything was felt
or not: it was stopped, or it came to its end. `docs/model.md` has the table.
"""

import numpy as np

from warpgrasp.parameters import ArmTable
from warpgrasp.probe_status import ProbeStatus

MADE = (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT, ProbeStatus.BLOCKED,
        ProbeStatus.SELF_CONTACT)
"""What may have become of a guarded motion that was made."""
_MADE = np.isin(list(ProbeStatus), MADE)
"""The same by the number of each status."""


def was_made(status: np.ndarray) -> np.ndarray:
    """Whether guarded motions until contact count as touches, by their ProbeStatus."""
    return _MADE[status]


def guarded_time_s(arm: ArmTable, commands_rad: np.ndarray) -> np.ndarray:
    """Time of a guarded motion of a finger from its first command to each of them [s].

    `commands_rad` (..., step, joint); returns (..., step).
    """
    return _summed(np.maximum(_turns(commands_rad) / arm.finger_speed_rad_s, arm.guarded_step_s))


def opening_time_s(arm: ArmTable, commands_rad: np.ndarray) -> np.ndarray:
    """Time of a finger's stroke from each command back to the first one [s], shapes as above."""
    return _summed(_turns(commands_rad) / arm.finger_speed_rad_s)


def closing_time_s(
    arm: ArmTable, status: np.ndarray, step: np.ndarray, commands_rad: np.ndarray
) -> np.ndarray:
    """Time of closing all fingers in step, and of opening all, at each probe [s], (world, probe).

    `status` and `step`, the command where it stopped, (world, probe, grasp, finger);
    `commands_rad` (grasp, finger, step, joint). Grasps of a probe follow one another.
    """
    grasp, finger = np.ogrid[:commands_rad.shape[0], :commands_rad.shape[1]]
    made, last = was_made(status), np.maximum(step, 0)
    return sum((np.where(made, of(arm, commands_rad)[grasp, finger, last], 0.0).max(-1).sum(-1)
                for of in (guarded_time_s, opening_time_s)), np.zeros(status.shape[:2]))


def line_time_s(
    arm: ArmTable, commands_rad: np.ndarray, steps: np.ndarray, arm_time_s: np.ndarray
) -> np.ndarray:
    """Time of `steps` (row,) guarded steps, and of the finger's way back [s], (row,).

    `commands_rad` (step, joint) are the finger's, the last one held; `arm_time_s` (row,) is what
    the arm's joints need for the way alone.
    """
    last = np.minimum(steps, len(commands_rad) - 1)
    guarded = guarded_time_s(arm, commands_rad)[last] + (steps - last) * arm.guarded_step_s
    return np.maximum(guarded, arm_time_s) + opening_time_s(arm, commands_rad)[last]


def _turns(commands_rad: np.ndarray) -> np.ndarray:
    """The longest way of a joint from each command to the next [rad], (..., step - 1)."""
    return np.asarray(np.abs(np.diff(commands_rad, axis=-2)).max(-1))


def _summed(times: np.ndarray) -> np.ndarray:
    """Sums from the first step on: 0, then after each of them."""
    return np.concatenate([np.zeros((*times.shape[:-1], 1)), times.cumsum(-1)], axis=-1)
