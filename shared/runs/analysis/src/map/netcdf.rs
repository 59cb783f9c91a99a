//! The map as NetCDF by the CF and ACDD conventions, which programs for environmental data read.
//!
//! The format is the classic one. Coordinates are those of the robot file; with `[site]`, a level map also has latitude
//! and longitude of every cell. Unknown cells have the fill value of the format.

use super::columns::mapped;
use super::extent::Extent;
use super::files::write_failure;
use super::globe::Globe;
use super::read::RunTime;
use command::Answer;
use georeference::{Plane, SensorMap};
use netcdf3::{DataSet, FileWriter, InvalidDataSet, NC_FILL_F64, Version};
use std::path::{Path, PathBuf};

/// Units of UDUNITS, by which CF names units, for signs that it does not have.
const UNITS: [(&str, &str); 3] = [("°C", "degree_Celsius"), ("°", "degree"), ("", "1")];

/// Names of the variables that every map may have.
const OWN: [&str; 9] = ["x", "y", "z", "time", "time_bounds", "bound", "lat", "lon", "samples"];

/// A variable with its values.
struct Variable<'a> {
    name: String,
    dimensions: Vec<&'a str>,
    values: Vec<f64>,
    attributes: Vec<(&'a str, String)>,
}

impl<'a> Variable<'a> {
    fn new(name: impl Into<String>, dimensions: &[&'a str], values: Vec<f64>) -> Self {
        Self { name: name.into(), dimensions: dimensions.to_vec(), values, attributes: Vec::new() }
    }

    fn with(mut self, name: &'a str, value: impl Into<String>) -> Self {
        self.attributes.push((name, value.into()));
        self
    }

    /// True if some values are unknown.
    fn has_gaps(&self) -> bool {
        self.values.contains(&NC_FILL_F64)
    }
}

/// Writes the file and returns its path.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write(
    folder: &Path,
    name: &str,
    map: &SensorMap,
    extent: &Extent,
    time: &RunTime,
    globe: Option<&Globe>,
) -> Answer<PathBuf> {
    let path = folder.join(format!("{name}.nc"));
    let globe = globe.filter(|_| map.plane() == Plane::Level);
    let [a, b] = map.plane().axes();
    let spec = map.grid().spec();
    let period = extent.period_ns;
    let variables: Vec<Variable<'_>> = coordinates(map, extent)
        .into_iter()
        .chain(period.and_then(|period| times(time, period)).into_iter().flatten())
        .chain(globe.map(|globe| places(map, globe)).into_iter().flatten())
        .chain(values(map, globe.is_some(), period.is_some_and(|(first_ns, _)| time.unix_s(first_ns).is_some())))
        .collect();
    let mut data = DataSet::new();
    let defined = define(&mut data, &variables, &[("time", 1), (a, spec.columns), (b, spec.rows), ("bound", 2)])
        .and_then(|()| describe(&mut data, name, map, time, period));
    defined.map_err(|error| write_failure(&path, &error))?;
    // The library writes to a file that exists as to a new one.
    let _ = std::fs::remove_file(&path);
    let put = || {
        let mut writer = FileWriter::create_new(&path)?;
        writer.set_def(&data, Version::Offset64Bit, 0)?;
        for variable in &variables {
            writer.write_var_f64(&variable.name, &variable.values)?;
        }
        writer.close()
    };
    put().map_err(|error: netcdf3::error::WriteError| write_failure(&path, &format!("{error:?}")))?;
    Ok(path)
}

/// Defines dimensions and variables.
fn define(data: &mut DataSet, variables: &[Variable<'_>], sizes: &[(&str, usize)]) -> Result<(), InvalidDataSet> {
    for (dimension, size) in sizes {
        if variables.iter().any(|variable| variable.dimensions.contains(dimension)) {
            data.add_fixed_dim(dimension, *size)?;
        }
    }
    for variable in variables {
        data.add_var_f64(&variable.name, &variable.dimensions)?;
        if variable.has_gaps() {
            data.add_var_attr_f64(&variable.name, "_FillValue", vec![NC_FILL_F64])?;
        }
        for (attribute, text) in &variable.attributes {
            data.add_var_attr_string(&variable.name, attribute, text)?;
        }
    }
    Ok(())
}

/// The axes of the map, and where it is across its plane.
fn coordinates<'a>(map: &SensorMap, extent: &Extent) -> Vec<Variable<'a>> {
    let spec = map.grid().spec();
    let [a, b] = map.plane().axes();
    let axis = |name: &'static str, values: Vec<f64>, dimensions: &[&'a str]| {
        let variable = Variable::new(name, dimensions, values)
            .with("units", "m")
            .with("long_name", format!("{name} in the robot's frame"))
            .with("axis", name.to_uppercase());
        match name {
            "z" => variable.with("positive", "up"),
            // CF's name for coordinates in metres. No grid mapping belongs to them: their axes need not point north.
            _ => variable.with("standard_name", format!("projection_{name}_coordinate")),
        }
    };
    let along = (0..spec.columns).map(|column| spec.centre(column, 0)[0]).collect();
    let up = (0..spec.rows).map(|row| spec.centre(0, row)[1]).collect();
    let mut variables = vec![axis(a, along, &[a]), axis(b, up, &[b])];
    if !map.looks_down() {
        variables.push(axis(map.plane().across_axis(), vec![extent.mean_across_m()], &[]));
    }
    variables
}

