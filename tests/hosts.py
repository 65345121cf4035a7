#!/usr/bin/env python3
"""One coordinator and three worker hosts, each with a network stack and an address of its own.

    cargo build --release
    sudo python3 tests/hosts.py

Hosts are network namespaces joined by a bridge; Linux, root and iproute2 are needed. While a study
of `--samples` strokes is flown, host `a` is cut off for `--cut` seconds and comes back, host `c` is
added, and host `b` is drained. The dataset must have the bytes of one flown by a single slot on a
single host; both times are printed. The exit code is 1 where anything is not as it should be.
"""

import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parent.parent
PREFIX, BRIDGE, NET = "mdca-", "mdca-br", "10.213.77"
ADDRESSES = {"coordinator": 1, "a": 2, "b": 3, "c": 4}
PORT = 8080

STUDY = """
name = "hosts"
seed = 7
[model]
kind = "uvlm"
[model.solver]
chordwise_panels = 6
spanwise_panels = 6
steps_per_stroke = 24
strokes = 8
strokes_most = 8
strokes_dropped = 4
[sampling]
samples = {samples}
[surrogate]
neurons = 20
max_iterations = 20
[[optimisations]]
name = "case-I"
starts = 20
refine_simulations = 0
"""


def sh(*line: str) -> None:
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)


def inside(host: str, *line: str) -> list[str]:
    return ["ip", "netns", "exec", PREFIX + host, *line]


class Network:
    """Namespaces on one bridge."""

    def __enter__(self) -> "Network":
        self.remove()
        sh("ip", "link", "add", BRIDGE, "type", "bridge")
        sh("ip", "link", "set", BRIDGE, "up")
        sh("ip", "addr", "add", f"{NET}.254/24", "dev", BRIDGE)
        for host, number in ADDRESSES.items():
            outer, inner = f"{PREFIX}{host[:3]}o", f"{PREFIX}{host[:3]}i"
            sh("ip", "netns", "add", PREFIX + host)
            sh("ip", "link", "add", outer, "type", "veth", "peer", "name", inner)
            sh("ip", "link", "set", inner, "netns", PREFIX + host)
            sh("ip", "link", "set", outer, "master", BRIDGE)
            sh("ip", "link", "set", outer, "up")
            sh(*inside(host, "ip", "addr", "add", f"{NET}.{number}/24", "dev", inner))
            sh(*inside(host, "ip", "link", "set", inner, "up"))
            sh(*inside(host, "ip", "link", "set", "lo", "up"))
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()

    def cut(self, host: str, is_cut: bool) -> None:
        """Packets vanish, as where a cable is pulled: nobody is told that a connection ended."""
        sh("ip", "link", "set", f"{PREFIX}{host[:3]}o", "down" if is_cut else "up")

    @staticmethod
    def remove() -> None:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        for host in ADDRESSES:
            subprocess.run(["ip", "netns", "del", PREFIX + host], check=False, **quiet)
            subprocess.run(["ip", "link", "del", f"{PREFIX}{host[:3]}o"], check=False, **quiet)
        subprocess.run(["ip", "link", "del", BRIDGE], check=False, **quiet)


