//! Work side by side on the cores that are free.
//!
//! Pieces of work nest: fits run side by side, and each of them runs rigs. So cores are counted once for the whole process.
//! Whoever has several pieces takes the cores that are free and gives each back when nothing is left for it to do; a piece that
//! begins while others wait has one, the last of them all. What comes of a piece does not depend on how many there were.

use std::num::NonZero;
use std::sync::atomic::{AtomicIsize, AtomicUsize, Ordering};
use std::sync::{LazyLock, OnceLock};

/// Cores that nobody works on; the caller's own is taken from the start. Below zero for a moment, where one that waited goes on.
static FREE: LazyLock<AtomicIsize> =
    LazyLock::new(|| AtomicIsize::new(all_cores().saturating_sub(1).try_into().unwrap_or(0)));

/// Cores of this machine that this process may use.
pub fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

/// Tells whether nobody works on some core at this moment.
pub(crate) fn any_is_free() -> bool {
    FREE.load(Ordering::Relaxed) > 0
}

/// A core that somebody works on; free again once this is dropped.
struct Taken;

impl Taken {
    /// One of those that are free, if any is.
    fn one() -> Option<Self> {
        let less = |free: isize| (free > 0).then(|| free - 1);
        FREE.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less).ok().map(|_| Taken)
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        FREE.fetch_add(1, Ordering::Relaxed);
    }
}

/// Does `count` pieces of work on the free cores, `most` of them at once at the most, and returns when all are done.
///
/// `begun` is told, on the caller's thread, how many have been begun whenever that thread begins one.
pub(crate) fn share_out(count: usize, most: usize, work: impl Fn(usize) + Sync, begun: &mut dyn FnMut(usize)) {
    let next = AtomicUsize::new(0);
    let claim = || Some(next.fetch_add(1, Ordering::Relaxed)).filter(|item| *item < count);
    let (claim, work) = (&claim, &work);
    std::thread::scope(|scope| {
        for taken in (1..most.min(count)).map_while(|_| Taken::one()) {
            scope.spawn(move || {
                let _taken = taken;
                while let Some(item) = claim() {
                    work(item);
                }
            });
        }
        while let Some(item) = claim() {
            begun(item);
            work(item);
        }
        // While this thread waits for the others its core is theirs.
        FREE.fetch_add(1, Ordering::Relaxed);
    });
    FREE.fetch_sub(1, Ordering::Relaxed);
}

/// Results of work on each of some items, in their order, worked out on the free cores.
///
/// `begun` is told, on the caller's thread, the share of the items (0 … 1) that have been begun.
pub fn side_by_side_telling<T: Sync, R: Send + Sync>(
    items: &[T],
    work: impl Fn(&T) -> R + Sync,
    begun: &mut dyn FnMut(f64),
) -> Vec<R> {
    let slots: Vec<OnceLock<R>> = items.iter().map(|_| OnceLock::new()).collect();
    let one = |at: usize| {
        if let (Some(item), Some(slot)) = (items.get(at), slots.get(at)) {
            slot.get_or_init(|| work(item));
        }
    };
    share_out(items.len(), all_cores(), one, &mut |at| begun(at as f64 / items.len() as f64));
    slots.into_iter().filter_map(OnceLock::into_inner).collect()
}

/// Results of work on each of some items, in their order, worked out on the free cores.
pub fn side_by_side<T: Sync, R: Send + Sync>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    side_by_side_telling(items, work, &mut |_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work within work: all of it is done once, in order, and the cores are free again afterwards.
    #[test]
    fn nested_work_is_done_once_and_gives_its_cores_back() {
        let done = AtomicUsize::new(0);
        let rows: Vec<usize> = (0..7).collect();
        let squares = side_by_side(&rows, |row| {
            let columns: Vec<usize> = (0..5).collect();
            side_by_side(&columns, |column| {
                done.fetch_add(1, Ordering::Relaxed);
                row * 10 + column
            })
        });
        assert_eq!(done.load(Ordering::Relaxed), 35);
        let expected: Vec<Vec<usize>> =
            rows.iter().map(|row| (0..5).map(|column| row * 10 + column).collect()).collect();
        assert_eq!(squares, expected);
        // Other tests of this process may hold some at this moment; none is lost for good.
        let all = isize::try_from(all_cores() - 1).unwrap();
        let waited = (0..1000).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(5));
            FREE.load(Ordering::Relaxed) == all
        });
        assert!(waited, "{} of {all} are free", FREE.load(Ordering::Relaxed));
    }
}
