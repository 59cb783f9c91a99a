//! Samples that stand in more than one file of a run.
//!
//! A file that follows another begins with the last sample of each channel that had long been silent, so that it can be understood alone;
//! and a recorder that was started again is given what the channels have kept, which the file before may hold too. Read as one, such
//! a sample counts once. It is known by its number and the time when it was true, which one clock maps for the whole run.

use std::collections::{HashSet, VecDeque};

/// Samples per channel that are remembered of the files before, and looked at in the next: twice the longest history of a channel.
const KEPT: usize = 1024;

/// Number and sampling time.
type Key = (u32, u64);

#[derive(Default)]
struct Past {
    last: VecDeque<Key>,
    before: HashSet<Key>,
    looked: usize,
}

/// Tells the repeated samples of a run, channel by channel.
#[derive(Default)]
pub(crate) struct Repeats {
    channels: Vec<Past>,
    found: u64,
}

impl Repeats {
    /// The samples from now on are those of the next file.
    pub(crate) fn next_file(&mut self) {
        for past in &mut self.channels {
            past.before = past.last.iter().copied().collect();
            past.looked = 0;
        }
    }

    /// Whether this sample stood in a file before.
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
            if past.looked >= KEPT {
                past.before.clear();
            }
        }
        if past.last.len() == KEPT {
            past.last.pop_front();
        }
        past.last.push_back(key);
        false
    }

    /// How many there were so far.
    pub(crate) fn found(&self) -> u64 {
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_counts_once_however_many_files_repeat_it() {
        let mut repeats = Repeats::default();
        let mut read = |file: &[(usize, u32)]| {
            repeats.next_file();
            let new =
                |(channel, sequence): &&(usize, u32)| !repeats.is_repeated(*channel, *sequence, u64::from(*sequence));
            file.iter().filter(new).copied().collect::<Vec<_>>()
        };
        assert_eq!(read(&[(0, 1), (0, 2), (3, 1)]), [(0, 1), (0, 2), (3, 1)]);
        assert_eq!(read(&[(3, 1), (0, 2), (0, 3)]), [(0, 3)], "of the file before");
        assert_eq!(read(&[(3, 1), (0, 4)]), [(0, 4)], "of the file before that");
        assert_eq!(read(&[(0, 5), (0, 5)]), [(0, 5), (0, 5)], "twice in one file is as it was heard");
        assert_eq!(repeats.found(), 3);
    }
}
