#!/usr/bin/env python3
"""Times one hovering flight in PteraSoftware and in manduca, on one core of this machine, in one run."""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from environment import environment

PTERASOFTWARE = "5.1.0"
HERE = Path(__file__).resolve().parent
CHORDWISE, SPANWISE, STEPS, STROKES = 6, 12, 40, 3


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "manduca-peers",
        help="folder of the virtual environment, kept for the next run",
    )
    target = Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target"))
    parser.add_argument(
        "--manduca", type=Path, default=target / "release" / "manduca", help="program, built with --release"
    )
    parser.add_argument("--runs", type=int, default=3, help="flights of each; medians are compared")
    parser.add_argument("--core", type=int, default=min(os.sched_getaffinity(0)), help="core both are bound to")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser.parse_args()


def bound(core):
    """Settings of a child process which has one core and knows it."""
    one = {name: "1" for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    return {"env": os.environ | one, "preexec_fn": lambda: os.sched_setaffinity(0, {core})}


def theirs(python, core):
    line = [python, HERE / "pterasoftware_case.py", CHORDWISE, SPANWISE, STEPS, STROKES, 1]
    done = subprocess.run(list(map(str, line)), check=True, stdout=subprocess.PIPE, text=True, **bound(core))
    return json.loads(done.stdout)


def ours(program, core):
    """Wall time of the whole process, and what it says."""
    settings = {
        "chordwise-panels": CHORDWISE, "spanwise-panels": SPANWISE, "steps-per-stroke": STEPS, "strokes": STROKES,
        "strokes-most": STROKES, "strokes-dropped": STROKES - 2, "wake-strokes": STROKES,
        "wake-joined-after": STROKES, "wake-tail": 0, "single-precision-wake": 0,
    }
    line = [program, "simulate", "--case", "five-ann", "--json"]
    line += [word for name, value in settings.items() for word in (f"--{name}", value)]
    start = time.perf_counter()
    done = subprocess.run(list(map(str, line)), check=True, stdout=subprocess.PIPE, text=True, **bound(core))
    return time.perf_counter() - start, json.loads(done.stdout)


def processor():
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return "unknown"


def compare(args):
    python = environment(args.cache, f"pterasoftware-{PTERASOFTWARE}", {"PteraSoftware": PTERASOFTWARE})
    before = os.getloadavg()
    ours(args.manduca, args.core)  # Off the disk once; its time is not counted.
    slow, fast = [], []
    for _ in range(args.runs):
        # In turns, so that another load on the machine meets both.
        slow.append(theirs(python, args.core))
        fast += [ours(args.manduca, args.core) for _ in range(3)]
    flights = [flight for run in slow for flight in run["flights"]]
    runs, processes = [f["build_s"] + f["run_s"] for f in flights], [seconds for seconds, _ in fast]
    theirs_s, ours_s = statistics.median(runs), statistics.median(processes)
    flown = fast[-1][1]
    return {
        "case": f"{CHORDWISE} x {SPANWISE} panels per wing, {STEPS} steps x {STROKES} strokes, whole free wake, f64",
        "pterasoftware_s": theirs_s,
        "manduca_s": ours_s,
        "ratio": theirs_s / ours_s,
        "pterasoftware_all_s": runs,
        "manduca_all_s": processes,
        "pterasoftware_warm_up_s": [run["warm_up_s"] for run in slow],
        "pterasoftware_mean_force_last_two_strokes_n": flights[-1]["mean_force_last_two_strokes_n"],
        "manduca_mean_lift_last_two_strokes_n": flown["means"]["lift_n"]["mean"],
        "load_before": before,
        "load_after": os.getloadavg(),
        "cores": os.cpu_count(),
        "processor": processor(),
        "versions": slow[-1]["versions"] | {
            "pterasoftware": PTERASOFTWARE,
            "manduca": subprocess.run([args.manduca, "--version"], stdout=subprocess.PIPE, text=True).stdout.split()[-1],
            "solver": flown["solver_version"],
            "level": flown["level"],
        },
    }


def main():
    args = arguments()
    if not args.manduca.exists():
        sys.exit(f"error: {args.manduca} is not there: cargo build --release, or --manduca PATH")
    if args.runs < 1:
        sys.exit("error: --runs must be 1 or more")
    found = compare(args)
    if args.json:
        json.dump(found, sys.stdout, indent=2)
        print()
        return
    print(found["case"])
    print(f"PteraSoftware  {found['pterasoftware_s']:8.3f} s  built and flown, compiling not counted, one core")
    print(f"manduca        {found['manduca_s']:8.3f} s  the whole process, one core")
    print(f"ratio          {found['ratio']:8.1f}")
    loads = [f"{found[name][0]:.2f}" for name in ("load_before", "load_after")]
    print(f"load           {loads[0]} before, {loads[1]} after, on {found['cores']} cores; {found['processor']}")
    print("versions       " + ", ".join(f"{name} {version}" for name, version in found["versions"].items()))


main()
