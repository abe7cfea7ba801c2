//! Threads that share out the work of one call after another.
//!
//! Waking a sleeping thread takes longer than many a step of a batch. So the calling thread never waits
//! for one: it begins at once; helpers that are awake take parts too, and one that wakes too late finds
//! nothing left. Each thread begins with a share of its own, the same in every call, so that what it
//! needs stays in its cache, and helps the others when it is done. After a call helpers look out for the
//! next one for a short while before they sleep.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a helper looks out for the next call before it sleeps.
const LOOKOUT: Duration = Duration::from_micros(50);

/// The helpers beside the calling thread, made at the first call that needs them and again in a forked
/// process, which inherits none.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    crew: Option<Helpers>,
}

#[derive(Debug)]
struct Helpers {
    process: u32,
    desk: Arc<Desk>,
    threads: Vec<JoinHandle<()>>,
}

/// Where calls are announced.
#[derive(Debug)]
struct Desk {
    state: Mutex<State>,
    /// A call has been announced, or the pool closes.
    news: Condvar,
    /// Number of announcements, written under the lock, to be looked at without it.
    announced: Apart<AtomicU64>,
    /// Helpers that are at the present call: they come under the lock, while there is a job, and go
    /// without it.
    busy: Apart<AtomicUsize>,
    /// Whether a helper's part of the present call has panicked.
    failed: AtomicBool,
}

#[derive(Debug)]
struct State {
    /// The work of the present call.
    job: Option<Job>,
    /// Helpers that sleep.
    asleep: usize,
    closing: bool,
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

    /// A part for another thread; the next one of a thread that is at work is not worth the way to
    /// another cache.
    fn last(&mut self) -> Option<I::Item> {
        if self.begun && self.parts.len() < 2 {
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

impl Desk {
    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    fn announced(&self) -> u64 {
        self.announced.0.load(Ordering::Acquire)
    }

    /// What a helper does until the pool closes.
    fn help(&self, index: usize) {
        let mut seen = 0;
        loop {
            let begin = Instant::now();
            while self.announced() == seen && begin.elapsed() < LOOKOUT {
                std::hint::spin_loop();
            }
            let mut state = self.lock();
            while self.announced() == seen && !state.closing {
                state.asleep += 1;
                state = self
                    .news
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner);
                state.asleep -= 1;
            }
            if state.closing {
                return;
            }
            seen = self.announced();
            if let Some(job) = state.job {
                self.busy.0.fetch_add(1, Ordering::Relaxed);
                drop(state);
                let work = || {
                    // SAFETY: `Pool::share` returns, and ends the function's life, only when nobody is
                    // busy
                    unsafe { (*job.0)(index) }
                };
                let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
                if result.is_err() {
                    self.failed.store(true, Ordering::Relaxed);
                }
                // what this thread has done comes before
                self.busy.0.fetch_sub(1, Ordering::Release);
            }
        }
    }
}

impl Helpers {
    fn start(count: usize) -> Self {
        let desk = Arc::new(Desk {
            state: Mutex::new(State {
                job: None,
                asleep: 0,
                closing: false,
            }),
            news: Condvar::new(),
            announced: Apart(AtomicU64::new(0)),
            busy: Apart(AtomicUsize::new(0)),
            failed: AtomicBool::new(false),
        });
        // with fewer threads than wanted the work is done all the same
        let threads = (0..count)
            .map_while(|i| {
                let desk = Arc::clone(&desk);
                let builder = std::thread::Builder::new().name(format!("drm-env-{i}"));
                builder.spawn(move || desk.help(i + 1)).ok()
            })
            .collect();
        Self {
            process: std::process::id(),
            desk,
            threads,
        }
    }
}

impl Drop for Helpers {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // the threads exist in the parent alone
            return;
        }
        self.desk.lock().closing = true;
        self.desk.news.notify_all();
        for thread in self.threads.drain(..) {
            // a helper that has panicked has nothing left to give back
            let _ = thread.join();
        }
    }
}

impl Pool {
    fn desk(&mut self, count: usize) -> Arc<Desk> {
        let fits = |helpers: &Helpers| {
            helpers.process == std::process::id() && helpers.threads.len() == count
        };
        if !self.crew.as_ref().is_some_and(fits) {
            self.crew = None;
        }
        let helpers = self.crew.get_or_insert_with(|| Helpers::start(count));
        Arc::clone(&helpers.desk)
    }

    /// Does `work` on every part of so many shares, a thread for each, the calling one among them.
    ///
    /// # Panics
    /// If `work` does, on whichever thread.
    pub(crate) fn share<I>(
        &mut self,
        threads: usize,
        shares: impl Iterator<Item = I>,
        work: impl Fn(I::Item) + Sync,
    ) where
        I: DoubleEndedIterator + ExactSizeIterator + Send,
    {
        if threads < 2 {
            return shares.flatten().for_each(work);
        }
        let shares: Vec<Apart<Mutex<Share<I>>>> = shares
            .map(|parts| Share {
                parts,
                begun: false,
            })
            .map(|share| Apart(Mutex::new(share)))
            .collect();
        // the lock is let go before the work begins
        let first = |share: usize| lock(&shares[share].0).first();
        let last = |share: usize| lock(&shares[share].0).last();
        let run = |thread: usize| {
            while let Some(part) = first(thread) {
                work(part);
            }
            // what the others have left, from their ends
            for other in (0..threads).filter(|other| *other != thread) {
                while let Some(part) = last(other) {
                    work(part);
                }
            }
        };
        let desk = self.desk(threads - 1);
        let job: *const (dyn Fn(usize) + Sync + '_) = &run;
        // SAFETY: only the lifetime changes; `Finish` below outwaits every helper that has the pointer
        let job = Job(unsafe {
            std::mem::transmute::<
                *const (dyn Fn(usize) + Sync + '_),
                *const (dyn Fn(usize) + Sync + 'static),
            >(job)
        });
        desk.failed.store(false, Ordering::Relaxed);
        let sleepers = {
            let mut state = desk.lock();
            state.job = Some(job);
            desk.announced
                .0
                .store(desk.announced() + 1, Ordering::Release);
            state.asleep
        };
        let finish = Finish(&desk);
        if sleepers > 0 {
            desk.news.notify_all();
        }
        run(0);
        drop(finish);
        assert!(
            !desk.failed.load(Ordering::Relaxed),
            "a thread of the batch has panicked"
        );
    }
}

/// Withdraws the job and waits for the helpers that are at it, also when the calling thread unwinds.
struct Finish<'a>(&'a Desk);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        self.0.lock().job = None;
        // each is at its last part
        while self.0.busy.0.load(Ordering::Acquire) > 0 {
            std::hint::spin_loop();
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
            for round in 0..200 {
                let done: Vec<AtomicUsize> = (0..round % 17).map(|_| AtomicUsize::new(0)).collect();
                pool.share(threads, shares(done.len(), threads), |part| {
                    done[part].fetch_add(1, Ordering::Relaxed);
                });
                assert!(done.iter().all(|part| part.load(Ordering::Relaxed) == 1));
                if round % 50 == 0 {
                    // long enough for the helpers to fall asleep
                    std::thread::sleep(LOOKOUT * 4);
                }
            }
        }
    }

    #[test]
    fn a_panic_of_a_helper_reaches_the_caller_and_leaves_the_pool_usable() {
        let mut pool = Pool::default();
        let attempt = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.share(2, shares(64, 2), |part| {
                std::thread::sleep(LOOKOUT);
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