/// The middle of the time of the samples, with its bounds.
fn times<'a>(time: &RunTime, (first_ns, last_ns): (u64, u64)) -> Option<Vec<Variable<'a>>> {
    let bounds = vec![time.unix_s(first_ns)?, time.unix_s(last_ns)?];
    let middle = 0.5 * (bounds[0] + bounds[1]);
    let time = Variable::new("time", &["time"], vec![middle])
        .with("units", "seconds since 1970-01-01T00:00:00Z")
        .with("calendar", "standard")
        .with("standard_name", "time")
        .with("long_name", "middle of the time of the samples")
        .with("axis", "T")
        .with("bounds", "time_bounds");
    Some(vec![time, Variable::new("time_bounds", &["time", "bound"], bounds)])
}

/// Latitude and longitude of every cell.
fn places<'a>(map: &SensorMap, globe: &Globe) -> Vec<Variable<'a>> {
    let spec = map.grid().spec();
    let [a, b] = map.plane().axes();
    let of = |pick: usize| -> Vec<f64> {
        spec.places().map(|(column, row)| globe.at(spec.centre(column, row))[pick]).collect()
    };
    let place = |name: &'static str, standard: &str, direction: &str, values| {
        Variable::new(name, &[b, a], values)
            .with("units", format!("degrees_{direction}"))
            .with("standard_name", standard)
            .with("long_name", format!("{standard} (WGS 84)"))
    };
    vec![place("lat", "latitude", "north", of(0)), place("lon", "longitude", "east", of(1))]
}

