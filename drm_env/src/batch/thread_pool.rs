//! Threads that share out the work of one call after another.
//!
//! Waking a sleeping thread takes longer than many a step of a batch. So the calling thread never waits
//! for one: it begins at once; helpers that are awake take parts too, and one that wakes too late finds
//! nothing left. Each thread begins with a share of its own, the same in every call, so that what it
//! needs stays in its cache, and helps the others when it is done. After a call helpers look out for the
//! next one for a short while before they sleep.
//!
//! A forked process inherits a pool without its threads. It leaves what belongs to them alone and makes
//! new ones.

use std::cell::{Cell, UnsafeCell};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering, fence};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::interruption::{self, Flag};

/// How long a helper looks out for the next call before it sleeps.
const SPIN_TIME: Duration = Duration::from_micros(50);

/// Parts that a thread at work must have left for another one to help it.
const MIN_WORK_PER_THREAD: usize = 4;

/// Parts after which a thread looks whether the work shall stop; long ones look themselves.
const PARTS_BETWEEN_POLLS: usize = 16;

/// Turns of waiting after which the calling thread looks whether the work shall stop.
const TURNS_BETWEEN_LOOKS: usize = 4096;

/// Parts until the next one that panics, for tests of what that leaves; the greatest number is never.
static FAULT: AtomicUsize = AtomicUsize::new(usize::MAX);

/// Lets a part of a later call panic, after so many others; for tests of what that leaves behind.
#[doc(hidden)]
pub fn panic_after_parts(parts: usize) {
    FAULT.store(parts, Ordering::Relaxed);
}

/// Panics in the part that [`panic_after_parts`] has chosen.
#[inline(always)]
fn fault() {
    if FAULT.load(Ordering::Relaxed) != usize::MAX {
        assert!(
            FAULT.fetch_sub(1, Ordering::Relaxed) != 0,
            "a test has asked for this"
        );
    }
}

/// The helpers beside the calling thread, made at the first call that needs them and again in a forked
/// process, which inherits none.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    helpers: Option<Helpers>,
}

#[derive(Debug)]
struct Helpers {
    process: u32,
    state: Arc<PoolState>,
    threads: Vec<JoinHandle<()>>,
}

/// Where helpers are called.
#[derive(Debug)]
struct PoolState {
    /// One a helper.
    slots: Vec<Apart<Slot>>,
    /// Helpers that sleep, or are about to.
    asleep: Apart<AtomicUsize>,
    /// Held by whoever goes to sleep and whoever wakes.
    sleep_lock: Mutex<()>,
    wake: Condvar,
    /// Whether a helper's part of the present call has panicked.
    failed: AtomicBool,
}

/// How calling thread and helper meet: on one cache line and without a lock.
#[derive(Debug, Default)]
struct Slot {
    /// [`IDLE`], [`CALLED`], [`BUSY`] or [`CLOSING`].
    state: AtomicU8,
    /// The work of the present call: the caller's while idle, the helper's while busy.
    job: UnsafeCell<Option<Job>>,
}

/// The helper has nothing to do: only the caller goes on from here.
const IDLE: u8 = 0;
/// There is a job: the helper may take it, or the caller withdraw it.
const CALLED: u8 = 1;
/// The helper is at the job, and will be idle.
const BUSY: u8 = 2;
/// The pool closes.
const CLOSING: u8 = 3;

// SAFETY: `job` is written while idle, by the caller, and read while busy, by the helper
unsafe impl Sync for Slot {}

impl Slot {
    fn state(&self) -> u8 {
        self.state.load(Ordering::Acquire)
    }

    fn call(&self, job: Job) {
        debug_assert_eq!(self.state(), IDLE);
        // SAFETY: an idle helper does not look at it
        unsafe { *self.job.get() = Some(job) };
        self.state.store(CALLED, Ordering::Release);
    }

    /// Takes the job, unless it has been withdrawn.
    fn take(&self) -> Option<Job> {
        self.swap(CALLED, BUSY)?;
        // SAFETY: the caller waits for a busy helper
        unsafe { *self.job.get() }
    }

    /// Withdraws the job, or waits until the helper that is at it has ended its last part.
    fn finish(&self) {
        if self.swap(CALLED, IDLE).is_none() {
            let mut turns = 0_usize;
            while self.state() == BUSY {
                std::hint::spin_loop();
                turns += 1;
                if turns.is_multiple_of(TURNS_BETWEEN_LOOKS) {
                    // tells the helpers, if it is so
                    interruption::is_wanted();
                }
            }
        }
    }

    fn swap(&self, from: u8, to: u8) -> Option<u8> {
        self.state
            .compare_exchange(from, to, Ordering::AcqRel, Ordering::Acquire)
            .ok()
    }
}

