"""Priors are scored once, and as without that."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from fit.arrays import joined
from sweeps.episode import given_prior
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior, prior_recovered
from sweeps.episode.scores import ROUGH, Scorer
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ObjectTable

BODIES = [body_from_name(name) for name in ("block", "funnel")]


def given(which: np.ndarray, episodes: np.ndarray):  # type: ignore[no-untyped-def]
    """A scorer and the priors of episodes with the two bodies."""
    table, key = ObjectTable(), counter_key(5, which, episodes)
    pose = place_objects(table, key)
    scorer = Scorer(BODIES, which, pose)
    priors = [draw_prior(body, pose[rows], table, key[rows]) for body, rows in scorer.worlds()]
    return scorer, prior_recovered(joined(priors))


def test_scores_of_priors_are_those_of_the_scorer_and_computed_once(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(given_prior, "_known", {})
    which, episodes = np.array([0, 0, 0, 1, 1]), np.array([4, 7, 4, 4, 9])
    scorer, priors = given(which, episodes)
    expected = astuple(scorer.score(priors))
    np.testing.assert_array_equal(astuple(given_prior.score_priors(scorer, priors)), expected)
    scored: list[int] = []
    whole = Scorer.score

    def count(self: Scorer, recovered):  # type: ignore[no-untyped-def]
        scored.append(len(self.body_pose))
        return whole(self, recovered)

    monkeypatch.setattr(Scorer, "score", count)
    np.testing.assert_array_equal(astuple(given_prior.score_priors(scorer, priors)), expected)
    other, its = given(np.array([0, 1, 1]), np.array([7, 2, 9]))
    given_prior.score_priors(other, its)
    assert scored == [1]  # the funnel's second episode alone is new
    rough = replace(scorer, samples=ROUGH)
    np.testing.assert_array_equal(astuple(given_prior.score_priors(rough, priors)),
                                  astuple(rough.score(priors)))
    monkeypatch.setattr(given_prior, "REMEMBERED", 5)
    np.testing.assert_array_equal(astuple(given_prior.score_priors(scorer, priors)), expected)
    assert len(given_prior._known) == 4
