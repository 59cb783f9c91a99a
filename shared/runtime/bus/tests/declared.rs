//! Declared types: the channel is the one that the same struct would have.

#![allow(clippy::unwrap_used)]

use bus::{Bus, BusError, Domain};
use messages::{Declaration, Header, Message, quality_for};

messages::message! {
    /// A probe in the ground.
    pub struct Soil {
        header: Header,
        /// Water by volume, %.
        moisture_percent: f64,
        /// Counts of the four channels.
        counts: [u16; 4],
    }
}

messages::message! {
    /// Another type of the same name.
    pub struct Other {
        header: Header,
        /// Force, N.
        force_n: f64,
    }
}

fn declared() -> Declaration {
    Declaration::new("Soil", Soil::schema()).unwrap()
}

fn quality() -> messages::Quality {
    quality_for("sensor/soil", size_of::<Soil>())
}

fn sample(moisture_percent: f64) -> (Header, Vec<u8>) {
    let soil = Soil { moisture_percent, counts: [1, 2, 3, 4], ..Soil::default() };
    (Header { stamp_ns: 7, oldest_input_ns: 6, ..Header::default() }, bytemuck::bytes_of(&soil).to_vec())
}

#[test]
fn a_declared_channel_is_that_of_the_struct_whoever_opens_it_first() {
    for struct_first in [false, true] {
        let domain = Domain::for_test();
        let (gateway, reader) = (Bus::join(&domain, "gateway").unwrap(), Bus::join(&domain, "reader").unwrap());
        let first = struct_first.then(|| reader.subscriber::<Soil>("sensor/soil").unwrap());
        let mut out = gateway.declared_publisher("sensor/soil", &declared(), quality()).unwrap();
        let mut typed = first.unwrap_or_else(|| reader.subscriber::<Soil>("sensor/soil").unwrap());
        let mut tap = reader.tap_with_history("sensor/soil").unwrap();
        let info = tap.info().clone();
        assert_eq!((info.type_name.as_str(), info.size), (Soil::type_name(), size_of::<Soil>()));
        // A type of this build is stored without its comments, and a declared one with them.
        let text = info.schema.unwrap();
        assert!(messages::schema::is_same(&text, Soil::schema()));
        for number in 1..=300_u32 {
            let (header, bytes) = sample(f64::from(number));
            out.send(header, &bytes).unwrap();
            let soil = typed.receive().unwrap().unwrap();
            assert_eq!((soil.moisture_percent, soil.counts), (f64::from(number), [1, 2, 3, 4]));
            assert_eq!((soil.header.seq, soil.header.stamp_ns, soil.header.oldest_input_ns), (number.into(), 7, 6));
            assert!(soil.header.published_ns > 0);
            assert_eq!(tap.receive(|raw| (raw.bytes.len(), raw.missing)).unwrap(), Some((size_of::<Soil>(), 0)));
        }
        assert_eq!((typed.lost(), tap.lost()), (0, 0));
    }
}

#[test]
fn a_channel_of_a_declared_type_keeps_the_whole_definition_and_refuses_another_type() {
    let domain = Domain::for_test();
    let (gateway, reader) = (Bus::join(&domain, "gateway").unwrap(), Bus::join(&domain, "reader").unwrap());
    // Longer than the attributes of a channel.
    let long = Soil::schema().replace("# Water", &format!("# {}\n# Water", "long comment ".repeat(400)));
    let long = Declaration::new("Soil", &long).unwrap();
    let mut out = gateway.declared_publisher("sensor/soil", &long, quality()).unwrap();
    assert_eq!(reader.tap("sensor/soil").unwrap().info().schema.as_deref(), Some(long.definition()));
    let other = Declaration::new("Other", Other::schema()).unwrap();
    let refused = reader.declared_publisher("sensor/soil", &other, quality()).unwrap_err();
    assert!(matches!(refused, BusError::TypeMismatch { .. }), "{refused}");
    let (header, bytes) = sample(1.0);
    assert!(out.send(header, &bytes[..bytes.len() - 1]).is_err() && out.send(header, &[]).is_err());
    out.send(header, &bytes).unwrap();
}
