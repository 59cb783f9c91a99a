//! Writes the cells of a map for other programs: ESRI ASCII grids, CSV, GeoJSON, and plots.

use super::columns::mapped;
use super::draw::{self, Plot};
use super::globe::{self, Globe};
use command::{Answer, Failure};
use georeference::SensorMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Value of an unknown cell in an ESRI ASCII grid.
const NODATA: i32 = -9999;

/// Writes the files of the cells of a map and returns their paths.
///
/// # Errors
/// A file cannot be written.
pub(super) fn write(
    folder: &Path,
    name: &str,
    map: &SensorMap,
    track: &[[f64; 3]],
    globe: Option<&Globe>,
) -> Answer<Vec<PathBuf>> {
    let mut written = Vec::new();
    let mut file = |name: String, text: String| -> Answer {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| write_failure(&path, &error))?;
        written.push(path);
        Ok(())
    };
    let of = |pick: fn((f64, f64)) -> f64| -> Vec<Option<f64>> {
        map.grid().spec().places().map(|(column, row)| map.value(column, row).map(pick)).collect()
    };
    let (values, sigmas) = (of(|cell| cell.0), of(|cell| cell.1));
    file(format!("{name}.asc"), ascii_grid(map, &values))?;
    file(format!("{name}-sigma.asc"), ascii_grid(map, &sigmas))?;
    file(format!("{name}-grid.csv"), grid_table(map))?;
    if let Some(cells) = globe.and_then(|globe| globe::cells(map, globe)) {
        file(format!("{name}.geojson"), cells.to_string())?;
    }
    let [quantity, unit] = map.names();
    let quantity = if quantity.is_empty() { "value" } else { quantity };
    let with_unit = if unit.is_empty() { quantity.to_owned() } else { format!("{quantity}, {unit}") };
    let plane = map.plane();
    let spec = map.grid().spec();
    let plot = |title: String, label: String, values: Vec<Option<f64>>, from_zero: bool| Plot {
        title,
        label,
        axes: plane.axes(),
        origin_m: spec.origin_m,
        cell_m: spec.cell_m,
        columns: spec.columns,
        rows: spec.rows,
        values,
        path: track.iter().map(|place| plane.project(*place)).collect(),
        from_zero,
    };
    let main = plot(format!("{name}: {with_unit}"), with_unit.clone(), values, false);
    written.extend(draw::save(&folder.join(name), &main)?);
    let unsure = plot(format!("{name}: standard deviation of {with_unit}"), with_unit, sigmas, true);
    written.extend(draw::save(&folder.join(format!("{name}-sigma")), &unsure)?);
    Ok(written)
}

/// Formats an ESRI ASCII grid; the format starts with the highest row.
fn ascii_grid(map: &SensorMap, values: &[Option<f64>]) -> String {
    let spec = map.grid().spec();
    let [x, y] = spec.origin_m;
    // Writing to a string cannot fail.
    let mut text = String::new();
    let _ = write!(
        text,
        "ncols {}\nnrows {}\nxllcorner {x}\nyllcorner {y}\ncellsize {}\nNODATA_value {NODATA}\n",
        spec.columns, spec.rows, spec.cell_m
    );
    for row in values.chunks(spec.columns).rev() {
        for (at, value) in row.iter().enumerate() {
            let between = if at == 0 { "" } else { " " };
            let _ = match value {
                Some(value) => write!(text, "{between}{value:.6e}"),
                None => write!(text, "{between}{NODATA}"),
            };
        }
        text.push('\n');
    }
    text
}

/// Formats the known cells, one row each.
fn grid_table(map: &SensorMap) -> String {
    let spec = map.grid().spec();
    let [a, b] = map.plane().axes();
    let place = format!("{a}_m,{b}_m");
    let rest = format!("slope_{a}_per_m,slope_{b}_per_m,structure,radius_m,samples");
    let others: Vec<&str> = place.split(',').chain(rest.split(',')).collect();
    let names = mapped(map.names(), &others).join(",");
    let mut text = format!("{place},{names},{rest}\n");
    for (column, row) in spec.places() {
        let (Some(cell), Some((value, sigma))) = (map.grid().cell(column, row), map.value(column, row)) else {
            continue;
        };
        let [x, y] = spec.centre(column, row);
        let [gx, gy] = cell.gradient_per_m;
        let (structure, radius, samples) = (cell.structure, cell.radius_m, cell.samples);
        let _ = writeln!(
            text,
            "{x:.6},{y:.6},{value:.9e},{sigma:.3e},{gx:.6e},{gy:.6e},{structure:.3e},{radius:.4},{samples}"
        );
    }
    text
}

pub(super) fn write_failure(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::NotNow(format!("{} cannot be written: {error}", path.display()))
}
