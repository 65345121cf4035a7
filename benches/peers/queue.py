#!/usr/bin/env python3
"""Times no-op jobs with results of 1 KB through manduca's coordinator, Celery, RQ, HyperQueue and PostgreSQL,
one after the other on this machine, each from a backlog which is there before its workers are."""

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from environment import environment

HERE = Path(__file__).resolve().parent
CASES = HERE / "queue_cases"
CELERY, REDIS, RQ, HYPERQUEUE = "5.7.0", "6.4.0", "2.6.1", "0.27.0"
# Celery's Redis transport imports it, and does not ask for it.
PACKAGING = "25.0"
PEERS = ["celery", "rq", "hyperqueue", "postgresql"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "manduca-peers",
        help="folder of the virtual environments, kept for the next run",
    )
    target = Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target"))
    parser.add_argument(
        "--manduca", type=Path, default=target / "release" / "manduca", help="program, built with --release"
    )
    parser.add_argument("--jobs", type=int, default=5000, help="jobs of each peer's run")
    parser.add_argument("--runs", type=int, default=1, help="runs of each; the best one counts")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="worker processes of each peer")
    parser.add_argument("--only", nargs="*", choices=PEERS, default=PEERS, help="peers to run beside manduca")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser.parse_args()


@contextmanager
def process(line, **options):
    """A child process, gone with the block."""
    child = subprocess.Popen(list(map(str, line)), **({"stdout": subprocess.DEVNULL} | options))
    try:
        yield child
    finally:
        child.terminate()
        try:
            child.wait(10)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@contextmanager
def redis(folder):
    """A Redis which keeps nothing on disk, as both queues are usually run; its port."""
    port = free_port()
    line = ["redis-server", "--port", port, "--bind", "127.0.0.1", "--save", "", "--appendonly", "no", "--dir", folder]
    with process(line):
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        yield port


def case(python, name, *words):
    """Runs a script of `queue_cases` in its environment; what it prints as JSON."""
    line = [python, CASES / name, *words]
    done = subprocess.run(list(map(str, line)), check=True, stdout=subprocess.PIPE, text=True, cwd=CASES)
    return json.loads(done.stdout.splitlines()[-1])


def celery(args):
    python = environment(args.cache, f"celery-{CELERY}", {"celery": CELERY, "redis": REDIS, "packaging": PACKAGING})
    with tempfile.TemporaryDirectory() as folder, redis(folder) as port:
        # A worker fetches 16 jobs for each of its processes at once.
        return {16: case(python, "celery_case.py", port, args.jobs, args.workers, 16)}


def rq(args):
    python = environment(args.cache, f"rq-{RQ}", {"rq": RQ, "redis": REDIS})
    with tempfile.TemporaryDirectory() as folder, redis(folder) as port:
        return {1: case(python, "rq_case.py", port, args.jobs, args.workers)}


def hyperqueue(args):
    python = environment(args.cache, f"hyperqueue-{HYPERQUEUE}", {"hyperqueue": HYPERQUEUE})
    return {1: case(python, "hyperqueue_case.py", args.jobs, args.workers)}


