"""The rest of a hand whose fingers touch one another or the palm, with friction and without."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "link_gap": ["finger_gap", "palm_gap"],
    "meetings": ["MEETINGS", "PALM", "HandBuild", "Meeting", "base_of", "find_meetings",
        "fingers_met", "in_pairs", "pair_bit", "servo_torques", "takes_part"],
    "chain_meetings": ["CAPSULE_ROWS", "FINGERS", "CapsulePair", "ChainBuild", "ChainMeeting",
        "hand_angles", "near_pairs", "off_command", "ordered_pair", "pair_gap",
        "pairs_within", "place_finger"],
    "hand_equilibrium": ["hand_energy", "move_commands"],
    "rubbing_hand": ["rubbed_at"],
})