/// What a call has its helpers do, each once.
#[derive(Debug, Clone, Copy)]
struct Job(*const (dyn Fn(usize) + Sync));

// SAFETY: the function may be called from any thread, and `Pool::share` keeps it alive until no helper
// is at it
unsafe impl Send for Job {}

/// One thread's parts of a call: while it is at them it reads and writes nothing that another thread
/// does.
struct Share<I> {
    parts: I,
    begun: bool,
}

impl<I: DoubleEndedIterator + ExactSizeIterator> Share<I> {
    /// The next part of the thread whose share it is.
    fn first(&mut self) -> Option<I::Item> {
        self.begun = true;
        self.parts.next()
    }

    /// A part for another thread; the last few of a thread that is at work are not worth the way to
    /// another cache and back.
    fn last(&mut self) -> Option<I::Item> {
        if self.begun && self.parts.len() < MIN_WORK_PER_THREAD {
            return None;
        }
        self.parts.next_back()
    }
}

/// What shares no cache line with anything else, nor the one that the processor fetches with it.
#[derive(Debug)]
#[repr(align(128))]
struct Apart<T>(T);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PoolState {
    /// What a helper does until the pool closes.
    fn help(&self, index: usize) {
        let slot = &self.slots[index].0;
        loop {
            let begin = Instant::now();
            while slot.state() == IDLE && begin.elapsed() < SPIN_TIME {
                std::hint::spin_loop();
            }
            match slot.state() {
                CLOSING => return,
                IDLE => self.sleep(slot),
                _ => self.work(slot, index),
            }
        }
    }

    /// Sleeps until there may be something to do.
    fn sleep(&self, slot: &Slot) {
        let guard = lock(&self.sleep_lock);
        self.asleep.0.fetch_add(1, Ordering::Relaxed);
        // Either the helper sees the call, or the caller, who looks for sleepers after it, sees the helper;
        // then it waits for the lock, so that the helper does not miss being woken.
        fence(Ordering::SeqCst);
        if slot.state() == IDLE {
            drop(
                self.wake
                    .wait(guard)
                    .unwrap_or_else(PoisonError::into_inner),
            );
        }
        self.asleep.0.fetch_sub(1, Ordering::Relaxed);
    }

    fn work(&self, slot: &Slot, index: usize) {
        let Some(job) = slot.take() else { return };
        let work = || {
            // SAFETY: `Pool::share` returns, and ends the function's life, only when nobody is busy
            unsafe { (*job.0)(index + 1) }
        };
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
        if result.is_err() {
            self.failed.store(true, Ordering::Relaxed);
        }
        // what this thread has done comes before
        slot.state.store(IDLE, Ordering::Release);
    }

    /// Wakes the helpers that sleep, after what they shall see has been written.
    fn wake(&self) {
        fence(Ordering::SeqCst);
        if self.asleep.0.load(Ordering::Relaxed) > 0 {
            drop(lock(&self.sleep_lock));
            self.wake.notify_all();
        }
    }
}

impl Helpers {
    fn start(count: usize) -> Self {
        let state = Arc::new(PoolState {
            slots: (0..count).map(|_| Apart(Slot::default())).collect(),
            asleep: Apart(AtomicUsize::new(0)),
            sleep_lock: Mutex::new(()),
            wake: Condvar::new(),
            failed: AtomicBool::new(false),
        });
        // with fewer threads than wanted the work is done all the same
        let threads = (0..count)
            .map_while(|i| {
                let state = Arc::clone(&state);
                let builder = std::thread::Builder::new().name(format!("drm-env-{i}"));
                builder.spawn(move || state.help(i)).ok()
            })
            .collect();
        Self {
            process: std::process::id(),
            state,
            threads,
        }
    }
}

impl Drop for Helpers {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // The threads exist in the parent alone. Handles would let go of them by numbers that are other
            // threads' here.
            std::mem::forget(std::mem::take(&mut self.threads));
            return;
        }
        for slot in &self.state.slots {
            slot.0.state.store(CLOSING, Ordering::Release);
        }
        self.state.wake();
        for thread in self.threads.drain(..) {
            // a helper that has panicked has nothing left to give back
            let _ = thread.join();
        }
    }
}

impl Pool {
    fn state(&mut self, count: usize) -> Arc<PoolState> {
        let fits = |helpers: &Helpers| {
            helpers.process == std::process::id() && helpers.threads.len() == count
        };
        if !self.helpers.as_ref().is_some_and(fits) {
            self.helpers = None;
        }
        let helpers = self.helpers.get_or_insert_with(|| Helpers::start(count));
        Arc::clone(&helpers.state)
    }

