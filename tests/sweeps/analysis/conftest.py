"""A wide study of stand-ins, and its entries in pairs."""

import pytest
from curved_episodes import wide_study

from sweeps.analysis.objects import ALSO
from sweeps.analysis.paired import Paired, read_paired
from sweeps.run.plan import Plan
from sweeps.run.store import Store


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("wide"))


@pytest.fixture(scope="module")
def paired(study: tuple[Plan, Store]) -> Paired:
    plan, store = study
    return read_paired(plan, [store], ["chamfer_mm", *ALSO])
