//! Writes the samples of a map one by one, as CSV and as PLY.

use super::columns::columns;
use super::extent::Extent;
use super::files::write_failure;
use super::globe::Globe;
use super::read::RunTime;
use command::Answer;
use georeference::{Plane, SensorMap};
use messages::Sample;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// The files of the samples of one sensor, open for writing.
pub(super) struct SampleFiles {
    table: Lines,
    points: Lines,
    /// Number of values of a row.
    values: usize,
    time: RunTime,
    globe: Option<Globe>,
    /// The row being written.
    row: String,
}

impl SampleFiles {
    /// Creates the files with their heads.
    ///
    /// # Errors
    /// A file cannot be created.
    pub(super) fn create(
        folder: &Path,
        name: &str,
        extent: &Extent,
        time: &RunTime,
        globe: Option<&Globe>,
    ) -> Answer<Self> {
        let mut files = Self {
            table: Lines::create(folder.join(format!("{name}.csv")))?,
            points: Lines::create(folder.join(format!("{name}.ply")))?,
            values: extent.values,
            time: *time,
            globe: globe.copied(),
            row: String::new(),
        };
        files.table.write(&head(extent, globe.is_some()));
        files.points.write(&format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
             property double value\nend_header\n",
            extent.points
        ));
        Ok(files)
    }

    /// Writes a sample.
    pub(super) fn add(&mut self, map: &SensorMap, sample: &Sample) {
        self.row.clear();
        self.put_row(sample);
        self.table.write(&self.row);
        let Some((_, value)) = map.point(sample).filter(|(_, value)| value.is_finite()) else { return };
        let [x, y, z] = sample.position_m;
        let z = if map.plane() == Plane::Level && map.looks_down() { value } else { z };
        self.row.clear();
        // Writing to a string cannot fail.
        let _ = writeln!(self.row, "{x:.6} {y:.6} {z:.6} {value}");
        self.points.write(&self.row);
    }

    fn put_row(&mut self, sample: &Sample) {
        let row = &mut self.row;
        let [x, y, z] = sample.position_m;
        let [sx, sy, sz] = sample.position_std_m;
        let (stamp_ns, seq, quality) = (sample.header.stamp_ns, sample.reading_seq, sample.quality);
        let _ = write!(row, "{stamp_ns},{seq},{x:.6},{y:.6},{z:.6},{sx:.6},{sy:.6},{sz:.6},{quality}");
        for value in &sample.value[..self.values] {
            let _ = write!(row, ",{value}");
        }
        if let Some([latitude, longitude]) = self.globe.map(|globe| globe.at([x, y])) {
            // Nine decimals resolve a millimetre.
            let _ = write!(row, ",{latitude:.9},{longitude:.9}");
        }
        let _ = match self.time.of(stamp_ns) {
            Some((utc, t_s)) => writeln!(row, ",{utc},{t_s:.6}"),
            None => writeln!(row, ",,"),
        };
    }

    /// Completes the files and returns their paths.
    ///
    /// # Errors
    /// A file could not be written.
    pub(super) fn finish(self) -> Answer<[PathBuf; 2]> {
        Ok([self.table.finish()?, self.points.finish()?])
    }
}

/// Returns the names of the columns as a line.
fn head(extent: &Extent, placed: bool) -> String {
    let place = "stamp_ns,reading_seq,x_m,y_m,z_m,std_x_m,std_y_m,std_z_m,quality";
    let rest = if placed { "latitude_deg,longitude_deg,utc,t_s" } else { "utc,t_s" };
    let others: Vec<&str> = place.split(',').chain(rest.split(',')).collect();
    let names = columns(extent.first.as_ref(), extent.values, &others);
    [place].into_iter().chain(names.iter().map(String::as_str)).chain([rest]).collect::<Vec<_>>().join(",") + "\n"
}

/// A file that is written line by line.
struct Lines {
    path: PathBuf,
    file: BufWriter<File>,
    /// The first failure, after which nothing is written.
    failed: Option<std::io::Error>,
}

impl Lines {
    fn create(path: PathBuf) -> Answer<Self> {
        let file = BufWriter::new(File::create(&path).map_err(|error| write_failure(&path, &error))?);
        Ok(Self { path, file, failed: None })
    }

    fn write(&mut self, text: &str) {
        if self.failed.is_none() {
            self.failed = self.file.write_all(text.as_bytes()).err();
        }
    }

    fn finish(mut self) -> Answer<PathBuf> {
        let failed = self.failed.take().or_else(|| self.file.flush().err());
        match failed {
            Some(error) => Err(write_failure(&self.path, &error)),
            None => Ok(self.path),
        }
    }
}
