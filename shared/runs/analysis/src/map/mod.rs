//! `nims map`: maps the sensor readings of a run as grids with uncertainty, contour plots, point clouds and tables.

mod columns;
mod contour;
mod draw;
mod extent;
mod files;
mod flown;
mod globe;
mod kinds;
mod merge;
mod netcdf;
mod read;
mod samples;

pub use contour::{contours, levels};
use extent::Extent;
use globe::Globe;
use kinds::{file_name, sensor_of};
use read::{Flown, Wanted, read_samples};
pub use read::{logger_config, sensor_settings};
use samples::SampleFiles;

use crate::runs::require_run;
use command::values::above_zero;
use command::{Answer, Failure, Output};
use georeference::{LoggerConfig, SensorMap};
use messages::Sample;
use plot::ticks;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use survey::grid::{GridMap, GridOptions, GridSpec};

/// `nims map`.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// Run folder or file.
    pub run: PathBuf,
    /// Folder for the files; default: map in the run folder, or in the folder of the run file.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Only this sensor, NAME of sensor/NAME, or NAME@2 of its second quantity, unit or type. Repeatable.
    #[arg(long, value_name = "NAME")]
    pub sensor: Vec<String>,
    /// Side of a cell, m; default: a round size with about 80 cells along the longer side.
    #[arg(long, value_name = "M", value_parser = above_zero)]
    pub cell: Option<f64>,
    /// Range of influence of a sample, m: at least half the distance of neighbouring tracks; default: four cells.
    #[arg(long, value_name = "M", value_parser = above_zero)]
    pub reach: Option<f64>,
    /// Number of the value to map, from 1; default: from the system file, otherwise the first.
    #[arg(long, value_name = "N", requires = "sensor", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub value: Option<u8>,
    /// The value is a distance straight down, m: map the height of the surface below.
    #[arg(long, requires = "sensor")]
    pub looks_down: bool,
    /// Standard deviation of a value, in its unit; default: from the system file, otherwise estimated from the scatter.
    #[arg(long, value_name = "SIGMA", requires = "sensor", value_parser = above_zero)]
    pub sigma: Option<f64>,
    /// Diameter of the sensor's footprint, m; default: from the system file, otherwise a point.
    #[arg(long, value_name = "M", requires = "sensor", value_parser = above_zero)]
    pub footprint: Option<f64>,
    /// Only samples between these coordinates across the plane of the map, m: heights, or y for a planar robot.
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], allow_negative_numbers = true)]
    pub between: Option<Vec<f64>>,
    /// Recompute the position of every reading, also of those that the sensor logger recorded.
    #[arg(long)]
    pub recompute: bool,
}

/// Default number of cells along the longer side, approximately.
const CELLS: f64 = 80.0;
/// Maximum number of cells along a side.
const MAX_CELLS: f64 = 2000.0;

/// A sensor of which a map is being made.
struct Mapped {
    map: SensorMap,
    files: SampleFiles,
}

/// Runs `nims map`. The run is read twice: the first time shows where the samples are and how many, the second time
/// each sample goes to its cell and to the files, so memory does not grow with the run.
///
/// # Errors
/// The run does not exist or has no such sensor, or a file cannot be written.
pub fn run(args: &Args) -> Answer<Output> {
    require_run(&args.run)?;
    let (robot, section, time) = read::files_of(&args.run)?;
    let mut config = read::config(&robot, &section)?;
    let globe = robot.site.as_ref().map(Globe::new);
    override_settings(&mut config, args);
    let chosen = |name: &str, sample: &Sample| {
        (args.sensor.is_empty() || args.sensor.iter().any(|wanted| wanted == name || wanted == sensor_of(name)))
            .then(|| is_between(args, config.plane.across(sample.position_m)))
    };
    let wanted = if args.recompute { Wanted::Computed } else { Wanted::All };
    let (extents, flown) = extents_of(&args.run, &config, wanted, &chosen)?;
    if let Some(absent) = args.sensor.iter().find(|name| !flown.sensors.contains(name) && !extents.contains_key(*name))
    {
        let there = if flown.sensors.is_empty() { "none".to_owned() } else { flown.sensors.join(", ") };
        return Err(Failure::BadInput(format!("the run has no sensor {absent}; available: {there}")));
    }
    let folder = args.out.clone().unwrap_or_else(|| default_folder(&args.run));
    std::fs::create_dir_all(&folder).map_err(|error| files::write_failure(&folder, &error))?;
    let mut mapped = BTreeMap::new();
    for (name, extent) in &extents {
        let begun = match empty_map(&config, name, extent, args.cell, args.reach) {
            Ok(map) => {
                let files = SampleFiles::create(&folder, &file_name(name), extent, &time, globe.as_ref())?;
                Ok(Mapped { map, files })
            }
            Err(why) => Err(why),
        };
        mapped.insert(name.clone(), begun);
    }
    read_samples(&args.run, &config, wanted, flown.read, &mut |name, _, sample| {
        if let (Some(true), Some(Ok(Mapped { map, files }))) = (chosen(name, sample), mapped.get_mut(name)) {
            map.add(sample);
            files.add(map, sample);
        }
    })?;
    let (mut values, mut words) = (Vec::new(), Vec::new());
    for (name, begun) in mapped {
        match begun {
            Ok(Mapped { mut map, files }) => {
                map.grid_mut().refresh_all();
                let (extent, globe) = (&extents[&name], globe.as_ref());
                let file = file_name(&name);
                let mut written = files::write(&folder, &file, &map, flown.path.points(), globe)?;
                written.extend(files.finish()?);
                written.push(netcdf::write(&folder, &file, &map, extent, &time, globe)?);
                let (value, sentence) = describe(&name, &map, extent, &written);
                values.push(value);
                words.push(sentence);
            }
            Err(why) => words.push(format!("{name}: no map: {why}")),
        }
    }
    if values.is_empty() {
        let why = if words.is_empty() { "no reading of a sensor got a position".to_owned() } else { words.join("; ") };
        return Err(Failure::NotNow(format!("{} has no data for a map: {why}", args.run.display())));
    }
    if flown.left_out > 0 {
        words.push(format!("{} samples are left out: their sensors have too many quantities", flown.left_out));
    }
    words.push(format!("files in {}", folder.display()));
    Ok(Output::new(json!({ "run": args.run, "folder": folder, "maps": values }), words.join("\n")))
}