    /// Does `work` on every part of so many shares, a thread for each, the calling one among them.
    ///
    /// # Panics
    /// If `work` does, on whichever thread; if it shall stop, see [`interruption`].
    pub(crate) fn share<I>(
        &mut self,
        threads: usize,
        shares: impl Iterator<Item = I>,
        work: impl Fn(I::Item) + Sync,
    ) where
        I: DoubleEndedIterator + ExactSizeIterator + Send,
    {
        let counted = |done: &Cell<usize>, part: I::Item| {
            fault();
            work(part);
            done.set(done.get() + 1);
            if done.get().is_multiple_of(PARTS_BETWEEN_POLLS) {
                interruption::poll();
            }
        };
        if threads < 2 {
            let done = Cell::new(0);
            return shares.flatten().for_each(|part| counted(&done, part));
        }
        let shares: Vec<Apart<Mutex<Share<I>>>> = shares
            .map(|parts| Share {
                parts,
                begun: false,
            })
            .map(|share| Apart(Mutex::new(share)))
            .collect();
        // What every thread looks at shares no cache line with what the calling one writes.
        let common = Apart((shares, counted));
        let common = &common.0;
        let fly = move |thread: usize| {
            let (shares, work) = common;
            let done = Cell::new(0);
            // the lock is let go before the work begins
            let first = || lock(&shares[thread].0).first();
            while let Some(part) = first() {
                work(&done, part);
            }
            // what the others have left, from their ends
            for other in (0..threads).filter(|other| *other != thread) {
                let last = || lock(&shares[other].0).last();
                while let Some(part) = last() {
                    work(&done, part);
                }
            }
        };
        let (flag, stopped) = (Flag::here(), AtomicBool::new(false));
        let stopped = &stopped;
        let run = Apart(move |thread: usize| {
            if thread == 0 {
                fly(thread);
            } else if flag.heed(|| fly(thread)).is_err() {
                stopped.store(true, Ordering::Relaxed);
            }
        });
        let state = self.state(threads - 1);
        let job: *const (dyn Fn(usize) + Sync + '_) = &run.0;
        // SAFETY: only the lifetime changes; `Finish` below outwaits every helper that has the pointer
        let job = Job(unsafe {
            std::mem::transmute::<
                *const (dyn Fn(usize) + Sync + '_),
                *const (dyn Fn(usize) + Sync + 'static),
            >(job)
        });
        // not written without need: helpers look at what lies beside it
        if state.failed.load(Ordering::Relaxed) {
            state.failed.store(false, Ordering::Relaxed);
        }
        let finish = Finish(&state);
        for slot in &state.slots {
            slot.0.call(job);
        }
        state.wake();
        (run.0)(0);
        drop(finish);
        if stopped.load(Ordering::Relaxed) {
            interruption::poll();
        }
        assert!(
            !state.failed.load(Ordering::Relaxed),
            "a thread of the batch has panicked"
        );
    }
}

/// Withdraws the job and waits for the helpers that are at it, also when the calling thread unwinds.
struct Finish<'a>(&'a PoolState);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        for slot in &self.0.slots {
            slot.0.finish();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;

    /// Numbers below `count` in so many shares.
    fn shares(count: usize, threads: usize) -> impl Iterator<Item = Range<usize>> {
        (0..threads).map(move |i| i * count / threads..(i + 1) * count / threads)
    }

    #[test]
    fn every_part_is_done_once_whatever_the_threads() {
        for threads in [1, 2, 3, 8] {
            let mut pool = Pool::default();
            // an interpreter is slow
            for round in 0..if cfg!(miri) { 12 } else { 200 } {
                let done: Vec<AtomicUsize> = (0..round % 17).map(|_| AtomicUsize::new(0)).collect();
                pool.share(threads, shares(done.len(), threads), |part| {
                    done[part].fetch_add(1, Ordering::Relaxed);
                });
                assert!(done.iter().all(|part| part.load(Ordering::Relaxed) == 1));
                if round % if cfg!(miri) { 5 } else { 50 } == 0 {
                    // long enough for the helpers to fall asleep
                    std::thread::sleep(SPIN_TIME * 4);
                }
            }
        }
    }

    #[test]
    fn a_panic_of_a_helper_reaches_the_caller_and_leaves_the_pool_usable() {
        let mut pool = Pool::default();
        let attempt = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.share(2, shares(64, 2), |part| {
                std::thread::sleep(SPIN_TIME);
                assert!(part < 8, "part {part}");
            });
        }));
        assert!(attempt.is_err());
        let done = AtomicUsize::new(0);
        pool.share(2, shares(64, 2), |_| {
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.load(Ordering::Relaxed), 64);
    }
}