def postgresql(args):
    """pgbench plays the workers: claim with `skip locked`, then complete, each committed to disk."""
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    if not folders:
        raise FileNotFoundError("PostgreSQL is not installed")
    bin_ = folders[-1]
    # It refuses to be run by root.
    user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
    folder = Path(tempfile.mkdtemp(prefix="manduca-postgresql-"))
    try:
        if user:
            shutil.chown(folder, "postgres")
        run = lambda *line, **options: subprocess.run(
            [*user, *map(str, line)], check=True, stdout=subprocess.PIPE, text=True, cwd=folder, **options
        ).stdout
        run(bin_ / "initdb", "-D", folder / "data", "-A", "trust")
        port = free_port()
        server = [*user, bin_ / "postgres", "-D", folder / "data", "-p", port, "-k", folder, "-c", "max_connections=100"]
        at = ["-h", folder, "-p", port]
        with process(server, cwd=folder, stderr=subprocess.DEVNULL):
            for _ in range(200):
                if subprocess.run([*user, bin_ / "pg_isready", *map(str, at)], stdout=subprocess.DEVNULL).returncode == 0:
                    break
                time.sleep(0.05)
            psql = shutil.which("psql") or bin_ / "psql"
            found = {}
            for batch, clients in [(1, 64), (16, 64), (100, 8)]:
                run(psql, *at, "-q", "postgres", input=(CASES / "postgresql.sql").read_text())
                turns = max(1, args.jobs // (batch * clients))
                script = (CASES / "pgbench.sql").read_text().replace("BATCH", str(batch))
                start = time.perf_counter()
                run(bin_ / "pgbench", *at, "-n", "-c", clients, "-j", 2, "-t", turns, "-f", "-", "postgres", input=script)
                seconds = time.perf_counter() - start
                ended = int(run(psql, *at, "-At", "-c", "select count(*) from jobs where state = 2", "postgres"))
                found[batch] = {"jobs_s": ended / seconds, "jobs": ended}
            return found
    finally:
        shutil.rmtree(folder)


def ours(args):
    line = [args.manduca, "bench", "queue", "--json", "--idle", 0, "--runs", args.runs]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(list(map(str, [*line, "--folder", folder])), check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)


def compare(args):
    before = os.getloadavg()
    mine = ours(args)
    found, failed = {}, {}
    for name in args.only:
        for _ in range(args.runs):
            try:
                run = globals()[name](args)
            except (OSError, subprocess.CalledProcessError) as error:
                failed[name] = str(error)
                break
            for batch, one in run.items():
                key = f"{name}, batch {batch}"
                if key not in found or one["jobs_s"] > found[key]["jobs_s"]:
                    found[key] = one | {"ratio": mine[f"batch_{batch}_jobs_s"] / one["jobs_s"]}
    return {
        "manduca": mine, "peers": found, "failed": failed, "jobs": args.jobs, "workers": args.workers,
        "load_before": before, "load_after": os.getloadavg(), "cores": os.cpu_count(),
        "versions": {"celery": CELERY, "rq": RQ, "redis-py": REDIS, "hyperqueue": HYPERQUEUE},
    }


NOTES = {
    "celery": "prefork, Redis in memory: not durable",
    "rq": "SimpleWorker (no process per job), Redis in memory: not durable",
    "hyperqueue": "a process per job (`true`), no result stored, no journal: not durable",
    "postgresql": "skip locked, a commit per claim and per completion, no HTTP, no checks: durable",
}


def main():
    args = arguments()
    if not args.manduca.exists():
        sys.exit(f"error: {args.manduca} is not there: cargo build --release, or --manduca PATH")
    if args.runs < 1 or args.jobs < 100 or args.workers < 1:
        sys.exit("error: --runs and --workers must be 1 or more, --jobs 100 or more")
    found = compare(args)
    if args.json:
        json.dump(found, sys.stdout, indent=2)
        print()
    else:
        print(f"{'queue':24} {'jobs/s':>9} {'manduca is faster by':>21}")
        for batch in (1, 16, 100):
            print(f"{f'manduca, batch {batch}':24} {found['manduca'][f'batch_{batch}_jobs_s']:9.0f} {'':21} over HTTP: durable")
        for name, one in found["peers"].items():
            print(f"{name:24} {one['jobs_s']:9.0f} {one['ratio']:20.1f}x {NOTES[name.split(',')[0]]}")
        loads = [f"{found[name][0]:.2f}" for name in ("load_before", "load_after")]
        print(f"load {loads[0]} before, {loads[1]} after, on {found['cores']} cores; {found['workers']} workers each")
    for name, why in found["failed"].items():
        print(f"error: {name}: {why}", file=sys.stderr)
    sys.exit(1 if found["failed"] else 0)


main()
