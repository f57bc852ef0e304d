"""`sentinels` names tests, and the GPU has a case of each."""

import importlib

import pytest
from sentinels import SENTINELS


@pytest.mark.cpu_only("simulates nothing")
@pytest.mark.parametrize("sentinel", sorted(SENTINELS))
def test_a_sentinel_is_a_test_of_both_backends(sentinel):
    file, _, name = sentinel.partition("::")
    module = importlib.import_module(file.removesuffix(".py"))
    marks = [*getattr(module, "pytestmark", ()), *getattr(getattr(module, name), "pytestmark", ())]
    assert "cpu_only" not in {mark.name for mark in marks}
