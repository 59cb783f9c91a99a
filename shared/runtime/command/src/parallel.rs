//! The same computation for many items, on all processors.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Returns the number of processors that this process may use.
#[must_use]
pub fn processors() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Computes `each` for every item in at most so many threads, which take the items in their order; returns the results
/// in the same order. A panic in `each` is passed on.
pub fn parallel<T: Sync, R: Send>(items: &[T], threads: usize, each: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let work = || {
        let take = || {
            let index = next.fetch_add(1, Ordering::Relaxed);
            Some((index, items.get(index)?))
        };
        std::iter::from_fn(take).map(|(index, item)| (index, each(item))).collect::<Vec<_>>()
    };
    let mut results: Vec<(usize, R)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.min(items.len())).map(|_| scope.spawn(work)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined.flat_map(|results| results.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    });
    results.sort_unstable_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_computed_once_and_in_its_place() {
        let items: Vec<usize> = (0..100).collect();
        for threads in [1, 3, 200] {
            let calls = AtomicUsize::new(0);
            let doubled = parallel(&items, threads, |item| {
                calls.fetch_add(1, Ordering::Relaxed);
                2 * item
            });
            assert!(doubled.iter().zip(&items).all(|(doubled, item)| *doubled == 2 * item));
            assert_eq!((doubled.len(), calls.into_inner()), (100, 100));
        }
        assert!(parallel(&[] as &[u8], 4, |item| *item).is_empty());
    }
}
