"""A coordinator with one worker, and what is submitted to it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
TOKEN = "manduca_of_a_test_0123456789abcdef"

# A tiny vortex lattice: some tens of milliseconds a sample.
STUDY = """
name = "browser"
description = "A tiny study submitted on the page."
seed = 7

[model.solver]
chordwise_panels = 3
spanwise_panels = 4
steps_per_stroke = 12
strokes = 3
strokes_dropped = 1
wake_strokes = 0.75

[sampling]
samples = 60

[surrogate]
neurons = 6
max_iterations = 30

[[optimisations]]
name = "case-I"
starts = 20
verify_strokes = 4
refine_simulations = 20
"""


def binary() -> str:
    target = Path(os.environ.get("CARGO_TARGET_DIR") or REPOSITORY / "target")
    places = [target / profile / "manduca" for profile in ("release", "debug")]
    found = os.environ.get("MANDUCA") or next((str(p) for p in places if p.exists()), None) or shutil.which("manduca")
    if not found:
        raise SystemExit("there is no manduca to test: cargo build, or name one in MANDUCA")
    return found


class Service:
    """Processes in a folder of their own."""

    def __init__(self, token: str | None = None, *arguments: str) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="manduca-browser-"))
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{free.getsockname()[1]}"
        self.url = f"http://{address}"
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("MANDUCA")}
        if token:
            self.environment["MANDUCA_TOKEN"] = token
        self.processes = [self.start("serve", "--listen", address, "--data", str(self.folder / "data"), *arguments)]
        self.until_it_answers()
        if not token:
            self.processes.append(self.start("worker", "--coordinator", self.url, "--slots", "2"))

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{arguments[0]}.log").open("wb") as log:
            return subprocess.Popen(
                [binary(), *arguments], stdout=log, stderr=log, cwd=self.folder, env=self.environment
            )

    def until_it_answers(self) -> None:
        for _ in range(150):
            try:
                urllib.request.urlopen(f"{self.url}/healthz", timeout=2).close()
            except OSError:
                assert self.processes[0].poll() is None, (self.folder / "serve.log").read_text()
                time.sleep(0.1)
            else:
                return
        raise AssertionError("the coordinator does not answer")

    def ask(self, path: str, body: object = None) -> object:
        """Ask as a program does: with a body by POST, else by GET."""
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.url}{path}", data, {"content-type": "application/json"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def submit(self, study: str) -> str:
        """Submit a study in TOML; give its id."""
        request = urllib.request.Request(f"{self.url}/v1/studies", study.encode(), {"content-type": "application/toml"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)["id"]

    @staticmethod
    def wait(seconds: float) -> None:
        time.sleep(seconds)

    def stop(self) -> float:
        """Stop all; give how long the coordinator took, s."""
        took = 0.0
        for process in reversed(self.processes):
            began = time.monotonic()
            process.send_signal(signal.SIGTERM)
            try:
                assert process.wait(30) == 0
            finally:
                process.kill()
            took = time.monotonic() - began
        shutil.rmtree(self.folder, ignore_errors=True)
        self.processes = []
        return took
