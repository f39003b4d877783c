"""The simulator under the runner: what must not change a result does not."""

from pathlib import Path

import numpy as np
import pytest
from studies import plan_of

from sweeps.episodes import run_episodes
from sweeps.unit_file import Columns

pytestmark = pytest.mark.slow


def together(parts: list[Columns]) -> Columns:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@pytest.mark.parametrize("splits", [(4,), (1, 6), (2, 3, 5)])
def test_rows_do_not_depend_on_the_batch(tmp_path: Path, splits: tuple[int, ...]) -> None:
    cell = next(plan_of(tmp_path).units()).cell
    episodes = np.arange(8)
    whole = run_episodes(cell, episodes, "cpu")
    parts = together([run_episodes(cell, part, "cpu") for part in np.split(episodes, splits)])
    for name, values in whole.items():
        assert values.tolist().__repr__() == parts[name].tolist().__repr__(), name


def test_strategies_meet_the_same_objects(tmp_path: Path) -> None:
    """Common random numbers: what is drawn of an object does not depend on the strategy."""
    from sweeps.episodes import run_block

    plan = plan_of(tmp_path)
    first, second = (plan.study.cell(n, 0, 0) for n in range(2))
    blocks = [run_block(cell, np.arange(3), "cpu") for cell in (first, second)]
    assert (blocks[0].truth.body_pose == blocks[1].truth.body_pose).all()
    assert (blocks[0].told.radius_m == blocks[1].told.radius_m).all()
