"""Every target with bytes that hypothesis draws, and with mutations of its seeds."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.proofs.fuzz.amounts import MUTATIONS, examples
from tests.proofs.fuzz.mutation import Mutations
from tests.proofs.fuzz.targets import TARGETS, seeds


def inputs(name: str) -> st.SearchStrategy[bytes]:
    """Draw any bytes, and seeds with anything in the place of a part of them."""
    longest = TARGETS[name].longest

    def changed(seed: bytes) -> st.SearchStrategy[bytes]:
        places = st.tuples(st.integers(0, len(seed)), st.integers(0, 12), st.binary(max_size=12))
        return places.map(lambda place: seed[: place[0]] + place[2] + seed[place[0] + place[1] :])

    return st.binary(max_size=longest) | st.sampled_from(seeds(name)).flatmap(changed)


@pytest.mark.parametrize("name", TARGETS)
def test_any_bytes(name: str) -> None:
    @examples(40)
    @given(inputs(name))
    def run(data: bytes) -> None:
        TARGETS[name].check(data)

    run()


@pytest.mark.parametrize("name", TARGETS)
def test_mutated_seeds(name: str) -> None:
    target, source = TARGETS[name], Mutations(seeds(name), TARGETS[name].longest, seed=1)
    for _ in range(MUTATIONS * target.share):
        data = source.next()
        try:
            target.check(data)
        except Exception as error:
            error.add_note(f"record it: Recorded({name!r}, {data!r}, ...)")
            raise
