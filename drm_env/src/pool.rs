//! Threads that share out the work of one call after another.
//!
//! Waking a sleeping thread takes longer than many a step of a batch. So the calling thread never waits
//! for one: it begins at once; helpers that are awake take parts too, and one that wakes too late finds
//! nothing left. Each thread begins with a share of its own, the same in every call, so that what it
//! needs stays in its cache, and helps the others when it is done. After a call helpers look out for the
//! next one for a short while before they sleep.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
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
    /// Number of announcements, to be looked at without the lock.
    announced: AtomicU64,
}

#[derive(Debug)]
struct State {
    /// The work of the present call.
    job: Option<Job>,
    /// Helpers that are at it.
    busy: usize,
    /// Helpers that sleep.
    asleep: usize,
    /// Whether a helper's part of the present call has panicked.
    failed: bool,
    closing: bool,
}

/// What a call has its helpers do, each once.
#[derive(Debug, Clone, Copy)]
struct Job(*const (dyn Fn(usize) + Sync));

// SAFETY: the function may be called from any thread, and `Pool::share` keeps it alive until no helper
// is at it
unsafe impl Send for Job {}

impl Desk {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a helper does until the pool closes.
    fn help(&self, index: usize) {
        let mut seen = 0;
        loop {
            let begin = Instant::now();
            while self.announced.load(Ordering::Acquire) == seen && begin.elapsed() < LOOKOUT {
                for _ in 0..4 {
                    std::hint::spin_loop();
                }
            }
            let mut state = self.lock();
            while self.announced.load(Ordering::Acquire) == seen && !state.closing {
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
            seen = self.announced.load(Ordering::Acquire);
            if let Some(job) = state.job {
                state.busy += 1;
                drop(state);
                let work = || {
                    // SAFETY: `Pool::share` returns, and ends the function's life, only when nobody is
                    // busy
                    unsafe { (*job.0)(index) }
                };
                let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
                let mut state = self.lock();
                state.busy -= 1;
                state.failed |= result.is_err();
            }
        }
    }
}

impl Helpers {
    fn start(count: usize) -> Self {
        let desk = Arc::new(Desk {
            state: Mutex::new(State {
                job: None,
                busy: 0,
                asleep: 0,
                failed: false,
                closing: false,
            }),
            news: Condvar::new(),
            announced: AtomicU64::new(0),
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

    /// Does `work` on every part, with so many threads, the calling one among them.
    ///
    /// # Panics
    /// If `work` does, on whichever thread.
    pub(crate) fn share<P: Send>(
        &mut self,
        threads: usize,
        parts: impl Iterator<Item = P>,
        work: impl Fn(P) + Sync,
    ) {
        if threads < 2 {
            return parts.for_each(work);
        }
        let parts: Vec<Mutex<Option<P>>> = parts.map(|part| Mutex::new(Some(part))).collect();
        let claim = |part: &Mutex<Option<P>>| {
            let claimed = part.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(part) = claimed {
                work(part);
            }
        };
        let bound = |thread: usize| thread * parts.len() / threads;
        // the part after the one that each thread is at
        let next: Vec<AtomicUsize> = (0..threads)
            .map(|thread| AtomicUsize::new(bound(thread)))
            .collect();
        let run = |thread: usize| {
            for i in bound(thread)..bound(thread + 1) {
                next[thread].store(i + 1, Ordering::Relaxed);
                claim(&parts[i]);
            }
            // what the others have left, from their ends; the next part of one that is at work is not
            // worth the way to another cache
            for other in (0..threads).filter(|other| *other != thread) {
                for i in (bound(other)..bound(other + 1)).rev() {
                    let after = next[other].load(Ordering::Relaxed);
                    if after > bound(other) && i <= after {
                        break;
                    }
                    claim(&parts[i]);
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
        let sleepers = {
            let mut state = desk.lock();
            state.job = Some(job);
            state.failed = false;
            desk.announced.fetch_add(1, Ordering::Release);
            state.asleep
        };
        let finish = Finish(&desk);
        if sleepers > 0 {
            desk.news.notify_all();
        }
        run(0);
        drop(finish);
        assert!(
            !std::mem::take(&mut desk.lock().failed),
            "a thread of the batch has panicked"
        );
    }
}

/// Withdraws the job and waits for the helpers that are at it, also when the calling thread unwinds.
struct Finish<'a>(&'a Desk);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        loop {
            let mut state = self.0.lock();
            state.job = None;
            if state.busy == 0 {
                return;
            }
            drop(state);
            // each is at its last part
            for _ in 0..4 {
                std::hint::spin_loop();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_done_once_whatever_the_threads() {
        for threads in [1, 2, 3, 8] {
            let mut pool = Pool::default();
            for round in 0..200 {
                let done: Vec<AtomicUsize> = (0..round % 17).map(|_| AtomicUsize::new(0)).collect();
                pool.share(threads, done.iter(), |part| {
                    part.fetch_add(1, Ordering::Relaxed);
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
            pool.share(2, 0..64, |part| {
                std::thread::sleep(LOOKOUT);
                assert!(part < 8, "part {part}");
            });
        }));
        assert!(attempt.is_err());
        let done = AtomicUsize::new(0);
        pool.share(2, 0..64, |_| {
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.load(Ordering::Relaxed), 64);
    }
}
