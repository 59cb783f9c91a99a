"""Reads the files of `nims map` with NumPy and SciPy and compares them with each other: python check_map.py FOLDER SENSOR."""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file


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
    # The third and the fourth column are named by the quantity.
    value, sigma = table.dtype.names[2:4]
    assert np.allclose(values[row, column], table[value], rtol=1e-5, atol=1e-9)
    assert np.allclose(sigmas[row, column], table[sigma], rtol=1e-2)
    with netcdf_file(folder / f"{sensor}.nc", mmap=False) as file:
        check_netcdf(file.variables, head, {value: values, sigma: sigmas})

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
    globe = folder / f"{sensor}.geojson"
    if globe.exists():
        check_globe(json.loads(globe.read_text())["features"], table, value, samples)
    print(f"{count} points, {len(table)} cells")


def check_netcdf(variables, head, cells):
    for axis, corner in ("x", head["xllcorner"]), ("y", head["yllcorner"]):
        centres = variables[axis][:]
        assert np.allclose(centres, corner + (np.arange(len(centres)) + 0.5) * head["cellsize"]), axis
    for name, values in cells.items():
        variable = variables[name]
        read = np.squeeze(variable[:]).copy()
        # Only a map with unknown cells has it.
        read[read == getattr(variable, "_FillValue", np.nan)] = np.nan
        assert np.allclose(read, values, rtol=1e-5, equal_nan=True), name


def check_globe(features, table, value, samples):
    """The test's site, with degrees in metres by the usual series (NGA's; not the program's radii of curvature)."""
    latitude, longitude, azimuth = 34.0722, -118.4441, math.radians(30.0)
    phi = math.radians(latitude)
    north_m = 111132.954 - 559.822 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi)
    east_m = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)

    def place(lon, lat):
        north, east = (lat - latitude) * north_m, (lon - longitude) * east_m
        # x is 30 degrees clockwise from north, y 90 degrees anticlockwise from x
        return north * math.cos(azimuth) + east * math.sin(azimuth), north * math.sin(azimuth) - east * math.cos(azimuth)

    assert len(features) == len(table), (len(features), len(table))
    for feature, row in zip(features, table, strict=True):
        corners = feature["geometry"]["coordinates"][0]
        assert corners[0] == corners[-1] and len(corners) == 5
        centre = np.mean([place(*corner) for corner in corners[:4]], axis=0)
        assert np.abs(centre - [row["x_m"], row["y_m"]]).max() < 1e-4, (centre, row)
        assert math.isclose(feature["properties"]["value"], row[value], rel_tol=1e-6, abs_tol=1e-8)
    for one in samples:
        at = place(float(one["longitude_deg"]), float(one["latitude_deg"]))
        assert math.hypot(at[0] - float(one["x_m"]), at[1] - float(one["y_m"])) < 1e-3, (one, at)


main(Path(sys.argv[1]), sys.argv[2])
