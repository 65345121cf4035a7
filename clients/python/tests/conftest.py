"""A live coordinator with one worker, and studies small enough for tests."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import manduca

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parents[3]
SAMPLES = 40


def binary() -> str:
    target = Path(os.environ.get("CARGO_TARGET_DIR") or "target")
    places = [REPOSITORY / target / profile / "manduca" for profile in ("release", "debug")]
    found = os.environ.get("MANDUCA") or next((str(p) for p in places if p.exists()), None)
    found = found or shutil.which("manduca")
    if not found:
        pytest.exit("there is no manduca to test against: cargo build, or name one in MANDUCA", returncode=2)
    return found


def start(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    # Settings of the developer's, such as MANDUCA_LISTEN, are not for tests.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MANDUCA")}
    with (folder / f"{arguments[0]}.log").open("wb") as log:
        return subprocess.Popen([binary(), *arguments], stdout=log, stderr=log, cwd=folder, env=environment)


@pytest.fixture(autouse=True)
def _no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MANDUCA_COORDINATOR", "MANDUCA_TOKEN", "MANDUCA_STUDY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[manduca.Client]:
    """Start a coordinator and a worker, and stop them after the last test."""
    folder = tmp_path_factory.mktemp("manduca")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    serving = start(folder, "serve", "--listen", address, "--data", str(folder / "data"))
    working = start(folder, "worker", "--coordinator", f"http://{address}", "--slots", "2")
    client = manduca.Client(f"http://{address}")
    try:
        for _ in range(100):
            try:
                if any(worker["alive"] for worker in client.workers()):
                    break
            except manduca.UnreachableError:
                assert serving.poll() is None, (folder / "serve.log").read_text()
            time.sleep(0.2)
        yield client
    finally:
        # The worker first: it delivers what it has to a coordinator which is there.
        for process in (working, serving):
            process.terminate()
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="session")
def study(client: manduca.Client) -> manduca.Study:
    """A finished study of blade elements: a sample takes no time worth mentioning."""
    study = client.submit(blades("blades"))
    study.wait(progress=False, timeout_s=120)
    return study


def blades(name: str) -> dict[str, Any]:
    return {
        "name": name,
        "seed": 1,
        "model": {"kind": "quasi-steady"},
        "sampling": {"samples": SAMPLES},
        "surrogate": {"neurons": 6, "max_iterations": 30},
        "optimisations": [{"name": "free", "starts": 10, "verify_strokes": 4, "refine_simulations": 12}],
    }
