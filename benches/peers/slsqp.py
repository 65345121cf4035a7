#!/usr/bin/env python3
"""Finds the constrained optimum of a network with SciPy's SLSQP and compares it with manduca's."""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from environment import environment

SCIPY = "1.17.1"


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("network", type=Path, help="JSON with bounds, hidden_weights, hidden_biases, output_weights, "
                        "output_biases, as `network` of a training's result")
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "manduca-peers",
        help="folder of the virtual environment, kept for the next run",
    )
    parser.add_argument("--expected", type=float, help="least P+ that manduca found; the exit code is 1 where 9 digits differ")
    parser.add_argument("--starts", type=int, default=256, help="points of a scrambled Sobol sequence")
    parser.add_argument("--seed", type=int, default=0, help="seed of its scrambling")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser.parse_args()


class Network:
    """Values and derivatives in unit coordinates."""

    def __init__(self, numbers):
        import numpy

        self.tanh = numpy.tanh
        bounds = numbers["bounds"]
        self.lower, self.upper = numpy.array(bounds["lower"]), numpy.array(bounds["upper"])
        self.bias = numpy.array(numbers["hidden_biases"])
        self.weights = numpy.array(numbers["hidden_weights"]).reshape(len(self.bias), 10)
        # A held parameter is 0 to the network, whatever its value.
        self.free = self.upper > self.lower
        self.weights[:, ~self.free] = 0.0
        self.outputs = numpy.array(numbers["output_weights"]).reshape(4, len(self.bias))
        self.output_biases = numpy.array(numbers["output_biases"])

    def value(self, unit):
        return self.outputs @ self.tanh(self.weights @ (2 * unit - 1) + self.bias) + self.output_biases

    def jacobian(self, unit):
        active = self.tanh(self.weights @ (2 * unit - 1) + self.bias)
        return 2 * (self.outputs * (1 - active**2)) @ self.weights


def minimise(network, starts, seed):
    """The best of many descents: power, point in table units, violation; and how many succeeded."""
    import numpy
    from scipy.optimize import minimize
    from scipy.stats import qmc

    target = numpy.array([1.0, 0.0, 0.0])
    trim = {
        "type": "eq",
        "fun": lambda u: network.value(u)[:3] - target,
        "jac": lambda u: network.jacobian(u)[:3],
    }
    best, succeeded = None, 0
    for start in qmc.Sobol(10, seed=seed).random(starts):
        found = minimize(
            lambda u: network.value(u)[3], start, jac=lambda u: network.jacobian(u)[3], method="SLSQP",
            bounds=[(0.0, 1.0 if free else 0.0) for free in network.free], constraints=[trim],
            options={"ftol": 1e-14, "maxiter": 500},
        )
        violation = float(abs(network.value(found.x)[:3] - target).max())
        if violation > 1e-9:
            continue
        succeeded += 1
        if best is None or found.fun < best["power"]:
            point = network.lower + (network.upper - network.lower) * found.x
            best = {"power": float(found.fun), "parameters": point.tolist(), "violation": violation}
    return best, succeeded


def main():
    args = arguments()
    if os.environ.get("MANDUCA_PEER") != "1":
        python = environment(args.cache, f"scipy-{SCIPY}", {"scipy": SCIPY})
        os.execve(python, [python, __file__, *sys.argv[1:]], os.environ | {"MANDUCA_PEER": "1"})
    network = Network(json.loads(args.network.read_text()))
    start = time.perf_counter()
    best, succeeded = minimise(network, args.starts, args.seed)
    seconds = time.perf_counter() - start
    if best is None:
        sys.exit("error: no descent reached trim")
    report = {"scipy": SCIPY, "starts": args.starts, "succeeded": succeeded, "seconds": seconds, **best}
    agrees = None
    if args.expected is not None:
        report["expected"] = args.expected
        report["difference"] = best["power"] - args.expected
        agrees = abs(report["difference"]) <= 1e-9 * max(1.0, abs(args.expected))
        report["agrees"] = agrees
    if args.json:
        json.dump(report, sys.stdout, indent=2)
        print()
    else:
        for name, value in report.items():
            print(f"{name:12} {value}")
    if agrees is False:
        sys.exit(1)


main()
