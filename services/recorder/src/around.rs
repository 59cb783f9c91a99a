//! Keeps blobs in memory and passes on those around a fault, a stop, an emergency stop or a mark.

use std::collections::VecDeque;

use messages::{Message, MotorAuthority, OperatorRequest, RequestBody};

use crate::batch::{Batch, ReceivedSample};
use crate::row::Row;

/// Which blobs are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Around {
    /// Time before an event, ns.
    pub before_ns: u64,
    /// Time after an event, ns.
    pub after_ns: u64,
    /// Most bytes that wait for an event; the oldest are dropped beyond.
    pub most_bytes: usize,
}

/// Selects the blobs around events.
#[derive(Debug)]
pub(crate) struct BlobsAround {
    settings: Around,
    waiting: VecDeque<(ReceivedSample, Vec<u8>)>,
    waiting_bytes: usize,
    /// Time of publication until which blobs are passed on, ns.
    until_ns: u64,
    /// Faults of the last cycle.
    faults: u32,
}

impl BlobsAround {
    pub(crate) fn new(settings: Around) -> Self {
        Self { settings, waiting: VecDeque::new(), waiting_bytes: 0, until_ns: 0, faults: 0 }
    }

    /// Moves a sorted batch to `selected`, without the blobs that no event needs yet and with those that an event in it
    /// needs.
    pub(crate) fn select(&mut self, batch: &Batch, rows: &[Row], selected: &mut Batch) {
        for (received, sample) in batch.iter() {
            let Some(row) = rows.get(received.row) else { continue };
            if !row.is_blob() {
                if self.is_event(row, sample) {
                    self.until_ns = self.until_ns.max(received.logged_ns.saturating_add(self.settings.after_ns));
                    self.release(received.logged_ns, selected);
                }
                selected.push(*received, sample);
            } else if received.logged_ns <= self.until_ns {
                selected.push(*received, sample);
            } else {
                self.keep(*received, sample);
            }
        }
    }

    fn is_event(&mut self, row: &Row, sample: &[u8]) -> bool {
        if let Some(authority) = decoded::<MotorAuthority>(row, sample) {
            let new = authority.faults & !self.faults;
            self.faults = authority.faults;
            return new != 0;
        }
        decoded::<OperatorRequest>(row, sample).is_some_and(|request| {
            request.answered == 0
                && matches!(
                    request.body.verb,
                    RequestBody::VERB_STOP | RequestBody::VERB_HOLD | RequestBody::VERB_ESTOP | RequestBody::VERB_MARK
                )
        })
    }

    /// Passes on what was published shortly before an event, and forgets the rest.
    fn release(&mut self, event_ns: u64, selected: &mut Batch) {
        let from_ns = event_ns.saturating_sub(self.settings.before_ns);
        for (received, sample) in std::mem::take(&mut self.waiting) {
            if received.logged_ns >= from_ns {
                selected.push(received, &sample);
            }
        }
        self.waiting_bytes = 0;
    }

    fn keep(&mut self, received: ReceivedSample, sample: &[u8]) {
        self.waiting_bytes += sample.len();
        self.waiting.push_back((received, sample.to_vec()));
        let oldest_ns = received.logged_ns.saturating_sub(self.settings.before_ns);
        while let Some((first, bytes)) = self.waiting.front()
            && (first.logged_ns < oldest_ns || self.waiting_bytes > self.settings.most_bytes)
        {
            self.waiting_bytes -= bytes.len();
            self.waiting.pop_front();
        }
    }
}

