"""Times iterations of pyrenn's Levenberg-Marquardt; prints one JSON object."""

import json
import sys
import time

import numpy
import pyrenn


def main():
    neurons, samples, runs = map(int, sys.argv[1:])
    rng = numpy.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, (10, samples))
    mix = rng.normal(size=(4, 10)) / 3.0
    y = numpy.tanh(mix @ x) + 0.1 * numpy.sin(3.0 * x[:4] * x[4:8])
    net = pyrenn.CreateNN([10, neurons, 4])
    times = []
    # A training of one iteration, whose first Jacobian belongs to it, as ours does.
    for _ in range(runs):
        start = time.perf_counter()
        net = pyrenn.train_LM(x, y, net, verbose=False, k_max=1, E_stop=0.0)
        times.append(time.perf_counter() - start)
    print(json.dumps({"iteration_s": times, "numpy": numpy.__version__}))


main()
