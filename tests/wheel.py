"""Check the wheel in dist/: its tag; and that it installs, and runs the README's first lines.

python tests/wheel.py
"""

import re
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> None:
    (wheel,) = (ROOT / "dist").glob("*.whl")
    if sys.platform.startswith("linux") and "manylinux_2_17_" not in wheel.name:
        sys.exit(f"{wheel.name} is not for manylinux_2_17")
    fresh = ROOT / "target" / "wheel"
    venv.create(fresh, clear=True, with_pip=True)
    python = fresh / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    quiet = ["-q", "--disable-pip-version-check"]
    subprocess.run([python, "-m", "pip", "install", *quiet, wheel], check=True)
    lines = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]
    subprocess.run([python, "-I", "-c", lines + "print(result)"], check=True, cwd=fresh)
    print(f"{wheel.name}, {wheel.stat().st_size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
