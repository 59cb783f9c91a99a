"""Reads the files of `nims map` with NumPy alone and compares them with each other: python check_map.py FOLDER SENSOR."""

import csv
import sys
from pathlib import Path

import numpy as np


def ascii_grid(path):
    lines = path.read_text().splitlines()
    head = {key.lower(): float(value) for key, value in (line.split() for line in lines[:6])}
    cells = np.loadtxt(lines[6:], ndmin=2)
    assert cells.shape == (head["nrows"], head["ncols"]), (cells.shape, head)
    cells[cells == head["nodata_value"]] = np.nan
    # the first line is the highest row
    return head, cells[::-1]


def main(folder, sensor):
    head, values = ascii_grid(folder / f"{sensor}.asc")
    _, sigmas = ascii_grid(folder / f"{sensor}-sigma.asc")
    assert (np.isnan(values) == np.isnan(sigmas)).all()
    assert (sigmas[~np.isnan(sigmas)] > 0).all()

    table = np.genfromtxt(folder / f"{sensor}-grid.csv", delimiter=",", names=True)
    assert len(table) == np.count_nonzero(~np.isnan(values))
    column = np.rint((table["x_m"] - head["xllcorner"]) / head["cellsize"] - 0.5).astype(int)
    row = np.rint((table["y_m"] - head["yllcorner"]) / head["cellsize"] - 0.5).astype(int)
    assert np.allclose(values[row, column], table["value"], rtol=1e-5, atol=1e-9)
    assert np.allclose(sigmas[row, column], table["sigma"], rtol=1e-2)

    lines = (folder / f"{sensor}.ply").read_text().splitlines()
    end = lines.index("end_header")
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[-1])
    points = np.loadtxt(lines[end + 1 :], ndmin=2)
    assert points.shape == (count, 4), points.shape
    inside = (points[:, 0] >= head["xllcorner"]) & (points[:, 0] < head["xllcorner"] + head["cellsize"] * head["ncols"])
    assert inside.all()

    with open(folder / f"{sensor}.csv", newline="") as file:
        samples = list(csv.DictReader(file))
    assert len(samples) == count, (len(samples), count)
    assert np.allclose([float(one["x_m"]) for one in samples], points[:, 0])
    print(f"{count} points, {len(table)} cells")


main(Path(sys.argv[1]), sys.argv[2])