fn decoded<T: Message>(row: &Row, sample: &[u8]) -> Option<T> {
    let is_it = row.spec().type_name == T::type_name() && sample.len() == size_of::<T>();
    is_it.then(|| bytemuck::pod_read_unaligned(sample))
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::blob::BlobType;
    use runlog::ChannelSpec;

    const SECOND_NS: u64 = 1_000_000_000;

    fn rows() -> Vec<Row> {
        let blob = ChannelSpec {
            name: "blob/camera".to_owned(),
            type_name: BlobType::CompressedImage.type_name().to_owned(),
            schema: BlobType::CompressedImage.schema().to_owned(),
            size: 1000,
        };
        vec![
            Row::new(blob),
            Row::new(ChannelSpec::for_type::<MotorAuthority>("motor/authority")),
            Row::new(ChannelSpec::for_type::<OperatorRequest>("operator/request")),
        ]
    }

    /// Ten blobs a second for 20 s, and the events; returns the times of the selected blobs, s, and their numbers.
    fn selected(most_bytes: usize, events: &[(f64, usize, &[u8])]) -> Vec<(f64, u64)> {
        let settings = Around { before_ns: 2 * SECOND_NS, after_ns: SECOND_NS, most_bytes };
        let (mut around, rows, mut out) = (BlobsAround::new(settings), rows(), Vec::new());
        for step in 0..200_u64 {
            let at = |row, seq| ReceivedSample {
                row,
                logged_ns: 10 * SECOND_NS + step * SECOND_NS / 10,
                stamp_ns: 0,
                seq,
                missing: 0,
            };
            let (mut batch, mut chosen) = (Batch::default(), Batch::default());
            batch.push(at(0, step + 1), &[step as u8; 100]);
            for (_, row, sample) in events.iter().filter(|(at_s, ..)| (at_s * 10.0).round() as u64 == step) {
                batch.push(at(*row, 1), sample);
            }
            around.select(&batch, &rows, &mut chosen);
            out.extend(chosen.iter().filter(|(received, _)| received.row == 0).map(|(received, sample)| {
                let time_s = (received.logged_ns - 10 * SECOND_NS) as f64 * 1e-9;
                assert_eq!(sample, [(time_s * 10.0).round() as u8; 100]);
                (time_s, received.seq)
            }));
        }
        out
    }

    #[test]
    fn blobs_before_and_after_a_mark_are_selected() {
        let mut mark = OperatorRequest::default();
        mark.body.verb = RequestBody::VERB_MARK;
        let found = selected(1 << 20, &[(5.0, 2, bytemuck::bytes_of(&mark))]);
        let ends = [found.first(), found.last()].map(|one| one.map(|(time_s, _)| (time_s * 10.0).round()));
        assert_eq!((ends, found.len()), ([Some(30.0), Some(60.0)], 31));
    }

    #[test]
    fn blobs_before_and_after_a_fault_and_a_stop_are_selected_once() {
        assert_eq!(selected(1 << 20, &[]), []);
        let fault = MotorAuthority { faults: 4, ..MotorAuthority::default() };
        let mut stop = OperatorRequest::default();
        stop.body.verb = RequestBody::VERB_STOP;
        let (fault, stop) = (bytemuck::bytes_of(&fault), bytemuck::bytes_of(&stop));
        // The fault lasts, the stop follows while its blobs are still selected, and the last one is alone.
        let found = selected(1 << 20, &[(5.0, 1, fault), (5.1, 1, fault), (5.5, 2, stop), (15.0, 2, stop)]);
        let times: Vec<f64> = (30..=65).chain(130..=160).map(|tenth| f64::from(tenth) / 10.0).collect();
        assert_eq!(found.iter().map(|(time_s, _)| (time_s * 10.0).round() / 10.0).collect::<Vec<_>>(), times);
        // Each keeps the number of its publisher, by which its place is found.
        assert!(found.iter().all(|(time_s, seq)| *seq == (time_s * 10.0).round() as u64 + 1), "{found:?}");
    }

    #[test]
    fn what_waits_has_a_limit() {
        let fault = MotorAuthority { faults: 1, ..MotorAuthority::default() };
        let found = selected(500, &[(5.0, 1, bytemuck::bytes_of(&fault))]);
        assert_eq!(found.first().map(|(time_s, _)| (time_s * 10.0).round()), Some(46.0));
    }
}
