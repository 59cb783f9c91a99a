//! Samples of one sensor with different quantities or units, such as from before and after it was plugged in with
//! another definition: each kind has a map and tables of its own, because values of two kinds have no mean.

use messages::Sample;

/// Most kinds of a sensor, so that one that names its quantities without end does not fill the memory.
const MOST: usize = 8;

/// Samples of the same sensor, quantity and unit.
struct Kind {
    sensor: String,
    quantity: Vec<u8>,
    unit: Vec<u8>,
    name: String,
}

/// The kinds of samples of a run.
#[derive(Default)]
pub(super) struct Kinds {
    known: Vec<Kind>,
    /// Samples of further kinds.
    pub left_out: u64,
}

impl Kinds {
    /// Returns the name of a sample's kind: that of its sensor, followed by a number from the second kind on; `None`
    /// for further kinds than [`MOST`].
    pub(super) fn name_of(&mut self, sensor: &str, sample: &Sample) -> Option<&str> {
        let is = |kind: &Kind| kind.sensor == sensor && kind.quantity == sample.quantity && kind.unit == sample.unit;
        if let Some(at) = self.known.iter().position(is) {
            return self.known.get(at).map(|kind| kind.name.as_str());
        }
        let name = match self.known.iter().filter(|kind| kind.sensor == sensor).count() + 1 {
            1 => sensor.to_owned(),
            number if number <= MOST => format!("{sensor}@{number}"),
            _ => {
                self.left_out += 1;
                return None;
            }
        };
        let (quantity, unit) = (sample.quantity.to_vec(), sample.unit.to_vec());
        self.known.push(Kind { sensor: sensor.to_owned(), quantity, unit, name });
        self.known.last().map(|kind| kind.name.as_str())
    }
}

/// Returns the name of the sensor of a kind; names of sensors have no @.
pub(super) fn sensor_of(kind: &str) -> &str {
    kind.split_once('@').map_or(kind, |(sensor, _)| sensor)
}

/// Returns the beginning of the names of a kind's files: those of sensors may have slashes, and have no dots
/// (`bus::is_channel_name`), so no two kinds have the same files.
pub(super) fn file_name(kind: &str) -> String {
    kind.replace('/', ".")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use messages::put_text;

    #[test]
    fn another_quantity_or_unit_is_another_kind_up_to_a_limit() {
        let sample = |quantity: &str, unit: &str| {
            let mut sample = Sample::default();
            put_text(&mut sample.quantity, quantity);
            put_text(&mut sample.unit, unit);
            sample
        };
        let mut kinds = Kinds::default();
        let mut name = |sensor: &str, quantity: &str, unit: &str| {
            kinds.name_of(sensor, &sample(quantity, unit)).map(str::to_owned)
        };
        for _ in 0..2 {
            assert_eq!(name("soil", "moisture", "%").unwrap(), "soil");
            assert_eq!(name("soil", "moisture", "").unwrap(), "soil@2");
            assert_eq!(name("soil", "temperature", "%").unwrap(), "soil@3");
            assert_eq!(name("front/left", "moisture", "").unwrap(), "front/left");
        }
        let named = (0..20).filter(|number| name("soil", &format!("q{number}"), "").is_some()).count();
        assert_eq!((named, kinds.left_out), (MOST - 3, 20 - (MOST as u64 - 3)));
        assert_eq!((sensor_of("soil@2"), sensor_of("soil")), ("soil", "soil"));
        assert_eq!(file_name("front/left@2"), "front.left@2");
    }
}
