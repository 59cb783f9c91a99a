//! Decodes the bytes of a reading to values, time and lever arm.

use bytemuck::pod_read_unaligned;
use messages::schema::{Schema, SchemaField, Value};
use messages::{Header, Message, Reading, Sample, put_text};

use crate::SensorConfig;

/// Maximum number of values per sample.
pub(crate) const VALUES: usize = 8;

/// A decoded reading without its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DecodedReading {
    /// The sample without its position.
    pub sample: Sample,
    /// Position of the sensor on the node, m.
    pub lever_m: [f64; 3],
}

/// Decoder for the samples of one channel.
#[derive(Debug, Clone)]
pub struct Decoder {
    format: Format,
    latency_ns: Option<u64>,
    lever_m: Option<[f64; 3]>,
}

#[derive(Debug, Clone)]
enum Format {
    Reading,
    /// A blob: a sample without values. Its bytes are those of its header.
    Blob(Box<Sample>),
    /// A custom type; `empty` is a sample with the names of its fields.
    Custom {
        fields: Vec<SchemaField>,
        size: usize,
        empty: Box<Sample>,
    },
}

impl Decoder {
    /// Creates a decoder for a channel with this type, definition and sample size.
    ///
    /// # Errors
    /// One sentence: why its samples cannot be decoded.
    pub fn new(config: &SensorConfig, type_name: &str, schema: &str, size: usize) -> Result<Self, String> {
        let format = if type_name == Reading::type_name() && size == size_of::<Reading>() {
            Format::Reading
        } else {
            custom_format(config, schema, size)?
        };
        let latency_ns = config.section.latency_s.map(|seconds| (seconds * 1e9) as u64);
        Ok(Self { format, latency_ns, lever_m: config.section.lever_m })
    }

    /// Creates a decoder for a channel of blobs, which get a place but have no values. It decodes their headers.
    #[must_use]
    pub fn for_blobs(config: &SensorConfig, type_name: &str) -> Self {
        let mut empty = Sample { value: [f64::NAN; VALUES], ..Sample::default() };
        put_text(&mut empty.quantity, type_name.rsplit_once('/').map_or(type_name, |(name, _)| name));
        let latency_ns = config.section.latency_s.map(|seconds| (seconds * 1e9) as u64);
        Self { format: Format::Blob(Box::new(empty)), latency_ns, lever_m: config.section.lever_m }
    }

    /// Returns the size of a sample of the channel, bytes; samples of another size are malformed.
    pub(crate) fn size(&self) -> usize {
        match &self.format {
            Format::Reading => size_of::<Reading>(),
            Format::Blob(_) => size_of::<Header>(),
            Format::Custom { size, .. } => *size,
        }
    }

    /// Decodes a reading; `None` if it is stale or malformed.
    pub(crate) fn decode(&self, bytes: &[u8]) -> Option<DecodedReading> {
        match &self.format {
            Format::Reading => {
                let reading: Reading = (bytes.len() == size_of::<Reading>()).then(|| pod_read_unaligned(bytes))?;
                if reading.quality == Reading::QUALITY_STALE {
                    return None;
                }
                let sample = Sample {
                    header: self.header(&reading.header),
                    value: reading.value,
                    reading_seq: reading.header.seq,
                    count: reading.count.min(VALUES as u8),
                    quality: reading.quality,
                    quantity: reading.quantity,
                    unit: reading.unit,
                    ..Sample::default()
                };
                Some(DecodedReading { sample, lever_m: self.lever_m.unwrap_or(reading.lever_m) })
            }
            Format::Blob(empty) => {
                let header: Header = (bytes.len() == size_of::<Header>()).then(|| pod_read_unaligned(bytes))?;
                let sample = Sample { header: self.header(&header), reading_seq: header.seq, ..**empty };
                Some(DecodedReading { sample, lever_m: self.lever_m.unwrap_or_default() })
            }
            Format::Custom { fields, size, empty } => {
                if bytes.len() != *size {
                    return None;
                }
                let header: Header = pod_read_unaligned(bytes.get(..size_of::<Header>())?);
                let mut sample = Sample { header: self.header(&header), reading_seq: header.seq, ..**empty };
                let numbers =
                    fields.iter().filter_map(|field| Value::read(field, bytes)).flat_map(|value| value.numbers());
                for (into, number) in sample.value.iter_mut().zip(numbers) {
                    *into = number.as_f64();
                }
                // A value that is missing keeps the others.
                if sample.value[..usize::from(sample.count)].iter().all(|value| !value.is_finite()) {
                    sample.quality = Reading::QUALITY_INVALID;
                }
                Some(DecodedReading { sample, lever_m: self.lever_m.unwrap_or_default() })
            }
        }
    }

    /// Returns a header with the time of measurement.
    fn header(&self, header: &Header) -> Header {
        let measured_ns = match header.oldest_input_ns {
            oldest_ns if oldest_ns == 0 || oldest_ns > header.stamp_ns => header.stamp_ns,
            oldest_ns => oldest_ns,
        };
        Header::at(self.latency_ns.map_or(measured_ns, |latency_ns| header.stamp_ns.saturating_sub(latency_ns)))
    }
}

