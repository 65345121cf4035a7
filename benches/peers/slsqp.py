#!/usr/bin/env python3
"""Finds the constrained optimum of a study's network with SciPy's SLSQP and compares it with manduca's."""

import argparse
import json
import os
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from environment import environment

SCIPY = "1.17.1"
FREQUENCY, STROKE_PLANE, SWEEP_MEAN, ROTATION_MEAN, SWEEP_SHAPE, ROTATION_SHAPE = 0, 1, 2, 4, 8, 9
BLUNT = 1 / 200


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("study", help="id of a finished study with networks")
    parser.add_argument("--name", help="one of its optimisations by `sqp`; without it the first")
    parser.add_argument("--coordinator", default="http://127.0.0.1:8080", help="where the study is")
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "manduca-peers",
        help="folder of the virtual environment, kept for the next run",
    )
    parser.add_argument("--starts", type=int, default=64, help="points of a scrambled Sobol sequence")
    parser.add_argument("--seed", type=int, default=0, help="seed of its scrambling")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser.parse_args()


class Surrogate:
    """L+, D+, M+, P+ over a box, and their derivatives by complex steps, which are exact."""

    def __init__(self, surrogate, box):
        import numpy

        self.np = numpy
        self.frame, self.sharp = surrogate["frame"], surrogate["frame"].get("sharpness", False)
        self.networks = []
        for network in surrogate["networks"]:
            lower, upper = (numpy.array(network["bounds"][end]) for end in ("lower", "upper"))
            biases = numpy.array(network["hidden_biases"])
            weights = numpy.array(network["hidden_weights"]).reshape(len(biases), 10)
            # A held parameter is 0 to the network, whatever its value.
            weights[:, upper <= lower] = 0.0
            outputs = numpy.array(network["output_weights"]).reshape(4, len(biases))
            span = numpy.where(upper > lower, upper - lower, 1.0)
            self.networks.append((lower, span, weights, biases, outputs, numpy.array(network["output_biases"])))
        # The box is searched in what the networks are given: there their outputs change evenly.
        self.lower, self.upper = (self.given(numpy.array(box[end])) for end in ("lower", "upper"))
        self.free = self.upper > self.lower

    def given(self, x):
        """A stroke's parameters as networks are given them."""
        x = self.np.array(x)
        if self.sharp:
            x[..., SWEEP_SHAPE] = -self.np.log(1 - x[..., SWEEP_SHAPE] ** 2 + BLUNT)
            x[..., ROTATION_SHAPE] = self.np.log(1 + x[..., ROTATION_SHAPE] ** 2)
        return x

    def mean(self, x):
        """The networks' mean."""
        def one(lower, span, weights, biases, outputs, offsets):
            return self.np.tanh((2 * (x - lower) / span - 1) @ weights.T + biases) @ outputs.T + offsets

        return sum(one(*network) for network in self.networks) / len(self.networks)

    def value(self, unit):
        """At points of the box from 0 to 1, each a row."""
        np = self.np
        x = self.lower + (self.upper - self.lower) * unit
        y = self.mean(x)
        if self.frame["features"] == "paper":
            return y
        if self.frame["mirror"]:
            image = x.copy()
            image[..., [SWEEP_MEAN, ROTATION_MEAN]] *= -1
            y = (y + self.mean(image) * np.array([1, -1, -1, 1])) / 2
        ratio = x[..., FREQUENCY] / self.frame["reference_hz"]
        tilt = x[..., STROKE_PLANE] * (np.pi / 180)
        normal, along, hinge = (y[..., k] * ratio**2 for k in range(3))
        moment = hinge - (self.frame["arm"][0] * normal - self.frame["arm"][1] * along)
        lift = normal * np.cos(tilt) - along * np.sin(tilt)
        drag = -(along * np.cos(tilt) + normal * np.sin(tilt))
        return np.stack([lift, drag, moment, y[..., 3] * ratio**3], axis=-1)

    def jacobian(self, unit):
        steps = unit + 1e-30j * self.np.eye(10)
        # Rows in one piece: SciPy's compiled solver takes nothing else.
        return self.np.ascontiguousarray(self.value(steps).imag.T) / 1e-30


def minimise(surrogate, starts, seed):
    """The best of many descents: power and violation; and how many succeeded."""
    import numpy
    from scipy.optimize import minimize
    from scipy.stats import qmc

    target = numpy.array([1.0, 0.0, 0.0])
    trim = {
        "type": "eq",
        "fun": lambda u: surrogate.value(u)[:3] - target,
        "jac": lambda u: surrogate.jacobian(u)[:3],
    }
    best, succeeded = None, 0
    for start in qmc.Sobol(10, seed=seed).random(starts):
        found = minimize(
            lambda u: surrogate.value(u)[3], start, jac=lambda u: surrogate.jacobian(u)[3], method="SLSQP",
            bounds=[(0.0, 1.0 if free else 0.0) for free in surrogate.free], constraints=[trim],
            options={"ftol": 1e-14, "maxiter": 500},
        )
        violation = float(abs(surrogate.value(found.x)[:3] - target).max())
        if violation > 1e-9:
            continue
        succeeded += 1
        if best is None or found.fun < best["power"]:
            best = {"power": float(found.fun), "violation": violation}
    return best, succeeded


def fetch(args, path):
    with urllib.request.urlopen(args.coordinator + path, timeout=60) as answer:
        return json.load(answer)


def asked(args):
    """The task of an optimisation, and the power manduca found."""
    study = fetch(args, f"/v1/studies/{args.study}")
    for ordinal, optimisation in enumerate(study["optimisations"]):
        found = optimisation.get("optimum") or {}
        if args.name in (None, optimisation["name"]) and found.get("optimality"):
            jobs = fetch(args, f"/v1/studies/{args.study}/jobs?kind=optimise&limit=1000")["items"]
            job = next(job for job in jobs if job["role"] == "optimise" and job["ordinal"] == ordinal)
            return fetch(args, f"/v1/jobs/{job['id']}/task"), found["predicted"]["power"]
    sys.exit("error: the study has no such optimisation by `sqp`; `manduca optimise` adds one")


def main():
    args = arguments()
    if os.environ.get("MANDUCA_PEER") != "1":
        python = environment(args.cache, f"scipy-{SCIPY}", {"scipy": SCIPY})
        os.execve(python, [python, __file__, *sys.argv[1:]], os.environ | {"MANDUCA_PEER": "1"})
    task, expected = asked(args)
    surrogate = Surrogate(task["surrogate"], task["bounds"])
    start = time.perf_counter()
    best, succeeded = minimise(surrogate, args.starts, args.seed)
    seconds = time.perf_counter() - start
    if best is None:
        sys.exit("error: no descent reached trim")
    difference = best["power"] - expected
    agrees = abs(difference) <= 1e-9 * max(1.0, abs(expected))
    report = {
        "scipy": SCIPY, "starts": args.starts, "succeeded": succeeded, "seconds": seconds, **best,
        "manduca": expected, "difference": difference, "agrees": agrees,
    }
    if args.json:
        json.dump(report, sys.stdout, indent=2)
        print()
    else:
        for name, value in report.items():
            print(f"{name:12} {value}")
    if not agrees:
        sys.exit(1)


main()
