"""A spec that is edited while its study begins: what was read is kept."""

import json
from pathlib import Path
from types import ModuleType

import pytest
from studies import SMALL, write_spec

from sweeps.cli import commands
from sweeps.cli import main as cli
from sweeps.race import command, until
from sweeps.run import plan, worker
from sweeps.run.plan import Plan
from sweeps.spec.reader import read_spec
from sweeps.spec.study import Study


@pytest.mark.parametrize(("room", "words"), [
    (commands, ("sweep",)), (commands, ("sweep", "--set", "seed=8")),
    (until, ("sweep", "--until", "1e6")), (command, ("race", "--within", "1e6"))])
def test_the_text_that_was_read_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        room: ModuleType, words: tuple[str, ...]) -> None:
    spec, out = write_spec(tmp_path, SMALL), tmp_path / "out"

    def edited_meanwhile(study: Study) -> Plan:
        spec.write_text("no spec")
        return plan.plan_study(study)

    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    monkeypatch.setattr(room, "plan_study", edited_meanwhile)
    assert cli.run([words[0], str(spec), "-o", str(out), *words[1:]]) == 0
    assert spec.read_text() == "no spec"
    kept = plan.plan_study(read_spec(out / "spec.toml"))
    assert kept.hash == json.loads((out / "resolved.json").read_text())["hash"]
