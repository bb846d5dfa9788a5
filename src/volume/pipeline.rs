//! Work on all threads, whose results are taken in order.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};

/// Items that each thread has begun before the first of them is taken: bounds what is held. More only serve where items
/// differ much in their cost. It is a bound for each, since memory that one thread took is of use to it alone again, as
/// allocators have it: without, every thread may come to keep what all of them are allowed.
pub(super) const AHEAD: usize = 8;

/// Does `work` on the items `0..count`, on all threads of the current `rayon` pool, and hands the results to `take` one
/// after the other, in order.
///
/// There is neither a barrier nor a thread set apart: who has done the item that is due takes it, and those behind it that
/// are done, while the others go on. They wait only when [`AHEAD`] of their own items are not taken yet. `W` is a thread's own
/// memory.
///
/// # Errors
///
/// The first of `take`, after which nothing is begun or taken.
pub(super) fn in_order<W: Default, T: Send, E: Send>(
    count: usize,
    work: impl Fn(&mut W, usize) -> T + Sync,
    take: impl FnMut(T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let state = State {
        begun: 0,
        due: 0,
        done: VecDeque::new(),
        held: vec![0; rayon::current_num_threads()],
        taking: false,
        failed: None,
        stopped: false,
    };
    let shared = Shared { count, state: Mutex::new(state), room: Condvar::new(), take: Mutex::new(take) };
    rayon::broadcast(|thread| {
        let _guard = StopOnPanic(&shared);
        let mut memory = W::default();
        while let Some(index) = shared.begin(thread.index()) {
            shared.end(thread.index(), index, work(&mut memory, index));
        }
    });
    let state = shared.state.into_inner().expect(UNPOISONED);
    state.failed.map_or(Ok(()), Err)
}

struct Shared<T, E, F> {
    count: usize,
    state: Mutex<State<T, E>>,
    /// Something was taken, so that more may be begun.
    room: Condvar,
    /// Locked only by who has set `State::taking`.
    take: Mutex<F>,
}

struct State<T, E> {
    begun: usize,
    /// The item that is to be taken next.
    due: usize,
    /// Results from that item on, each with the number of its thread.
    done: VecDeque<Option<(usize, T)>>,
    /// Items of each thread that are begun and not yet taken.
    held: Vec<usize>,
    /// Some thread is taking.
    taking: bool,
    failed: Option<E>,
    stopped: bool,
}

const UNPOISONED: &str = "nothing panics while it holds the lock";

impl<T, E, F: FnMut(T) -> Result<(), E>> Shared<T, E, F> {
    /// The next item for a thread, once it does not hold too many; `None` at the end.
    fn begin(&self, thread: usize) -> Option<usize> {
        let mut state = self.lock();
        // Whoever works on the item that is due, or takes it, does not wait, so this ends.
        while !state.stopped && state.begun < self.count && state.held[thread] >= AHEAD {
            state = self.room.wait(state).expect(UNPOISONED);
        }
        let more = !state.stopped && state.begun < self.count;
        more.then(|| {
            state.held[thread] += 1;
            state.begun += 1;
            state.begun - 1
        })
    }

    /// Adds a result. If it is due, it is taken, and what is done behind it.
    fn end(&self, thread: usize, index: usize, result: T) {
        let mut state = self.lock();
        let place = index - state.due;
        if state.done.len() <= place {
            state.done.resize_with(place + 1, || None);
        }
        state.done[place] = Some((thread, result));
        if state.taking {
            // Who takes looks again before it stops.
            return;
        }
        state.taking = true;
        while !state.stopped && state.done.front().is_some_and(Option::is_some) {
            let Some(Some((thread, result))) = state.done.pop_front() else { break };
            state.due += 1;
            drop(state);
            let taken = (self.take.lock().expect("who panics while taking stops all"))(result);
            state = self.lock();
            state.held[thread] -= 1;
            if let Err(error) = taken {
                state.failed = Some(error);
                state.stopped = true;
            }
            self.room.notify_all();
        }
        state.taking = false;
    }
}

impl<T, E, F> Shared<T, E, F> {
    fn lock(&self) -> MutexGuard<'_, State<T, E>> {
        self.state.lock().expect(UNPOISONED)
    }
}

/// Lets no thread wait for one that has panicked.
struct StopOnPanic<'a, T, E, F>(&'a Shared<T, E, F>);

impl<T, E, F> Drop for StopOnPanic<'_, T, E, F> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.lock().stopped = true;
            self.0.room.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use super::*;

    fn on<R: Send>(threads: usize, run: impl FnOnce() -> R + Send) -> R {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(run)
    }

    #[test]
    fn results_come_in_order_and_none_is_begun_far_ahead() {
        for threads in [1, 2, 7] {
            let begun: Vec<AtomicUsize> = (0..threads).map(|_| AtomicUsize::new(0)).collect();
            let (mut taken, mut taken_of) = (vec![], vec![0; threads]);
            let work = |memory: &mut usize, index: usize| {
                let thread = rayon::current_thread_index().expect("in a pool");
                begun[thread].fetch_add(1, Ordering::SeqCst);
                *memory += 1;
                // Some items take much longer than others.
                if index.is_multiple_of(13) {
                    std::thread::sleep(Duration::from_millis(2));
                }
                (thread, index * index)
            };
            let take = |(thread, result): (usize, usize)| {
                assert!(begun[thread].load(Ordering::SeqCst) <= taken_of[thread] + AHEAD);
                taken_of[thread] += 1;
                taken.push(result);
                Ok::<(), ()>(())
            };
            assert_eq!(on(threads, || in_order(300, work, take)), Ok(()));
            assert!(taken.iter().copied().eq((0..300).map(|index| index * index)), "{threads}");
        }
    }

    #[test]
    fn the_first_error_ends_it() {
        for threads in [1, 3] {
            let mut taken = 0;
            let take = |result| {
                taken += 1;
                if result == 40 { Err(result) } else { Ok(()) }
            };
            assert_eq!(on(threads, || in_order(100_000, |(), index| index, take)), Err(40));
            assert_eq!(taken, 41);
        }
        assert_eq!(in_order(0, |(), index| index, |_| Err(())), Ok(()));
    }

    #[test]
    fn a_panic_goes_through() {
        for threads in [1, 3] {
            let work = |(): &mut (), index: usize| assert_ne!(index, 5);
            let run = || on(threads, || in_order(1000, work, |()| Ok::<(), ()>(())));
            assert!(catch_unwind(AssertUnwindSafe(run)).is_err());
            let run = || {
                on(threads, || {
                    in_order(
                        1000,
                        |(), index| index,
                        |index| -> Result<(), ()> {
                            assert_ne!(index, 5);
                            Ok(())
                        },
                    )
                })
            };
            assert!(catch_unwind(AssertUnwindSafe(run)).is_err());
        }
    }
}
