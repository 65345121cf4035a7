"""Reads a flight written for ParaView with VTK itself, and compares it with the same wake as JSON."""

import json
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader


def read(path: Path):
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    if reader.GetErrorCode():
        sys.exit(f"{path}: VTK cannot read it")
    return reader.GetOutput()


def main(collection: Path, wake: Path) -> None:
    steps = json.loads(wake.read_text())["steps"]
    sets = ET.parse(collection).getroot().find("Collection").findall("DataSet")
    assert len(sets) == 2 * len(steps), (len(sets), len(steps))
    cells = 0
    for step, parts in zip(steps, zip(sets[::2], sets[1::2], strict=True), strict=True):
        rows = step["wing_rows"]
        for part, nodes, rings in zip(
            parts,
            (step["nodes"][:rows], step["nodes"][rows - 1 :]),
            (step["circulation_m2_s"][: rows - 1], step["circulation_m2_s"][rows - 1 :]),
            strict=True,
        ):
            data = read(collection.parent / part.get("file"))
            assert float(part.get("timestep")) == step["time_s"]
            assert data.GetFieldData().GetArray("TimeValue").GetValue(0) == step["time_s"]
            corners = [corner for row in nodes for corner in row]
            points = vtk_to_numpy(data.GetPoints().GetData())
            assert points.dtype == "float64"
            assert (points[: len(corners)] == corners).all()
            assert (points[len(corners) :] == [[x, -y, z] for x, y, z in corners]).all()
            circulation = [value for row in rings for value in row]
            found = vtk_to_numpy(data.GetCellData().GetArray("circulation_m2_s"))
            assert data.GetNumberOfPolys() == 2 * len(circulation) == len(found)
            assert (found[: len(circulation)] == circulation).all()
            assert (found[len(circulation) :] == circulation).all()
            assert all(data.GetCell(i).GetNumberOfPoints() == 4 for i in range(data.GetNumberOfPolys()))
            cells += data.GetNumberOfPolys()
    print(f"VTK: {len(steps)} steps, {cells} quadrilaterals, every number as in the JSON")


main(Path(sys.argv[1]), Path(sys.argv[2]))
