"""The hand of a robot, by what its table names: how it moves, closes, and tells what it touched.

The Utah-MIT hand has functions of its own (`closing`): its parallel flexion axes allow shorter
mathematics, and it feels by tendons. All other hands are chains (`chain_closing`), whose kernels
are imported when one moves.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, chain_of_table
from warpgrasp.chain.chain_kernel import JOINTS
from warpgrasp.closing.closing import Closing, ClosingTruth, close_fingers
from warpgrasp.closing.contact_estimate import ContactEstimate, estimate_contacts
from warpgrasp.closing.self_contact import self_contacts
from warpgrasp.mechanism.arm_motion import ArmMoves, move_hand
from warpgrasp.mechanism.calibration import Calibration, draw_calibration
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    SensorTable,
    TrueTables,
)


class RobotHand(Protocol):
    """What a robot asks of its hand; arrays as in `move_hand`, `close_fingers` and so on."""

    @property
    def commanded(self) -> tuple[int, int]:
        """Fingers, and the commands that each takes at a step."""
        ...

    def calibration(self, errors: ErrorTable, key: np.ndarray) -> Calibration:
        """The errors of each world's robot."""
        ...

    def move(self, *given: Any, errors: Calibration, **words: Any) -> tuple[ArmMoves, np.ndarray]:
        """`move_hand`, from its scene on, the arm's table after the bodies' poses."""
        ...

    def close(self, *given: Any, errors: Calibration, **words: Any
              ) -> tuple[Closing, ClosingTruth]:
        """`close_fingers`, without hand and sensors."""
        ...

    def own_touches(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                    errors: ErrorTable, device: str) -> np.ndarray:
        """Which fingers, by their angles, may have stopped at the hand itself."""
        ...

    def estimate(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                 arm: ArmTable, errors: ErrorTable, device: str) -> ContactEstimate:
        """Where the robot concludes that it touched."""
        ...


def robot_hand(
    hand: HandTable, sensors: SensorTable, contact: ContactTable, true: TrueTables
) -> RobotHand:
    """The hand of a table. Raises HandError for a hand that cannot be used."""
    chain = chain_of_table(hand)
    if chain is None:
        return UtahMit(hand, sensors, contact, true)
    return Chains(chain, hand, sensors, contact, true)


@dataclass(frozen=True)
class UtahMit:
    """The Utah-MIT hand as it is believed, and as it is."""

    hand: HandTable
    sensors: SensorTable
    contact: ContactTable
    true: TrueTables

    @property
    def commanded(self) -> tuple[int, int]:
        """As a `RobotHand`."""
        return FINGER_COUNT, 4

    def calibration(self, errors: ErrorTable, key: np.ndarray) -> Calibration:
        """As a `RobotHand`."""
        return draw_calibration(errors, key)

    def move(self, *given: Any, errors: Calibration, **words: Any) -> tuple[ArmMoves, np.ndarray]:
        """As a `RobotHand`."""
        scene, body, body_pose, arm, *rest = given
        return move_hand(scene, body, body_pose, arm, self.true.hand, *rest, contact=self.contact,
                         errors=errors, **words)

    def close(self, *given: Any, errors: Calibration, **words: Any
              ) -> tuple[Closing, ClosingTruth]:
        """As a `RobotHand`."""
        scene, body, body_pose, *rest = given
        return close_fingers(scene, body, body_pose, self.true.hand, self.true.sensors, *rest,
                             contact=self.contact, errors=errors, **words)

    def own_touches(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                    errors: ErrorTable, device: str) -> np.ndarray:
        """As a `RobotHand`."""
        return self_contacts(closing, believed_pose, commands_rad, self.hand, self.sensors, errors,
                             contact=self.contact, device=device)

    def estimate(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                 arm: ArmTable, errors: ErrorTable, device: str) -> ContactEstimate:
        """As a `RobotHand`."""
        return estimate_contacts(closing, believed_pose, commands_rad, arm, self.hand,
                                 self.sensors, errors=errors, contact=self.contact, device=device)


@dataclass(frozen=True)
class Chains:
    """Any other hand."""

    chain: ChainHand
    hand: HandTable
    sensors: SensorTable
    contact: ContactTable
    true: TrueTables

    @property
    def commanded(self) -> tuple[int, int]:
        """As a `RobotHand`."""
        return self.chain.fingers, self.chain.width

    def calibration(self, errors: ErrorTable, key: np.ndarray) -> Calibration:
        """As a `RobotHand`."""
        return draw_calibration(errors, key, fingers=self.chain.fingers, joints=JOINTS,
                                links=JOINTS)

    def move(self, *given: Any, errors: Calibration, **words: Any) -> tuple[ArmMoves, np.ndarray]:
        """As a `RobotHand`."""
        from warpgrasp.chain.chain_move import chain_clearance

        scene, body, body_pose, arm, *rest = given
        return move_hand(scene, body, body_pose, arm, self.true.hand, *rest, contact=self.contact,
                         errors=errors, **words, clearance=chain_clearance(
                             self.chain, self.true.hand, self.contact, errors))

    def close(self, *given: Any, errors: Calibration, **words: Any
              ) -> tuple[Closing, ClosingTruth]:
        """As a `RobotHand`."""
        from warpgrasp.chain_closing.chain_closing import close_chains

        scene, body, body_pose, *rest = given
        return close_chains(scene, body, body_pose, self.chain, self.true.hand, self.true.sensors,
                            *rest, contact=self.contact, errors=errors, **words)

    def own_touches(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                    errors: ErrorTable, device: str) -> np.ndarray:
        """As a `RobotHand`."""
        from warpgrasp.chain_closing.chain_self_contact import chain_self_contacts

        return chain_self_contacts(closing, believed_pose, commands_rad, self.chain, self.hand,
                                   self.sensors, errors, contact=self.contact, device=device)

    def estimate(self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray,
                 arm: ArmTable, errors: ErrorTable, device: str) -> ContactEstimate:
        """As a `RobotHand`."""
        from warpgrasp.chain_closing.chain_closing import ChainClosing
        from warpgrasp.chain_closing.chain_estimate import estimate_chain_contacts

        assert isinstance(closing, ChainClosing)
        return estimate_chain_contacts(
            closing, believed_pose, commands_rad, arm, self.chain, self.hand, self.sensors,
            errors=errors, contact=self.contact, device=device)
