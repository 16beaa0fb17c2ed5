"""Everything that fuzzing has found, read again; and more of the kind, by changing it at random.

`make fuzz` adds to the corpus what reaches new code, and what crashes.
"""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz.targets import CORPUS, TARGETS, feed, inputs_of


def test_every_target_has_its_part_of_the_corpus_and_no_other_is_there() -> None:
    assert {folder.name for folder in CORPUS.iterdir()} == set(TARGETS)


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_met_is_taken_or_refused_in_words(name: str) -> None:
    taken = set()
    for path in inputs_of(name):
        try:
            taken.add(feed(name, path.read_bytes()))
        except Exception as error:
            error.add_note(f"input: {path}")
            raise
    # a reader that refused all, or took all, would be no test of it
    assert taken == ({True, False} if TARGETS[name].refuses else {True})


@st.composite
def changed(draw: st.DrawFn, name: str) -> bytes:
    """An input with some bytes changed, put in, taken out, or exchanged with those of another one."""
    data = draw(st.sampled_from(inputs_of(name))).read_bytes()
    for _ in range(draw(st.integers(1, 4))):
        low, high = sorted((draw(st.integers(0, len(data))), draw(st.integers(0, len(data)))))
        other = draw(st.sampled_from(inputs_of(name))).read_bytes()
        start = draw(st.integers(0, len(other)))
        data = (
            data[:low]
            + draw(st.one_of(st.binary(max_size=8), st.just(other[start : start + 40])))
            + data[min(high, low + draw(st.sampled_from((0, 1, 4, 10_000)))) :]
        )
    return data


@pytest.mark.parametrize("name", TARGETS)
def test_changed_inputs_are_taken_or_refused_in_words(name: str) -> None:
    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
    @given(changed(name))
    def run(data: bytes) -> None:
        feed(name, data)

    run()
