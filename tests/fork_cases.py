"""What a process does that has forks, spawned children and threads; `test_fork` starts each."""

import concurrent.futures as futures
import contextlib
import hashlib
import multiprocessing
import os
import signal
import sys
import threading
import time

import mcrt
import numpy as np
from mcrt import _mcrt

NOISE = np.random.default_rng(1).random((42, 42, 42), dtype=np.float32)
SKY = np.random.default_rng(2).random((64, 128), dtype=np.float32)
EYE = mcrt.PerspectiveCamera((150, -120, 90), (24, 24, 24), fov=25, resolution=(24, 24))
OTHER = mcrt.OrthographicCamera((0, 200, 24), (24, 24, 24), width=80, resolution=(20, 20))

ALARM = 100  # seconds after which a child hangs; it takes a few


def run(backend="cpu", **options):
    given = {"extinction": 0.1, "light": mcrt.DirectionalLight((0.3, -0.2, -1.0)), "camera": EYE}
    given |= {"outputs": ("image",), "progress": False}
    if options.get("method") is None:
        given |= {"method": "photon", "photons": 3000}
    return mcrt.simulate(NOISE, backend=backend, **given | options)


def plain():
    return run().image()


def harmonics():
    return run(phase=mcrt.HenyeyGreenstein(0.6), angular=2).image(OTHER)


def sky():
    light, glow = mcrt.EnvironmentLight(SKY), NOISE[::-1].copy()
    medium = mcrt.Medium(NOISE, albedo=NOISE, emission=glow)
    return mcrt.simulate(
        medium, light=light, camera=EYE, method="path", spp=2, backend="cpu", progress=False
    ).image()


def single():
    return run(method="single").image(OTHER)


def explained():
    return np.frombuffer(repr(mcrt.plan(NOISE, backend="cpu")).encode(), np.uint8)


def sampled():
    return mcrt.HenyeyGreenstein(0.6).sample(1000, seed=3)


def cloud():
    return mcrt.datasets.cloud(40)


def known():
    return np.array(_mcrt.info()["threads"])


CALLS = (plain, harmonics, sky, single, explained, sampled, cloud, known)


def digest(array):
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def digests():
    """The bits of all that a process may ask the package for."""
    return [digest(call()) for call in CALLS]


def image():
    return digest(plain())


def pictured(_):
    return image()


def threads():
    return len(os.listdir("/proc/self/task"))


def in_fork(work):
    """What `work` gives in a fork, which prints it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(ALARM)
        try:
            with os.fdopen(writer, "w") as out:
                out.write(repr(work()))
            os._exit(0)
        finally:
            os._exit(1)
    os.close(writer)
    with os.fdopen(reader) as answer:
        text = answer.read()
    assert os.waitpid(child, 0)[1] == 0, text
    return text


@contextlib.contextmanager
def busy(backend="cpu"):
    """A run in another thread meanwhile."""
    end, begun = threading.Event(), threading.Event()

    def watch(fraction, info):
        begun.set()
        return not end.is_set()

    def work():
        run(backend, photons=1e12, progress=watch)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    yield
    end.set()
    thread.join()


# ------------------------------------------------------------------- each runs in its own process


def no_thread_outlives_a_call():
    before = threads()
    for call in CALLS:
        call()
        give_up = time.perf_counter() + 5
        while threads() > before and time.perf_counter() < give_up:
            time.sleep(0.01)
        assert threads() == before, f"{call.__name__} leaves {threads() - before} threads"


def threads_are_as_many_as_asked_for():
    before = threads()
    for count in (1, 3):
        seen = []

        def watch(*_, seen=seen):
            seen.append(threads())
            return len(seen) < 5

        run(photons=1e12, threads=count, progress=watch)
        assert max(seen) - before == count, seen


def children_of_each_kind():
    here = digests()
    assert in_fork(digests) == repr(here)
    for kind in ("fork", "spawn"):
        with multiprocessing.get_context(kind).Pool(1) as pool:
            assert pool.apply_async(digests).get(ALARM) == here, kind
    for kind in ("fork", "forkserver"):
        with futures.ProcessPoolExecutor(2, multiprocessing.get_context(kind)) as pool:
            assert list(pool.map(pictured, range(3), timeout=ALARM)) == here[:1] * 3, kind


def forks_while_the_parent_runs():
    here = image()
    with busy():
        for _ in range(4):
            assert in_fork(image) == repr(here)


def many_threads():
    here = image()
    with futures.ThreadPoolExecutor(4) as pool:
        assert list(pool.map(pictured, range(8))) == [here] * 8


def a_fork_hears_ctrl_c():
    plain()
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(ALARM)

        def begun(fraction, info):
            os.write(writer, b".")

        try:
            run(photons=1e12, progress=begun)
        except KeyboardInterrupt:
            os._exit(7)
        finally:
            os._exit(1)
    assert os.read(reader, 1) == b"."
    os.kill(child, signal.SIGINT)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


def forks_of_a_process_that_used_the_gpu():
    there, here = run("gpu"), image()
    assert in_fork(image) == repr(here)

    def refused():
        try:
            run("gpu")
        except mcrt.NoAdapterError as error:
            return str(error)
        return "it ran"

    text = in_fork(refused)
    for part in (f"process {os.getpid()}", "spawn", 'backend="cpu"'):
        assert part in text, text
    reason = in_fork(lambda: run("auto").plan.decisions[0])
    assert "'cpu'" in reason, reason
    assert "forked" in reason, reason
    assert "refusal" in in_fork(_mcrt.info)
    on_the_cpu = mcrt.Result(there._scene, there._settings | {"backend": "cpu"}, there._data)
    expected = repr(digest(on_the_cpu.image(OTHER)))
    assert in_fork(lambda: digest(there.image(OTHER))) == expected
    with busy("gpu"):
        for _ in range(2):
            assert in_fork(image) == repr(here)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply_async(on_the_gpu).get(ALARM) == digest(there.image())


def on_the_gpu():
    return digest(run("gpu").image())


def a_fork_may_use_the_gpu_first():
    plain()
    assert in_fork(on_the_gpu) == repr(on_the_gpu())


if __name__ == "__main__":
    getattr(sys.modules[__name__], sys.argv[1])()
