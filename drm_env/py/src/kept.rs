//! An engine that Python keeps: several threads may call it, one at a time.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

use drm_env::error::Error;
use drm_env::interruption::{self, Interrupted};
use pyo3::prelude::*;

use crate::error::{Outcome, detached, unusable};

/// Time between two attempts to get at an engine that another thread is at.
const PAUSE: Duration = Duration::from_micros(100);

/// Time that a thread has between taking the lock and saying so.
const PATIENCE: Duration = Duration::from_millis(100);

/// Whether an engine is whole.
#[derive(Clone, Copy)]
enum Condition {
    Whole,
    /// A panic left it half-way through something.
    Broken,
    /// So did whoever stopped it.
    Stopped,
}

pub(crate) struct ScenarioDelta<T> {
    engine: Mutex<(T, Condition)>,
    /// The process in which it was called last: a forked one inherits the lock, but not the thread that
    /// may have it.
    process: AtomicU32,
    /// The thread that is at it; 0 if none is.
    thread: AtomicUsize,
}

/// The engine while a thread has it.
struct Held<'a, T> {
    kept: &'a ScenarioDelta<T>,
    engine: MutexGuard<'a, (T, Condition)>,
}

impl<T> Drop for Held<'_, T> {
    fn drop(&mut self) {
        self.kept.thread.store(0, Ordering::Relaxed);
    }
}

/// A number that no other thread has, and not 0.
fn this_thread() -> usize {
    thread_local!(static PLACE: u8 = const { 0 });
    PLACE.with(|place| std::ptr::from_ref(place).addr())
}

impl<T: Send> ScenarioDelta<T> {
    pub(crate) fn new(engine: T) -> Self {
        Self {
            engine: Mutex::new((engine, Condition::Whole)),
            process: AtomicU32::new(std::process::id()),
            thread: AtomicUsize::new(0),
        }
    }

    /// Does something with the engine. Half-way through it by a panic, or stopped there, the engine is
    /// never used again.
    pub(crate) fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut T) -> Result<R, Error> + Send,
    ) -> Outcome<R> {
        self.call(py, true, work)
    }

    /// Looks at the engine.
    pub(crate) fn look<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&T) -> Result<R, Error> + Send,
    ) -> Outcome<R> {
        self.call(py, false, |engine| work(engine))
    }

    fn call<R: Send>(
        &self,
        py: Python<'_>,
        moving: bool,
        work: impl FnOnce(&mut T) -> Result<R, Error> + Send,
    ) -> Outcome<R> {
        detached(py, || {
            let mut held = self.hold()?;
            let (engine, condition) = &mut *held.engine;
            match condition {
                Condition::Whole => {}
                Condition::Broken => {
                    return Err(unusable("unusable after an internal error; make a new one"));
                }
                Condition::Stopped => {
                    let text =
                        "unusable, for an earlier call was interrupted half-way; make a new one";
                    return Err(unusable(text));
                }
            }
            interruption::moving(moving);
            match catch_unwind(AssertUnwindSafe(|| work(engine))) {
                Ok(result) => Ok(result?),
                Err(panic) => {
                    if panic.is::<Interrupted>() {
                        if interruption::is_moving() {
                            *condition = Condition::Stopped;
                        }
                    } else if moving {
                        *condition = Condition::Broken;
                    }
                    resume_unwind(panic)
                }
            }
        })
    }

    /// The engine, when no other thread is at it any longer.
    fn hold(&self) -> Outcome<Held<'_, T>> {
        let (process, thread) = (std::process::id(), this_thread());
        let begin = Instant::now();
        let engine = loop {
            match self.engine.try_lock() {
                Ok(engine) => break engine,
                // the condition tells what there is to know
                Err(TryLockError::Poisoned(engine)) => break engine.into_inner(),
                Err(TryLockError::WouldBlock) => {}
            }
            if self.thread.load(Ordering::Relaxed) == thread {
                let text = "busy with the call during which this one was made by a signal handler";
                return Err(unusable(text));
            }
            if self.process.load(Ordering::Relaxed) != process && begin.elapsed() > PATIENCE {
                let text = "unusable, for another thread was using it when this process was forked; \
                            make a new one";
                return Err(unusable(text));
            }
            interruption::poll();
            std::thread::sleep(PAUSE);
        };
        self.process.store(process, Ordering::Relaxed);
        self.thread.store(thread, Ordering::Relaxed);
        Ok(Held { kept: self, engine })
    }
}
