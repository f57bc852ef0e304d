"""`sentinels` names tests, and the GPU has a case of each."""

import importlib

import pytest
from sentinels import SENTINELS

pytestmark = pytest.mark.cpu_only("simulates nothing")


@pytest.mark.parametrize("sentinel", sorted(SENTINELS))
def test_a_sentinel_is_a_test_of_both_backends(sentinel):
    file, _, name = sentinel.partition("[")[0].partition("::")
    module = importlib.import_module(file.removesuffix(".py"))
    marks = [*getattr(module, "pytestmark", ()), *getattr(getattr(module, name), "pytestmark", ())]
    assert "cpu_only" not in {mark.name for mark in marks}


def test_the_cases_that_are_named_exist(request):
    """Where their file is collected."""
    items = request.session.items
    cases = {f"{item.path.name}::{item.name.replace('[gpu-', '[')}" for item in items}
    files = {item.path.name for item in items}
    named = {one for one in SENTINELS if "[" in one and one.partition("::")[0] in files}
    assert named <= cases
