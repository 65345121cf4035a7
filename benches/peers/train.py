#!/usr/bin/env python3
"""Times one iteration of Levenberg-Marquardt on a 10-h-4 network in pyrenn and in manduca, in one run."""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
from pathlib import Path

from environment import environment

PACKAGES = {"pyrenn": "0.1", "numpy": "1.26.4", "pandas": "2.2.3"}
HERE = Path(__file__).resolve().parent
BAR = 10.0


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
    parser.add_argument("--neurons", type=int, default=500, help="hidden neurons of both")
    parser.add_argument("--samples", type=int, default=4000, help="samples which are fitted by both")
    parser.add_argument("--runs", type=int, default=2, help="iterations of pyrenn; medians are compared")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser.parse_args()


def theirs(python, args):
    line = [python, HERE / "pyrenn_case.py", args.neurons, args.samples, args.runs]
    done = subprocess.run(list(map(str, line)), check=True, stdout=subprocess.PIPE, text=True)
    # It also prints why it stopped.
    return json.loads(done.stdout.splitlines()[-1])


def ours(args):
    samples = round(args.samples / 0.8)
    line = [args.manduca, "bench", "surrogate", "--neurons", args.neurons, "--samples", samples, "--json"]
    done = subprocess.run(list(map(str, line)), check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)


def main():
    args = arguments()
    python = environment(args.cache, f"pyrenn-{PACKAGES['pyrenn']}", PACKAGES)
    before = ours(args)
    peer = theirs(python, args)
    after = ours(args)
    method = {}
    for name in ("lm_iteration_s", "vp_iteration_s"):
        own = statistics.median([before[name], after[name]])
        method[name] = {"manduca_s": own, "ratio": statistics.median(peer["iteration_s"]) / own}
    report = {
        "neurons": args.neurons, "samples": args.samples, "cores": os.cpu_count(), "load": os.getloadavg()[0],
        "pyrenn_s": statistics.median(peer["iteration_s"]), "versions": PACKAGES, **method,
        "bar": BAR, "met": method["lm_iteration_s"]["ratio"] >= BAR,
    }
    if args.json:
        print(json.dumps(report, indent=2))
        return
    print(f"10-{args.neurons}-4, {args.samples} samples, {os.cpu_count()} cores, load {report['load']:.1f}")
    print(f"pyrenn {PACKAGES['pyrenn']}: {report['pyrenn_s']:.2f} s an iteration")
    for name, what in (("lm_iteration_s", "Levenberg-Marquardt"), ("vp_iteration_s", "variable projection")):
        print(f"manduca, {what}: {method[name]['manduca_s']:.2f} s, {method[name]['ratio']:.1f} times faster")
    print(f"bar {BAR:g}: {'met' if report['met'] else 'missed'}")


main()
