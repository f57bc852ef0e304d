"""Mutants: small mutations of the product, each of which some test should notice (`make mutants`).

`mutants.toml` lists them. All are put into a copy of the tree under target/mutants, which is built
once: in the copy, and only there, each place of the Rust sources holds the product's expression and
its mutations, and MCRT_MUTANT says which one runs. Python and shaders are replaced as text when
their turn comes; the copy reads its shaders from files. The unmutated copy must pass all tests that
the mutants are to fail.

    python tests/mutants.py [PART OF A NAME ...]
"""

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "target" / "mutants"
COPY = WORK / "tree"
SECONDS = 900  # of one test; a mutant that never ends has been noticed too

# What the copy has besides: the number of the mutant that runs, and shaders from files.
CHOICE = """
/// The mutant that runs: of the copy alone.
pub mod mutants {
    use std::sync::LazyLock;
    static CHOSEN: LazyLock<usize> = LazyLock::new(|| {
        std::env::var("MCRT_MUTANT").ok().and_then(|number| number.parse().ok()).unwrap_or(0)
    });
    /// Whether it is this one.
    #[inline(always)]
    pub fn is(number: usize) -> bool {
        *CHOSEN == number
    }
}
"""
SHADERS = "found.map(|(_, text)| (*text).to_string())"
FROM_FILES = (
    'found.and_then(|(name, _)| std::fs::read_to_string(format!("{}/shaders/{name}.wgsl", '
    'env!("CARGO_MANIFEST_DIR"))).ok())'
)
# Faster to build than the product, and hardly slower.
BUILD = [
    "--release",
    *("--config", "profile.release.package.mcrt.opt-level=2"),
    *("--config", "profile.release.package.mcrt.codegen-units=16"),
    *("--config", "profile.release.package.mcrt.debug=0"),
]


class Mutant:
    """One of the list, with its number from 1 on."""

    def __init__(self, number, name, file, find, replace, tests, within=None, lives=""):
        self.number, self.name, self.file = number, name, file
        self.find, self.replace, self.tests, self.lives = find, replace, tests, lives
        self.within = within or find

    def place(self, text):
        """Where `find` stands in a file's text; an error if the pair no longer applies."""
        for part, whole in ((self.within, text), (self.find, self.within)):
            if whole.count(part) != 1:
                sys.exit(f"{self.name}: {part!r} occurs {whole.count(part)} times in {self.file}")
        at = text.index(self.within) + self.within.index(self.find)
        return at, at + len(self.find)


def read():
    listed = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text())["mutant"]
    mutants = [Mutant(number, **entry) for number, entry in enumerate(listed, 1)]
    for mutant in mutants:
        mutant.place((ROOT / mutant.file).read_text())
    return mutants


def with_mutants(text, mutants):
    """A Rust file's text in which each place chooses between what it was and its mutants."""
    places = defaultdict(list)
    for mutant in mutants:
        places[mutant.place(text)].append(mutant)
    for (start, end), here in sorted(places.items(), reverse=True):
        chosen = f"{{ {text[start:end]} }}"
        for mutant in reversed(here):
            chosen = f"if crate::mutants::is({mutant.number}) {{ {mutant.replace} }} else {chosen}"
            chosen = chosen if mutant is here[0] else f"{{ {chosen} }}"
        text = text[:start] + f"({chosen})" + text[end:]
    return text


def write(path, text):
    """Writes what has changed, so that what has not is not built again."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def copy(mutants):
    """The tree with all mutants of Rust sources in it."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    names = {name for name in files.split("\0") if name and (ROOT / name).is_file()}
    for old in [path for path in COPY.rglob("*") if path.is_file()]:
        name = str(old.relative_to(COPY))
        if name not in names and old.suffix not in {".so", ".pyc"}:
            old.unlink()
    for name in names:
        source, target = ROOT / name, COPY / name
        if source.suffix != ".rs":
            if not target.exists() or target.read_bytes() != source.read_bytes():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, target)
            continue
        text = with_mutants(source.read_text(), [m for m in mutants if m.file == name])
        if name == "src/backend/gpu/sources.rs":
            assert text.count(SHADERS) == 1, "the copy must read its shaders from files"
            text = text.replace(SHADERS, FROM_FILES)
        if name == "src/lib.rs":
            head, body = text.split("\n\n", 1)
            text = f"{head}\n\n#![allow(unused_parens)]\n{body}{CHOICE}"
        write(target, text)