fn custom_format(config: &SensorConfig, schema: &str, size: usize) -> Result<Format, String> {
    let schema = Schema::parse(schema).map_err(|error| format!("its definition cannot be read: {error}"))?;
    if schema.size() != size {
        return Err(format!("its samples have {size} bytes but its definition has {}", schema.size()));
    }
    if !schema.has_header() {
        return Err("its samples do not begin with a header, so their time of measurement is unknown".to_owned());
    }
    let mut fields = value_fields(&schema, &config.section.fields)?;
    fields.truncate(VALUES);
    let count = fields.iter().map(|field| field.count.unwrap_or(1)).sum::<usize>().min(VALUES);
    let mut empty = Sample { count: count as u8, value: [f64::NAN; VALUES], ..Sample::default() };
    let names = value_names(&fields, empty.quantity.len());
    put_text(&mut empty.quantity, &names);
    Ok(Format::Custom { fields, size, empty: Box::new(empty) })
}

/// Returns the name of each value as [`messages::name_at`] reads it: the numbers of an array are counted, and names
/// that do not fit are left out, because a part of a name is another one.
fn value_names(fields: &[SchemaField], room: usize) -> String {
    let of_field = |field: &SchemaField| match field.count {
        Some(count) if fields.len() > 1 => {
            (1..=count.min(VALUES)).map(|number| format!("{}_{number}", field.path)).collect()
        }
        // One name is that of each value.
        _ => vec![field.path.clone()],
    };
    let mut names = fields.iter().flat_map(of_field).collect::<Vec<String>>().join(",");
    if names.len() > room {
        // With the comma, the first name is not that of each value.
        let whole = names.bytes().take(room).rposition(|byte| byte == b',').map_or(0, |comma| comma + 1);
        names.truncate(whole);
    }
    names
}

/// Returns the fields of a custom type that are values: the wanted ones; without any, the floating-point fields, or
/// else all numbers. A sample has the first ones.
///
/// # Errors
/// One sentence: a wanted field is missing, or the type has no numbers.
pub fn value_fields(schema: &Schema, wanted: &[String]) -> Result<Vec<SchemaField>, String> {
    if !wanted.is_empty() {
        return wanted
            .iter()
            .map(|path| {
                schema.field(path).cloned().ok_or_else(|| {
                    let there: Vec<&str> = values(schema).map(|field| field.path.as_str()).collect();
                    format!("it has no field `{path}`; available: {}", there.join(", "))
                })
            })
            .collect();
    }
    let fraction = |field: &&SchemaField| field.primitive.name().starts_with("float");
    let with_fraction: Vec<SchemaField> = values(schema).filter(fraction).cloned().collect();
    if !with_fraction.is_empty() {
        return Ok(with_fraction);
    }
    let any: Vec<SchemaField> = values(schema).cloned().collect();
    if any.is_empty() { Err("it has no numbers".to_owned()) } else { Ok(any) }
}

/// Returns the fields that may be values: neither header nor padding.
fn values(schema: &Schema) -> impl Iterator<Item = &SchemaField> {
    schema.fields().iter().filter(|field| !field.path.starts_with("header.") && !field.path.starts_with("pad"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use messages::{name_at, text_of};

    /// The names of the values of a type with these fields.
    fn names(fields: &str) -> Vec<String> {
        let header =
            "uint64 life\nuint64 cycle\nuint64 seq\nuint64 stamp_ns\nuint64 published_ns\nuint64 oldest_input_ns\n";
        let schema = format!("nims_msgs/Header header\n{fields}{}\nMSG: nims_msgs/Header\n{header}", "=".repeat(80));
        let size = Schema::parse(&schema).unwrap().size();
        let config = SensorConfig { section: Default::default(), time_sigma_s: 0.0 };
        let decoder = Decoder::new(&config, "lab/Probe/00000000", &schema, size).unwrap();
        let sample = decoder.decode(&vec![0; size]).unwrap().sample;
        (0..usize::from(sample.count)).map(|at| name_at(&text_of(&sample.quantity), at).to_owned()).collect()
    }

    #[test]
    fn each_value_has_its_own_name_or_none() {
        assert_eq!(names("float64 wind_m_s\n"), ["wind_m_s"]);
        assert_eq!(names("float64[3] wind_m_s\n"), ["wind_m_s"; 3]);
        // The second value is no temperature.
        let wanted = ["wind_m_s_1", "wind_m_s_2", "temperature_c"];
        assert_eq!(names("float64[2] wind_m_s\nfloat64 temperature_c\n"), wanted);
        // 64 bytes of names: no part of a name, and the first one not for each value.
        let long = ["a".repeat(40), "b".repeat(40), "c".repeat(40)];
        let fields: String = long.iter().map(|name| format!("float64 {name}\n")).collect();
        assert_eq!(names(&fields), [long[0].as_str(), "", ""]);
        assert_eq!(names(&format!("float64 {}\nfloat64 b\n", "a".repeat(70))), ["", ""]);
    }
}
