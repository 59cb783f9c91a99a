//! Requests in `motor/input` of runs from before they were typed: a verb and eight numbers each.

use std::sync::Arc;

use messages::schema::{Schema, Value};
use messages::{MotorInput, RequestBody};
use runlog::{RecordedChannel, RecordedSample};

/// Reader of such requests, for the channel that it has seen last.
#[derive(Debug, Default)]
pub(super) struct EarlierRequests {
    channel: Option<Arc<RecordedChannel>>,
    schema: Option<Schema>,
}

impl EarlierRequests {
    /// Fills in the requests of a sample with the earlier definition; leaves others unchanged.
    pub(super) fn fill(&mut self, recorded: &RecordedSample<'_>, input: &mut MotorInput) {
        if !self.channel.as_ref().is_some_and(|channel| Arc::ptr_eq(channel, recorded.channel)) {
            self.channel = Some(Arc::clone(recorded.channel));
            let schema = Schema::parse(&recorded.channel.schema).ok();
            self.schema = schema.filter(|schema| schema.field("request_verb").is_some());
        }
        let Some(schema) = &self.schema else { return };
        let numbers = |name: &str| -> Vec<f64> {
            let value = schema.field(name).and_then(|field| Value::read(field, recorded.sample));
            value.map(|value| value.numbers().map(|number| number.as_f64()).collect()).unwrap_or_default()
        };
        let (verbs, args) = (numbers("request_verb"), numbers("request_args"));
        let cables = input.cable_count;
        for (body, (verb, args)) in input.request.iter_mut().zip(verbs.into_iter().zip(args.chunks_exact(8))) {
            *body = body_of(verb as u8, args, cables);
        }
    }
}

fn body_of(verb: u8, args: &[f64], cables: u8) -> RequestBody {
    let mut body = RequestBody { verb, ..RequestBody::default() };
    match verb {
        RequestBody::VERB_ZERO_AT => body.position_m.copy_from_slice(&args[..3]),
        RequestBody::VERB_ZERO_LENGTHS => {
            let count = usize::from(cables).min(args.len());
            body.cable_count = cables;
            body.length_m[..count].copy_from_slice(&args[..count]);
        }
        RequestBody::VERB_JOG => (body.cable, body.distance_m) = (args[0] as u8, args[1]),
        RequestBody::VERB_SPEED => body.rate = args[0],
        RequestBody::VERB_SWAP | RequestBody::VERB_ADMIT => {
            (body.slot_role, body.slot) = (args[0] as u8, args[1] as u8);
        }
        _ => {}
    }
    body
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Request, Slot, SlotRole};

    #[test]
    fn eight_numbers_become_the_request_that_they_were() {
        let args = [2.0, 1.0, -0.5, 4.0, 0.0, 0.0, 0.0, 0.0];
        let of = |verb| Request::from_body(&body_of(verb, &args, 4));
        assert_eq!(of(RequestBody::VERB_ARM), Ok(Request::Arm));
        assert_eq!(of(RequestBody::VERB_ZERO_AT), Ok(Request::ZeroAt { position_m: [2.0, 1.0, -0.5] }));
        let lengths_m = args[..4].iter().copied().collect();
        assert_eq!(of(RequestBody::VERB_ZERO_LENGTHS), Ok(Request::ZeroLengths { lengths_m }));
        assert_eq!(of(RequestBody::VERB_JOG), Ok(Request::Jog { cable: 2, distance_m: 1.0 }));
        assert_eq!(of(RequestBody::VERB_SPEED), Ok(Request::Speed { rate: 2.0 }));
        let swap = Request::from_body(&body_of(RequestBody::VERB_SWAP, &[0.0, 1.0], 4));
        assert_eq!(swap, Ok(Request::Swap { role: SlotRole::Controller, slot: Slot::B }));
    }
}