def cargo(*arguments, folder, kept):
    """Runs cargo in the copy, with a target folder of its own that begins with what is built."""
    target = WORK / folder
    if not target.exists() and (ROOT / kept / "release").exists():
        shutil.copytree(ROOT / kept / "release", target / "release")
    environment = {"CARGO_TARGET_DIR": str(target), "PYO3_PYTHON": sys.executable}
    command = ["cargo", *arguments, *BUILD]
    done = subprocess.run(
        command, cwd=COPY, env=os.environ | environment, stdout=subprocess.PIPE, text=True
    )
    if done.returncode:
        sys.exit(f"{shlex.join(command)} failed")
    return done.stdout


def build(tests):
    """Builds the extension into the copy, and what holds its unit tests; gives the latter."""
    cargo("build", "--lib", "--features", "python", folder="python", kept="target/python")
    built = WORK / "python" / "release" / "libmcrt"
    library = next(path for path in map(built.with_suffix, (".so", ".dylib")) if path.exists())
    shutil.copy2(library, COPY / "python" / "mcrt" / "_mcrt.abi3.so")
    if not any(test.startswith("cargo ") for test in tests):
        return None
    arguments = ("test", "--no-run", "--lib", "--message-format=json")
    messages = cargo(*arguments, folder="rust", kept="target").splitlines()
    found = [json.loads(line).get("executable") for line in messages if line.startswith("{")]
    return next(path for path in reversed(found) if path)


def run(test, unit_tests, number=0):
    """How a test ended: "passes", or the name of what failed first; and its seconds."""
    start = time.perf_counter()
    environment = os.environ | {"MCRT_MUTANT": str(number), "PYTHONPATH": str(COPY / "python")}
    if test.startswith("cargo "):
        command = [unit_tests, test.removeprefix("cargo ")]
    else:
        options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "-rfE"]
        command = [sys.executable, "-m", "pytest", *options, *shlex.split(test)]
    try:
        done = subprocess.run(
            command, cwd=COPY, env=environment, capture_output=True, text=True, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return f"{test}: not over after {SECONDS} s", time.perf_counter() - start
    seconds, lines = time.perf_counter() - start, done.stdout.splitlines()
    if done.returncode == 0:
        if any(line.startswith("running 0 tests") for line in lines):
            sys.exit(f"{test}: there are no such tests")
        return "passes", seconds
    failed = [line for line in lines if line.startswith("FAILED ") or line.endswith("... FAILED")]
    if not failed:
        sys.exit(f"{test}: neither passes nor fails\n{done.stdout}\n{done.stderr}")
    name = failed[0].removeprefix("FAILED ").removeprefix("test ").removesuffix(" ... FAILED")
    return name.split(" - ")[0].removeprefix("tests/"), seconds


def meet(mutant, unit_tests):
    """What kills a mutant, or None; and the seconds that it took."""
    path, total = COPY / mutant.file, 0.0
    text = path.read_text()
    if path.suffix != ".rs":
        start, end = mutant.place(text)
        path.write_text(text[:start] + mutant.replace + text[end:])
    try:
        for test in mutant.tests:
            ended, seconds = run(test, unit_tests, mutant.number)
            total += seconds
            if ended != "passes":
                return ended, total
    finally:
        path.write_text(text) if path.suffix != ".rs" else None
    return None, total


def main(parts):
    mutants = read()
    chosen = [m for m in mutants if not parts or any(part in m.name for part in parts)]
    tests = list(dict.fromkeys(test for mutant in chosen for test in mutant.tests))
    copy(mutants)
    unit_tests = build(tests)
    failing = 0
    for test in tests:
        ended, seconds = run(test, unit_tests)
        print(f"unmutated: {ended}  {test}  {seconds:.0f} s", flush=True)
        failing += ended != "passes"
    if failing:
        sys.exit(f"{failing} tests fail without a mutant")
    living = []
    for mutant in chosen:
        killer, seconds = meet(mutant, unit_tests)
        if not killer:
            living.append(mutant)
        print(f"{mutant.name:<60} {killer or 'LIVES'}  {seconds:.0f} s", flush=True)
    print(f"{len(chosen) - len(living)} of {len(chosen)} mutants die")
    for mutant in living:
        print(f"LIVES: {mutant.name}: {mutant.lives or 'not explained'}")
    return any(not mutant.lives for mutant in living)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
