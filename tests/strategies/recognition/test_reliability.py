"""Probabilities of answers are those observed, on episodes that no model was learned from."""

import pytest
from recognition_reliability import answers_of, held_out_objects, reliability

from strategies.recognition.answers import ALIGNMENT

pytestmark = pytest.mark.slow
SEED = 78


@pytest.fixture(scope="module")
def answers():
    objects = held_out_objects(SEED, 16, None)
    return [answers_of(objects, strategy, 4, SEED)
            for strategy in ("rim12-ring12", "coarse-to-fine")]


def test_the_mean_probability_is_the_share_observed(answers) -> None:
    _, _, count, predicted, observed = reliability(answers)["all"][-1]
    assert count > 180
    assert abs(predicted - observed) < 0.06


def test_sure_answers_are_right(answers) -> None:
    sure = [(predicted, observed) for low, _, count, predicted, observed
            in reliability(answers)["all"] if low >= 0.95 and count >= 20]
    assert sure
    for predicted, observed in sure:
        assert observed > predicted - 0.05


def test_most_objects_are_named(answers) -> None:
    for each in answers:
        listed = each.kind == "catalogue"
        assert listed.any()
        assert each.right["as_felt"][listed].mean() > 0.8
        assert each.right["as_felt"][listed].mean() > each.right[ALIGNMENT][listed].mean() - 0.1
