"""Asks an ONNX model and the coordinator for the same strokes."""

import json
import sys
from urllib.request import Request, urlopen

import numpy
import onnxruntime

OUTPUTS = ("lift", "drag", "pitch_moment", "power")


def main(path: str, coordinator: str) -> None:
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    facts = session.get_modelmeta().custom_metadata_map
    inputs = json.loads(facts["inputs"])
    names = [entry["name"] for entry in inputs]
    assert [entry["name"] for entry in json.loads(facts["outputs"])] == list(OUTPUTS)
    lower = numpy.array([entry["trained_between"][0] for entry in inputs])
    upper = numpy.array([entry["trained_between"][1] for entry in inputs])
    points = lower + (upper - lower) * numpy.random.default_rng(1).random((500, len(names)))
    (given,) = session.get_inputs()
    assert (given.name, given.type) == ("parameters", "tensor(double)")
    (found,) = session.run(["means"], {"parameters": points})
    body = json.dumps({"points": [dict(zip(names, row, strict=True)) for row in points.tolist()]}).encode()
    path = f"/v1/studies/{facts['study']}/surrogate/predictions"
    with urlopen(Request(coordinator + path, body, {"content-type": "application/json"})) as answer:
        told = json.load(answer)["predictions"]
    expected = numpy.array([[row[name] for name in OUTPUTS] for row in told])
    worst = float(numpy.abs(found - expected).max())
    assert worst < 1e-9, worst
    print(f"onnxruntime {onnxruntime.__version__}: 500 strokes, largest difference {worst:.1e}")


main(sys.argv[1], sys.argv[2])
