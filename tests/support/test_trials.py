"""A few trials in an ordinary run, all of them where all is asked for."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import settings
from tests.support.trials import THOROUGH, few, pairs, thorough, trials


@pytest.fixture(params=["trailmark", "thorough"])
def profile(request: pytest.FixtureRequest) -> Iterator[str]:
    before = "thorough" if thorough() else "trailmark"
    settings.load_profile(request.param)
    yield request.param
    settings.load_profile(before)


def test_an_ordinary_run_makes_a_part_of_them(profile: str) -> None:
    everything = profile == "thorough"
    assert thorough() == everything
    assert [few(30), few(10, of=4), few(1)] == ([30, 10, 1] if everything else [10, 3, 1])
    assert list(trials(5)) == ([0, 1, 2, 3, 4] if everything else [0, 1])
    assert few(THOROUGH, of=100) == (THOROUGH if everything else 10)


def test_each_case_comes_in_some_pair(profile: str) -> None:
    found = pairs("abcd", range(6))
    assert len(set(found)) == len(found) == (24 if profile == "thorough" else 8)
    assert {a for a, _ in found} == set("abcd")
    assert {b for _, b in found} == set(range(6))
