"""Virtual environments of the peers, one each, kept for the next run."""

import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent


def environment(cache, folder, packages):
    """Python of an environment in `cache/folder` with exactly these packages (name to version); made if there is none."""
    if REPOSITORY in [cache.resolve(), *cache.resolve().parents]:
        sys.exit(f"error: --cache {cache} is inside the repository")
    python = cache / folder / "bin" / "python"
    ready = python.parent.parent / "ready"
    if not ready.exists():
        pinned = [f"{name}=={version}" for name, version in packages.items()]
        print(f"installing {' '.join(pinned)} into {python.parent.parent}", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", python.parent.parent], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *pinned], check=True)
        ready.touch()
    return python
