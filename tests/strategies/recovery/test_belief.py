"""What strategies are handed cannot be written to, whatever a spec's tables were reckoned to."""

import numpy as np
import pytest

from strategies.recovery.belief import read_only
from strategies.recovery.evidence import no_evidence
from warpgrasp.parameters import ErrorTable


def test_errors_beyond_the_bounds_of_a_spec_are_handed_on() -> None:
    table = ErrorTable(scale=9.0).scaled()
    assert table.pad_gain_share > 0.5  # more than a spec may say
    assert read_only(table) == table


def test_arrays_within_records_are_read_only_and_the_record_is_not() -> None:
    record = no_evidence(3, 0.008)
    shown = read_only((record, np.zeros(2)))
    for array in (shown[0].points_m, shown[1]):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0
    record.points_m[...] = 1.0
