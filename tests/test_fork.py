"""Forks, spawned children and threads get the bits of the parent, hear Ctrl-C, and hang on nothing.

Nothing here depends on chance. Each case is a process of its own, with warnings as errors.
"""

import os
import subprocess
import sys
from pathlib import Path

import fork_cases
import pytest

pytestmark = [
    pytest.mark.cpu_only("each case names its backends itself"),
    pytest.mark.skipif(sys.platform != "linux", reason="asks /proc, and forks"),
]
CASES = (
    fork_cases.no_thread_outlives_a_call,
    fork_cases.threads_are_as_many_as_asked_for,
    fork_cases.children_of_each_kind,
    fork_cases.forks_while_the_parent_runs,
    fork_cases.many_threads,
    fork_cases.a_fork_hears_ctrl_c,
)
ON_THE_GPU = (
    fork_cases.forks_of_a_process_that_used_the_gpu,
    fork_cases.a_fork_may_use_the_gpu_first,
)


def passes(case):
    clean = {name: value for name, value in os.environ.items() if name != "MCRT_BACKEND"}
    code = f"import fork_cases; fork_cases.{case.__name__}()"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=Path(__file__).parent,
        env=clean,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_processes(case):
    passes(case)


@pytest.mark.usefixtures("adapter")
@pytest.mark.parametrize("case", ON_THE_GPU, ids=lambda case: case.__name__)
def test_processes_with_a_gpu(case):
    passes(case)
