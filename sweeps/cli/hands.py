"""The commands for hands: those that ship, and a hand from a URDF."""

import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sweeps.cli.app import Force, Json, UsageError, app, named_numbers, refuse_existing

if TYPE_CHECKING:
    from warpgrasp.hands.hand_model import HandModel


@app.command
def hands(*hands: str, json: Json = False) -> int:
    """List the hands that ship, or those that are named: fingers, joints, what they feel.

    Parameters
    ----------
    hands
        Hands that ship, or files as `warpgrasp hand` writes them; by default all that ship.
    json
        Print JSON.
    """
    from sweeps.text_table import print_table
    from warpgrasp.chain.chain_hand import hand_of_kind
    from warpgrasp.hands.hand_file import SHIPPED

    found = [(name, hand_of_kind(name)) for name in hands or SHIPPED]
    print_table(("hand", "fingers", "joints", "driven", "thumb", "senses", "closings", "source"),
                [(name, str(len(m.fingers)), str(len(m.joints)), str(len(m.driven)),
                  m.thumb or "none", m.senses, ", ".join(c.name for c in m.closings), m.source)
                 for name, m in found], json)
    return 0


@app.command
def hand(urdf: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
         palm: str | None = None,
         tip: Annotated[list[str] | None, Parameter(negative="")] = None,
         hold: Annotated[list[str] | None, Parameter(negative="")] = None,
         trials: Annotated[bool, Parameter(negative="--no-trials")] = True,
         force: Force = False) -> int:
    """Write a hand from a URDF as TOML, guesses marked, and a picture beside it, open and closed.

    Parameters
    ----------
    urdf
        A URDF with its meshes (a TOML that this command wrote: only the picture is drawn again).
    out
        The file to write, .toml; the picture gets the same name and .png. Of a TOML only the
        picture is written.
    palm
        The link that fingers start from; by default the root, or the link after an arm.
    tip
        Only chains to this link are fingers, and to others as in --tip A --tip B; by default all.
    hold
        A joint that stands still, as NAME=DEGREES; more as in --hold A=0 --hold B=0.
    trials
        Compare the first guess with others by episodes, a minute or two; --no-trials keeps the
        first guess.
    force
        Overwrite existing files (a picture of a TOML is drawn anew without it).
    """
    from sweeps.figures.style import encode
    from sweeps.output import note, quiet_stdout
    from sweeps.report.hand_picture import hand_picture
    from sweeps.result_file import check_result, write_result
    from warpgrasp.chain.chain_pads import fitted_pads
    from warpgrasp.hands.capsule_fit import skin_notes
    from warpgrasp.hands.hand_file import hand_from_file
    from warpgrasp.hands.hand_writer import hand_text
    from warpgrasp.hands.urdf_hand import FRAMED, hand_from_urdf

    if out.suffix != ".toml":
        raise UsageError(f"--out: is {out}; should end in .toml")
    is_hand = urdf.suffix == ".toml"
    for option, given in (("--palm", palm), ("--tip", tip), ("--hold", hold)):
        if is_hand and given:
            raise UsageError(f"{option}: is for a URDF, and {urdf} is a hand already; what it says "
                             "should be changed in that file")
    if not is_hand:
        for path in (out, out.with_suffix(".png")):
            check_result(path)
            refuse_existing(path, force)
    with quiet_stdout():
        if is_hand:
            model, text = hand_from_file(urdf), None
        else:
            held = named_numbers("--hold", hold or [], "wrist=0")
            model, notes = hand_from_urdf(
                urdf, palm=palm, tips=tip or [],
                held_rad={name: math.radians(angle) for name, angle in held.items()})
            if trials:
                model, said = _by_trial(model, framed=FRAMED in notes)
                notes = *notes, *said
            model, changes = fitted_pads(model)
            text = hand_text(model, (*notes, *changes), guessed=True, framed=FRAMED in notes)
            for line in (*notes, *changes):
                note(line)
        _say_guesses(model)
        for line in skin_notes(model):
            note(line)
        picture = out.with_suffix(".png")
        files = {} if text is None else {out: text.encode()}
        for path, content in (files | {picture: encode(hand_picture(model), "png")}).items():
            write_result(path, content)
    for path in (*files, picture):
        print(path)
    return 0


def _by_trial(first: "HandModel", *, framed: bool) -> tuple["HandModel", tuple[str, ...]]:
    """The best of the first and the other guesses of a hand, and what is said of it."""
    from dataclasses import replace

    from sweeps.output import init_warp, note
    from warpgrasp.hands.hand_checks import check_hand
    from warpgrasp.hands.hand_guesses import other_guesses
    from warpgrasp.hands.hand_model import HandError

    others = []
    for guess in other_guesses(first):
        other = replace(guess, grasp_frame=first.grasp_frame) if framed else guess
        with suppress(HandError):
            if other not in (first, *others):
                others.append(check_hand(other))
    if not others:
        return first, ()
    init_warp()
    from sweeps.cli.tools.hand_trials import best_guess, trial_misfit

    if wrong := trial_misfit(first):
        return first, ("guesses of thumb, grasp frame and open posture are not tried by episodes: "
                       f"{wrong}",)
    note(f"compares {len(others) + 1} guesses by episodes, a minute or two (--no-trials: none)")
    best, trial, before = best_guess(first, others)
    said = (f"the first is kept: mean error {before.chamfer_mm:.1f} mm" if best == first else
            f"the best has a mean error of {trial.chamfer_mm:.1f} mm, the first of "
            f"{before.chamfer_mm:.1f}")
    return best, (f"of {len(others) + 1} guesses of thumb, grasp frame and open posture, tried by "
                  f"episodes, {said}",)


def _say_guesses(model: "HandModel") -> None:
    from sweeps.output import note

    for finger in model.fingers:
        note(f"finger {finger.name}: {', '.join(joint.name for joint in finger.joints)}"
             f"{' (thumb)' if finger.name == model.thumb else ''}")
