//! Samples that occur in more than one file of a run.
//!
//! A later file begins with the last sample of each channel that was silent for long, so that the file is complete on
//! its own. A restarted recorder also receives the history of the channels, which the previous file may contain
//! already. Read as one run, such a sample counts once. It is identified by its sequence number and its sampling time,
//! which one clock maps for the whole run.

use std::collections::{HashSet, VecDeque};

/// Samples per channel that are remembered from earlier files and compared in the next: twice the longest history of a
/// channel.
const REMEMBERED: usize = 1024;

/// Sequence number and sampling time.
type Key = (u32, u64);

#[derive(Default)]
struct Past {
    last: VecDeque<Key>,
    before: HashSet<Key>,
    looked: usize,
}

/// Detects repeated samples of a run, channel by channel.
#[derive(Default)]
pub(crate) struct Duplicates {
    channels: Vec<Past>,
    found: u64,
}

impl Duplicates {
    /// Starts the next file.
    pub(crate) fn next_file(&mut self) {
        for past in &mut self.channels {
            past.before = past.last.iter().copied().collect();
            past.looked = 0;
        }
    }

    /// True if an earlier file contained this sample.
    pub(crate) fn is_repeated(&mut self, channel: usize, sequence: u32, publish_time_ns: u64) -> bool {
        if channel >= self.channels.len() {
            self.channels.resize_with(channel + 1, Past::default);
        }
        let past = &mut self.channels[channel];
        let key = (sequence, publish_time_ns);
        if !past.before.is_empty() {
            if past.before.contains(&key) {
                self.found += 1;
                return true;
            }
            past.looked += 1;
            if past.looked >= REMEMBERED {
                past.before.clear();
            }
        }
        if past.last.len() == REMEMBERED {
            past.last.pop_front();
        }
        past.last.push_back(key);
        debug_assert!(past.last.len() <= REMEMBERED, "more samples are remembered than compared");
        false
    }

    /// Repeated samples so far.
    pub(crate) fn found(&self) -> u64 {
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_counts_once_however_many_files_repeat_it() {
        let mut repeats = Duplicates::default();
        let mut read = |file: &[(usize, u32)]| {
            repeats.next_file();
            let new =
                |(channel, sequence): &&(usize, u32)| !repeats.is_repeated(*channel, *sequence, u64::from(*sequence));
            file.iter().filter(new).copied().collect::<Vec<_>>()
        };
        assert_eq!(read(&[(0, 1), (0, 2), (3, 1)]), [(0, 1), (0, 2), (3, 1)]);
        assert_eq!(read(&[(3, 1), (0, 2), (0, 3)]), [(0, 3)], "in the previous file");
        assert_eq!(read(&[(3, 1), (0, 4)]), [(0, 4)], "in the file before the previous one");
        assert_eq!(read(&[(0, 5), (0, 5)]), [(0, 5), (0, 5)], "a sample twice in one file was received twice");
        assert_eq!(repeats.found(), 3);
    }
}