/// Computes maps of the sensors of a run by name, as `nims map` without options does, in memory that does not grow with
/// the run.
///
/// # Errors
/// The run cannot be read.
pub fn maps_of_run(run: &Path, config: &LoggerConfig) -> Answer<BTreeMap<String, SensorMap>> {
    let (extents, flown) = extents_of(run, config, Wanted::All, &|_, _| Some(true))?;
    let begin =
        |(name, extent): (&String, &Extent)| Some((name.clone(), empty_map(config, name, extent, None, None).ok()?));
    let mut maps: BTreeMap<String, SensorMap> = extents.iter().filter_map(begin).collect();
    read_samples(run, config, Wanted::All, flown.read, &mut |name, _, sample| {
        if let Some(map) = maps.get_mut(name) {
            map.add(sample);
        }
    })?;
    maps.values_mut().for_each(|map| map.grid_mut().refresh_all());
    Ok(maps)
}

/// Reads the run for the extents of the chosen samples by sensor. `chosen` returns whether a sample is one of them,
/// `None` if no sample of its sensor can be.
fn extents_of(
    run: &Path,
    config: &LoggerConfig,
    wanted: Wanted,
    chosen: &dyn Fn(&str, &Sample) -> Option<bool>,
) -> Answer<(BTreeMap<String, Extent>, Flown)> {
    let mut extents: BTreeMap<String, Extent> = BTreeMap::new();
    let flown = read_samples(run, config, wanted, u64::MAX, &mut |name, origin, sample| {
        let Some(is_chosen) = chosen(name, sample) else { return };
        let extent = extents.entry(name.to_owned()).or_insert_with(|| Extent::new(config, name));
        if is_chosen {
            extent.add(origin, sample);
        }
    })?;
    Ok((extents, flown))
}

fn is_between(args: &Args, across_m: f64) -> bool {
    args.between.as_deref().is_none_or(|between| matches!(between, [low, high] if (*low..=*high).contains(&across_m)))
}

/// Overrides the settings of the system file with the command's arguments.
fn override_settings(config: &mut LoggerConfig, args: &Args) {
    for name in args.sensor.iter().map(|name| sensor_of(name).to_owned()) {
        let mut section = config.sensor(&name).map_or_else(Default::default, |sensor| sensor.section);
        section.name.clone_from(&name);
        section.map_value = args.value.map(usize::from).or(section.map_value);
        section.looks_down |= args.looks_down;
        section.sigma = args.sigma.or(section.sigma);
        section.footprint_m = args.footprint.unwrap_or(section.footprint_m);
        config.section.sensor.retain(|other| other.name != name);
        config.section.sensor.push(section);
    }
}