/// Value, standard deviation and number of samples of every cell.
fn values<'a>(map: &SensorMap, placed: bool, timed: bool) -> Vec<Variable<'a>> {
    let [a, b] = map.plane().axes();
    let of = |pick: &dyn Fn(usize, usize) -> Option<f64>| -> Vec<f64> {
        map.grid().spec().places().map(|(column, row)| pick(column, row).unwrap_or(NC_FILL_F64)).collect()
    };
    let [quantity, unit] = map.names();
    let quantity = if quantity.is_empty() { "value" } else { quantity };
    let unit = UNITS.iter().find(|(sign, _)| sign == unit).map_or(unit.as_str(), |(_, name)| name);
    let [value, sigma] = mapped(map.names(), &OWN);
    let mut coordinates = Vec::new();
    coordinates.extend((!map.looks_down()).then(|| map.plane().across_axis()));
    coordinates.extend(placed.then_some("lat lon"));
    let coordinates = coordinates.join(" ");
    let dimensions: &[&'a str] = if timed { &["time", b, a] } else { &[b, a] };
    let cells = |name: &str, values: Vec<f64>, long_name: String, unit: &str| {
        let mut variable = Variable::new(name, dimensions, values).with("units", unit).with("long_name", long_name);
        if !coordinates.is_empty() {
            variable = variable.with("coordinates", coordinates.clone());
        }
        variable
    };
    vec![
        cells(&value, of(&|column, row| Some(map.value(column, row)?.0)), quantity.to_owned(), unit)
            .with("ancillary_variables", format!("{sigma} samples"))
            .with("coverage_content_type", "physicalMeasurement"),
        cells(
            &sigma,
            of(&|column, row| Some(map.value(column, row)?.1)),
            format!("standard deviation of {quantity}"),
            unit,
        )
        .with("coverage_content_type", "qualityInformation"),
        cells(
            "samples",
            of(&|column, row| Some(map.grid().cell(column, row)?.samples as f64)),
            "number of samples in the cell".to_owned(),
            "1",
        )
        .with("coverage_content_type", "auxiliaryInformation"),
    ]
}

/// Describes the file as a whole.
fn describe(
    data: &mut DataSet,
    name: &str,
    map: &SensorMap,
    time: &RunTime,
    period: Option<(u64, u64)>,
) -> Result<(), InvalidDataSet> {
    let [quantity, _] = map.names();
    let quantity = if quantity.is_empty() { "value" } else { quantity };
    let spec = map.grid().spec();
    let mut texts = vec![
        ("Conventions", "CF-1.10, ACDD-1.3".to_owned()),
        ("title", format!("Map of {quantity} by the sensor {name} on a cable-suspended robot")),
        (
            "summary",
            format!(
                "{quantity} with its standard deviation in cells of {} m, from {} samples with the places of the \
                 sensor: by local linear regression, and by ordinary kriging in cells without samples. Cells without \
                 samples within reach are unknown.",
                spec.cell_m,
                map.grid().counts().inside
            ),
        ),
        ("keywords", format!("{quantity}, cable-suspended robot, map")),
        ("source", "readings of a sensor on a cable-suspended robot".to_owned()),
    ];
    if let Some((first_ns, last_ns)) = period
        && let (Some((first, _)), Some((last, _))) = (time.of(first_ns), time.of(last_ns))
    {
        texts.extend([
            ("history", format!("{last}: nims map")),
            ("time_coverage_start", first),
            ("time_coverage_end", last),
        ]);
    }
    for (attribute, text) in texts {
        data.add_global_attr_string(attribute, text)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::merge::Origin;
    use super::*;
    use config::{LoggedSensorSection, SensorLoggerSection, SiteSection};
    use georeference::{LoggerConfig, SensorConfig};
    use messages::{Header, Sample, put_text};
    use netcdf3::FileReader;
    use runlog::RunClock;

    /// A field of degrees that grows with x; samples at two heights.
    fn map() -> (SensorMap, Extent) {
        let section = SensorLoggerSection { map_cell_m: Some(0.1), ..SensorLoggerSection::default() };
        let config = LoggerConfig { section, plane: Plane::Level, area_m: [[0.0; 2], [2.0, 1.0]] };
        let sensor = SensorConfig { section: LoggedSensorSection::default(), time_sigma_s: 0.0 };
        let mut map = SensorMap::new(&config, &sensor, 64).unwrap().unwrap();
        let mut extent = Extent::new(&config, "probe");
        for i in 0..2000_u32 {
            let (x, y) = (f64::from(i % 100) * 0.02, f64::from(i / 100) * 0.03);
            let header = Header::at(1_000_000_000 + u64::from(i) * 10_000_000);
            let mut sample = Sample { header, count: 1, position_m: [x, y, 0.8], ..Sample::default() };
            sample.value[0] = 12.0 + 0.5 * x + 0.01 * (f64::from(i) * 1.7).sin();
            put_text(&mut sample.quantity, "temperature");
            put_text(&mut sample.unit, "°C");
            map.add(&sample);
            extent.add(Origin::Recorded, &sample);
        }
        map.grid_mut().refresh_all();
        (map, extent)
    }

    #[test]
    fn the_file_has_the_cells_of_the_map_with_their_places_and_time() {
        let (map, extent) = map();
        let time = RunTime::new(Some(RunClock { t0_mono_ns: 0, t0_unix_ns: 1_790_000_000_000_000_000 }), 0);
        let globe = Globe::new(&SiteSection { latitude_deg: 34.0, longitude_deg: -118.0, azimuth_deg: 30.0 });
        let folder = tempfile::tempdir().unwrap();
        // NIMS_KEEP: a folder in which the file is kept
        let out = std::env::var_os("NIMS_KEEP").map_or_else(|| folder.path().to_owned(), PathBuf::from);
        // A file of a run before is replaced.
        std::fs::write(out.join("probe.nc"), "old").unwrap();
        let path = write(&out, "probe", &map, &extent, &time, Some(&globe)).unwrap();
        let mut reader = FileReader::open(&path).unwrap();
        let mut values = |name: &str| reader.read_var_f64(name).unwrap();
        let spec = map.grid().spec();
        let (cells, sigmas) = (values("temperature_degC"), values("temperature_sigma_degC"));
        let (latitudes, longitudes) = (values("lat"), values("lon"));
        assert!(cells.contains(&NC_FILL_F64), "a part of the area was not measured");
        for (at, (value, sigma)) in cells.iter().zip(&sigmas).enumerate() {
            let (column, row) = (at % spec.columns, at / spec.columns);
            assert_eq!(map.value(column, row), (*value != NC_FILL_F64).then_some((*value, *sigma)));
            assert_eq!(globe.at(spec.centre(column, row)), [latitudes[at], longitudes[at]]);
        }
        let bounds = values("time_bounds");
        assert!(
            (bounds[0] - 1_790_000_001.0).abs() < 1e-6 && (bounds[1] - 1_790_000_020.99).abs() < 1e-6,
            "{bounds:?}"
        );
        assert!((values("z")[0] - 0.8).abs() < 1e-9);
    }
}