class Cluster:
    """Processes on the hosts, and what a client says to their coordinator."""

    def __init__(self, program: pathlib.Path, folder: pathlib.Path) -> None:
        self.program, self.folder, self.workers = program, folder, {}
        folder.mkdir()
        data = str(folder / "data")
        tokens = {}
        for scope in ("worker", "admin"):
            create = [str(program), "token", "create", scope, "--scope", scope, "--init", "--data", data]
            tokens[scope] = subprocess.run(create, check=True, capture_output=True, text=True).stdout.strip()
        self.token, self.file = tokens["admin"], folder / "worker-token"
        self.file.write_text(tokens["worker"])
        self.file.chmod(0o600)
        listen = ["serve", "--listen", f"{NET}.1:{PORT}", "--data", data]
        self.coordinator = self.start("coordinator", *listen)
        self.until("the coordinator answers", lambda: self.get("/readyz"))

    def start(self, host: str, *line: str) -> subprocess.Popen[bytes]:
        log = open(self.folder / f"{host}.log", "ab")
        return subprocess.Popen(inside(host, str(self.program), *line), stderr=log, stdout=log)

    def worker(self, host: str) -> None:
        url = f"http://{NET}.1:{PORT}"
        options = ["--coordinator", url, "--token-file", str(self.file), "--slots", "1", "--name", host]
        self.workers[host] = self.start(host, "worker", *options)

    def ask(self, method: str, path: str, body: object = None, accept: str = "application/json") -> bytes:
        headers = {"authorization": f"Bearer {self.token}", "accept": accept, "content-type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"http://{NET}.1:{PORT}{path}", data, headers, method=method)
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.read()

    def get(self, path: str) -> dict:
        return json.loads(self.ask("GET", path))

    def submit(self, samples: int) -> None:
        spec = tomllib.loads(STUDY.format(samples=samples))
        self.study = json.loads(self.ask("POST", "/v1/studies", spec))["id"]
        self.began = time.monotonic()

    def view(self) -> dict:
        return self.get(f"/v1/studies/{self.study}")

    def flown(self) -> int:
        return self.view()["samples"]["succeeded"]

    def known(self) -> dict[str, dict]:
        """The workers by name."""
        return {worker["name"]: worker for worker in self.get("/v1/workers")}

    def completed(self, host: str) -> int:
        return self.known().get(host, {"completed": 0})["completed"]

    def until(self, what: str, seen, limit: float = 3600.0) -> None:
        start = time.monotonic()
        while time.monotonic() - start < limit:
            try:
                if seen():
                    return
            except (urllib.error.URLError, OSError):
                pass
            time.sleep(0.2)
        raise SystemExit(f"gave up waiting until {what}")

    def finish(self) -> tuple[str, float]:
        self.until("the study ends", lambda: self.view()["state"] in ("succeeded", "failed", "cancelled"))
        if self.view()["state"] != "succeeded":
            raise SystemExit(f"the study ended {self.view()['state']}")
        took = time.monotonic() - self.began
        rows = self.ask("GET", f"/v1/studies/{self.study}/dataset", accept="text/csv")
        return hashlib.blake2b(rows, digest_size=16).hexdigest(), took

    def stop(self) -> None:
        for process in [*self.workers.values(), self.coordinator]:
            process.terminate()
        for process in [*self.workers.values(), self.coordinator]:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def disturbed(cluster: Cluster, network: Network, samples: int, cut: float) -> list[str]:
    """Hosts come and go; gives what was seen."""
    seen = []
    for host in ("a", "b"):
        cluster.worker(host)
    cluster.submit(samples)
    cluster.until("some strokes are flown", lambda: cluster.flown() >= samples // 20)
    network.cut("a", True)
    at = cluster.flown()
    time.sleep(cut)
    seen.append(f"host a cut off for {cut:.0f} s at {at} strokes; {cluster.flown()} when it came back")
    network.cut("a", False)
    cluster.worker("c")
    done, back = cluster.completed("a"), time.monotonic()
    cluster.until("host a works again", lambda: cluster.completed("a") > done, 120)
    seen.append(f"host a delivered again {time.monotonic() - back:.1f} s after it came back")
    cluster.until("host c works", lambda: cluster.completed("c") > 0, 120)
    cluster.ask("POST", f"/v1/workers/{cluster.known()['b']['id']}/drain")
    cluster.until("host b leaves", lambda: cluster.workers["b"].poll() is not None, 120)
    seen.append(f"host b drained at {cluster.flown()} strokes, exit code {cluster.workers['b'].returncode}")
    if cluster.workers["b"].returncode != 0 or cluster.flown() >= samples:
        raise SystemExit("; ".join([*seen, "the drain did not fall into the study, or failed"]))
    return seen


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--manduca", type=pathlib.Path, default=ROOT / "target/release/manduca")
    parser.add_argument("--samples", type=int, default=4000)
    parser.add_argument("--cut", type=float, default=60.0, help="seconds host a is cut off")
    options = parser.parse_args()
    if os.geteuid() != 0:
        parser.error("network namespaces need root")
    program = options.manduca.resolve()
    with tempfile.TemporaryDirectory() as folder, Network() as network:
        alone = Cluster(program, pathlib.Path(folder) / "alone")
        try:
            alone.worker("a")
            alone.submit(options.samples)
            serial, serial_s = alone.finish()
        finally:
            alone.stop()
        many = Cluster(program, pathlib.Path(folder) / "many")
        try:
            seen = disturbed(many, network, options.samples, options.cut)
            digest, took = many.finish()
        finally:
            many.stop()
    print("\n".join(seen))
    print(f"one slot on one host {serial_s:.1f} s, disturbed on three hosts {took:.1f} s: {serial_s / took:.2f} times as fast")
    print(f"{os.cpu_count()} cores under all hosts, load {os.getloadavg()[0]:.1f}; blake2b {serial} and {digest}")
    return 0 if digest == serial else 1


if __name__ == "__main__":
    sys.exit(main())