/// Returns an empty map for these samples, or the reason why they give none.
fn empty_map(
    config: &LoggerConfig,
    name: &str,
    extent: &Extent,
    cell_m: Option<f64>,
    reach_m: Option<f64>,
) -> Result<SensorMap, String> {
    let sensor = config.sensor(sensor_of(name)).ok_or("the system file excludes it")?;
    let Some(empty) = SensorMap::new(config, &sensor, 1).map_err(|error| error.to_string())? else {
        return Err("its `map_value` is 0".to_owned());
    };
    let corners_m = extent.corners_m.unwrap_or([[f64::NAN; 2]; 2]);
    let spec = grid_around(&corners_m, cell_m).ok_or("none of its readings has a value and a position")??;
    let options = GridOptions { reach_m: reach_m.unwrap_or(4.0 * spec.cell_m), ..config.options(&sensor, spec.cell_m) };
    let map = empty.with_grid(GridMap::new(spec, options).map_err(|error| error.to_string())?);
    if !extent.has_scale() {
        return Err(
            "all its readings are equal, so they do not show how large an error may be; state its standard deviation with --sigma"
                .to_owned(),
        );
    }
    Ok(map)
}

/// Returns a grid around the points; without a given cell size, with cells of a round size.
fn grid_around(points: &[[f64; 2]], cell_m: Option<f64>) -> Option<Result<GridSpec, String>> {
    let bound = |k: usize, from: f64, pick: fn(f64, f64) -> f64| points.iter().map(|point| point[k]).fold(from, pick);
    let low: [f64; 2] = std::array::from_fn(|k| bound(k, f64::INFINITY, f64::min));
    let high: [f64; 2] = std::array::from_fn(|k| bound(k, f64::NEG_INFINITY, f64::max));
    let longest_m = (high[0] - low[0]).max(high[1] - low[1]);
    if !longest_m.is_finite() {
        return None;
    }
    let longest_m = longest_m.max(0.01);
    let steps = ticks([0.0, longest_m], CELLS);
    let round = steps.windows(2).map(|two| two[1] - two[0]).next().unwrap_or(longest_m);
    let cell_m = cell_m.unwrap_or(round);
    if longest_m / cell_m > MAX_CELLS {
        return Some(Err(format!(
            "cells of {cell_m} m are too small: {longest_m:.2} m would have more than {MAX_CELLS} of them; give a larger size with --cell"
        )));
    }
    // Align to whole cells, so that maps of several sensors and runs have the same grid.
    let low = low.map(|value| (value / cell_m).floor() * cell_m);
    Some(GridSpec::covering(low, high.map(|value| value + 1e-6 * cell_m), cell_m).map_err(|error| error.to_string()))
}

/// Returns a description of a map as JSON and as a sentence.
fn describe(name: &str, map: &SensorMap, extent: &Extent, written: &[PathBuf]) -> (Value, String) {
    let spec = map.grid().spec();
    let known: Vec<(f64, f64)> = spec.places().filter_map(|(column, row)| map.value(column, row)).collect();
    let low = known.iter().map(|(value, _)| *value).fold(f64::INFINITY, f64::min);
    let high = known.iter().map(|(value, _)| *value).fold(f64::NEG_INFINITY, f64::max);
    let mut sigmas: Vec<f64> = known.iter().map(|(_, sigma)| *sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = sigmas.get(sigmas.len() / 2).copied();
    let counts = map.grid().counts();
    let [quantity, unit] = map.names();
    let origin = extent.origin();
    let mixed_m = map.mixed_m();
    let value = json!({
        "sensor": name, "samples_are": origin, "computed": extent.computed, "across_axis": map.plane().across_axis(), "mixed_m": mixed_m, "samples": counts.inside, "left_out": extent.samples.saturating_sub(counts.inside),
        "quantity": quantity, "unit": unit, "axes": map.plane().axes(),
        "origin_m": spec.origin_m, "cell_m": spec.cell_m, "columns": spec.columns, "rows": spec.rows,
        "reach_m": map.grid().options().reach_m, "known_cells": known.len(), "low": low, "high": high,
        "median_sigma": median, "noise": map.grid().noise(), "files": written,
    });
    let sentence = format!(
        "{name}: {} samples ({origin}), {} of {} x {} cells of {} m known, {} from {low:.4} to {high:.4} {unit}, median standard deviation {:.2e}",
        counts.inside,
        known.len(),
        spec.columns,
        spec.rows,
        spec.cell_m,
        if quantity.is_empty() { "value" } else { quantity },
        median.unwrap_or(f64::NAN)
    ) + &mixed_sentence(name, map);
    (value, sentence)
}

/// Returns a warning as a line of its own if samples of different heights are in one plane.
fn mixed_sentence(name: &str, map: &SensorMap) -> String {
    let Some([low, high]) = map.mixed_m() else { return String::new() };
    let axis = map.plane().across_axis();
    format!(
        "\n{name}: the samples are from {axis} = {low:.2} to {high:.2} m in one map; its standard deviations contain what the field may change over that, {:.2e}; map a part with --between LOW HIGH",
        map.common_sigma()
    )
}

/// Returns `map` in the run folder, or in the folder of a run file.
fn default_folder(run: &Path) -> PathBuf {
    if run.is_dir() { run.join("map") } else { run.parent().unwrap_or(Path::new("")).join("map") }
}
